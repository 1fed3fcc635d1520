"""blendcap rig: build and convert rigs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cyclopts import App

from blendcap.cli.rig_build import build

rig = App(name="rig", help="Make and convert rigs.")
rig.command(build)


@rig.command
def convert(source: Path, out: Path, /, *, points: Path | None = None) -> None:
    """Write a rig in another format, or with named points.

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
    """
    from blendcap.data import landmarks68
    from blendcap.io import read_correspondences, read_rig, write_rig
    from blendcap.markers.correspondences import resolve

    answer = read_rig(source)
    if points is not None:
        answer = replace(answer, points={**answer.points, points.stem: resolve(answer, read_correspondences(points))})
        if points.stem == "landmarks68":
            landmarks68(answer)  # says which is lacking
    write_rig(out, answer)
    print(f"{out}: {len(answer.mesh.vertices):,} vertices, {len(answer.names)} shapes")
