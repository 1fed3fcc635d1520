"""What was recorded beside a film, at the frames of the film: it may begin later, and run at another rate."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import blendcap

if TYPE_CHECKING:
    import numpy as np

    from blendcap.data import Animation, MarkerTake
    from blendcap.io.video import Video

SAME_RATE = 0.01  # part by which rates may differ that are meant to be the same


def same_rate(one: float, other: float) -> bool:
    """Whether two rates, frames a second, are meant to be the same."""
    return abs(one - other) <= SAME_RATE * other


def take_of_same_frames(film: Video, take: MarkerTake) -> MarkerTake:
    """The take, whose frames must be those of the film."""
    if not _same_frames(film, len(take.positions), take.rate):
        raise blendcap.InputError(f"{_apart(film, take)}; cut both to the same frames, at the rate of the film.")
    return take


def take_at_frames(film: Video, take: MarkerTake, offset: float | None) -> MarkerTake:
    """The take at the frames of a film that begins `offset` seconds after it, or with it if they are equally long."""
    from blendcap.numerics.resampling import at_times

    if offset is None and _same_frames(film, len(take.positions), take.rate):
        return take
    lasts, frame = len(take.positions) / take.rate, 1 / min(film.rate, take.rate)
    if offset is None and abs(film.count / film.rate - lasts) > frame / 2:
        raise blendcap.InputError(
            f"{_apart(film, take)}; say by --offset how many seconds after the take the videos begin (0 if together), "
            "or cut both to the same frames."
        )
    times = _times(film, offset or 0.0)
    if not (times[0] >= -frame and times[-1] <= lasts + frame):  # NaN is neither
        raise blendcap.InputError(
            f"With --offset {offset or 0:g} {film.path} reaches from {times[0]:.2f} to {times[-1]:.2f} s of the take, "
            f"which lasts {lasts:.2f} s; give another, or cut the videos to the take."
        )
    return replace(take, positions=at_times(take.positions, take.rate, times), rate=film.rate, residuals=None)


def weights_at_frames(film: Video, solved: Animation, offset: float) -> Animation:
    """The weights of a solved take at the frames of a film that begins `offset` seconds after it."""
    from blendcap.numerics.resampling import at_times

    if not offset and _same_frames(film, len(solved.weights), solved.rate):
        return solved
    lasts, needed = len(solved.weights) / solved.rate, offset + film.count / film.rate
    frame = 1 / min(film.rate, solved.rate)
    if lasts < needed - frame or (not offset and lasts > needed + frame):
        raise blendcap.InputError(
            f"The weights last {lasts:.2f} s, but the lesson's film ends at {needed:.2f} s; give the solved take of "
            "this lesson."
        )
    times = _times(film, offset)
    sure = None if solved.confidence is None else at_times(solved.confidence, solved.rate, times)
    weights = at_times(solved.weights, solved.rate, times)
    return blendcap.Animation(weights, solved.names, film.rate, confidence=sure)


def _same_frames(film: Video, count: int, rate: float) -> bool:
    return same_rate(film.rate, rate) and film.count == count


def _apart(film: Video, take: MarkerTake) -> str:
    return (
        f"{film.path} has {film.count} frames at {film.rate:g} a second, but the take {len(take.positions)} at "
        f"{take.rate:g}"
    )


def _times(film: Video, offset: float) -> np.ndarray:
    """Seconds (T,) of the film's frames in the take."""
    import numpy as np

    return offset + np.arange(film.count) / film.rate
