"""An animation as a shaded video."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from blendcap.data import Animation, InputError, Rig
from blendcap.io.video_write import write_video
from blendcap.view.film import Film, pictures, reporting


def write_preview(
    path: str | Path,
    rig: Rig,
    animation: Animation,
    film: Film | None = None,
    *,
    targets: np.ndarray | None = None,
    fitted: np.ndarray | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write a video of the animated rig, seen from several sides, and return the number of frames.

    Parameters
    ----------
    path : path
        `.mp4`, `.gif`, or `.png` for a sequence.
    film : Film, optional
        Size, views, title and frames.
    targets, fitted : (T, M, 3), optional
        Markers (red) and their places on the posed rig (blue), mm, in the rig's space.
    progress : callable (frames done, frames in all), optional

    Raises
    ------
    InputError
        If the animation has a shape that the rig has not, a length is wrong or the file cannot be written.
    """
    film = film or Film()
    for what, points in (("targets", targets), ("fitted", fitted)):
        if points is not None and len(points) != len(animation.weights):
            raise InputError(f"The {what} have {len(points)} frames, but the animation has {len(animation.weights)}.")
    shown = pictures(rig, animation, film, targets=targets, fitted=fitted)
    return write_video(path, reporting(shown, film.count(animation), progress), film.rate(animation), film.size)
