"""blendcap rig: build, refine and convert rigs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cyclopts import App

import blendcap
from blendcap.cli.rig_build import build
from blendcap.cli.rig_refine import refine

if TYPE_CHECKING:
    from blendcap.data import Rig

rig = App(name="rig", help="Make and convert rigs.")
rig.command(build)
rig.command(refine)


@rig.command
def convert(
    source: Path,
    out: Path,
    /,
    *,
    points: Path | None = None,
    unit: Literal["mm", "cm", "dm", "m", "in", "ft"] | None = None,
    shapes: Literal["all", "arkit"] = "all",
) -> None:
    """Write a rig in another format or unit, with named points, or with fewer shapes.

    Parameters
    ----------
    source
        A rig: .glb, .npz, a folder of .obj files or an ICT-FaceKit folder.
    out
        The file to write; its ending says the format.
    points
        A .json of places on the rig, {"30": 4321, "8": {"face": 17, "barycentric": [0.2, 0.3, 0.5]}}: the rig carries
        them as the point set that the file is named after. `landmarks68.json`, with the names "0" to "67", gives a rig
        the landmarks that `rig build --template` and `facs` need.
    unit
        The rig's unit, in place of what is known of its file: glTF is in metres, .obj in mm.
    shapes
        arkit: only those among the 52 shapes of ARKit, in any spelling, or their halves: the rig to solve on for Live
        Link Face, which holds no others.
    """
    from blendcap.data import landmarks68
    from blendcap.io import read_correspondences, read_rig, write_rig
    from blendcap.markers.correspondences import resolve

    answer = read_rig(source, unit)
    if shapes == "arkit":
        answer = answer.select(_of_arkit(answer))
    if points is not None:
        answer = replace(answer, points={**answer.points, points.stem: resolve(answer, read_correspondences(points))})
        if points.stem == "landmarks68":
            landmarks68(answer)  # says which is lacking
    write_rig(out, answer)
    print(f"{out}: {len(answer.mesh.vertices):,} vertices, {len(answer.names)} shapes")


def _of_arkit(whole: Rig) -> list[str]:
    """The shapes that mean one of ARKit's 52, or half of one, in the order of the rig."""
    from blendcap.data.names import ARKIT52, listed, match

    meant = {name for names in match(ARKIT52, whole.names).values() for name in names}
    if not meant:
        raise blendcap.InputError(
            f"The rig {whole.name!r} has none of the 52 shapes of ARKit, but {listed(whole.names)}; keep all."
        )
    return [name for name in whole.names if name in meant]
