"""blendcap convert ANIM OUT."""

from __future__ import annotations

from pathlib import Path


def convert(animation: Path, out: Path, /, *, rig: Path | None = None) -> None:
    """Write an animation in another format.

    Parameters
    ----------
    animation
        Weights over time: our .csv, a Live Link Face .csv, .glb or .npz.
    out
        The file to write; its ending says the format.
    rig
        The rig that the weights drive; needed to write .glb.
    """
    from blendcap.io import read_animation, read_rig, write_animation

    answer = read_animation(animation)
    write_animation(out, answer, rig=None if rig is None else read_rig(rig))
    print(f"{out}: {len(answer.weights):,} frames of {len(answer.names)} shapes at {answer.rate:g} frames a second")
