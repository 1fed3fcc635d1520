"""blendcap rig: build and convert rigs."""

from __future__ import annotations

from pathlib import Path

from cyclopts import App

from blendcap.cli.rig_build import build

rig = App(name="rig", help="Make and convert rigs.")
rig.command(build)


@rig.command
def convert(source: Path, out: Path, /) -> None:
    """Write a rig in another format.

    Parameters
    ----------
    source
        A rig: .glb, .npz, a folder of .obj files or an ICT-FaceKit folder.
    out
        The file to write; its ending says the format.
    """
    from blendcap.io import read_rig, write_rig

    answer = read_rig(source)
    write_rig(out, answer)
    print(f"{out}: {len(answer.mesh.vertices):,} vertices, {len(answer.names)} shapes")
