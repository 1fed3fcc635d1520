"""blendcap convert ANIM OUT."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def convert(
    animation: Path,
    out: Path,
    /,
    *,
    rig: Path | None = None,
    partial: Annotated[bool, Parameter(negative=(), show_default=False)] = False,
) -> None:
    """Write an animation in another format.

    Parameters
    ----------
    animation
        Weights over time: our .csv, a Live Link Face .csv, .glb or .npz.
    out
        The file to write; its ending says the format.
    rig
        The rig that the weights shall drive; needed to write .glb. Other spellings of its shapes are matched, and
        halves and wholes (browInnerUp) are carried over.
    partial
        Leave out shapes that the rig does not have, with a warning.
    """
    from blendcap.data.names import in_vocabulary
    from blendcap.io import read_animation, read_rig, write_animation
    from blendcap.io.formats import LIVE_LINK

    answer, target = read_animation(animation), None if rig is None else read_rig(rig)
    if target is not None:
        answer = in_vocabulary(answer, target.names, partial=partial)
    write_animation(out, answer, rig=target)
    shapes = f" of {len(answer.names)} shapes" if not out.name.lower().endswith(LIVE_LINK) else ""  # it has its own 61
    print(f"{out}: {len(answer.weights):,} frames{shapes} at {answer.rate:g} frames a second")
