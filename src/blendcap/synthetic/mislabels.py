"""What a tracker gets wrong: labels that change places, labels on reflections, and trajectories without a label."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import InputError, MarkerTake

SWAPPED, FALSE, LOOSE = (8, 60), (1, 15), (10, 120)  # frames, shortest and longest
NEIGHBORS = 4  # labels are swapped with one of the nearest so many
STRAY = (8.0, 40.0)  # mm, of a reflection from the marker that it is taken for
DOUBLE = 0.4  # part of the loose trajectories that repeat a marker; the others are reflections
DRIFT = 0.05  # mm a frame, of a reflection
TRIES = 200


@dataclass(frozen=True, eq=False)
class Mislabels:
    """What is true of a take with mistakes.

    Parameters
    ----------
    owner : (T, M + L) int64
        The marker, by its place in the sound take, whose position each label of the new take holds; -1 where it holds
        no marker's, because it is missing or false.
    swaps : tuple of (name, name, start, stop)
        Labels that change places in the frames from start to before stop.
    false : (T, M + L) bool
        Where a label follows a reflection.
    loose : tuple of str
        Names of the trajectories without a label.
    """

    owner: np.ndarray
    swaps: tuple[tuple[str, str, int, int], ...]
    false: np.ndarray
    loose: tuple[str, ...]


def mislabel(
    take: MarkerTake, *, seed: int, swaps: int = 0, ghosts: int = 0, loose: int = 0
) -> tuple[MarkerTake, Mislabels]:
    """The take with mistakes of labelling, and what they are.

    Parameters
    ----------
    take : MarkerTake
        Recorded or synthetic.
    seed : int
    swaps : int
        How many pairs of neighboring labels change places, for 8 to 60 frames each.
    ghosts : int
        How many times a label jumps to a reflection 8 to 40 mm away, for 1 to 15 frames.
    loose : int
        How many trajectories *0, *1, ... come without a label, for 10 to 120 frames each: doubles of a marker, as
        where a tracker saw two, and reflections.

    Raises
    ------
    InputError
        If a count is negative, or the take has no room for as many mistakes.
    """
    for count, what in ((swaps, "swaps"), (ghosts, "ghosts"), (loose, "loose trajectories")):
        if count < 0:
            raise InputError(f"The number of {what} must be 0 or more, but is {count!r}.")
    rng = np.random.default_rng(seed)
    frames, markers = take.missing.shape
    owner = np.where(take.missing, -1, np.arange(markers))
    positions, false, busy = take.positions.copy(), np.zeros((frames, markers), dtype=bool), take.missing.copy()
    swapped = [_swap(take, positions, owner, busy, rng) for _ in range(swaps)]
    for _ in range(ghosts):
        marker, start, stop = _room(busy, FALSE, "ghosts", rng)
        positions[start:stop, marker] = _reflection(take.positions[start:stop, marker], rng)
        owner[start:stop, marker], false[start:stop, marker] = -1, True
    names = tuple(f"*{i}" for i in range(loose))
    extra = np.full((frames, loose, 3), np.nan)
    extra_owner, extra_false = np.full((frames, loose), -1), np.zeros((frames, loose), dtype=bool)
    for i in range(loose):
        marker, start, stop = _room(take.missing.copy(), LOOSE, "loose trajectories", rng)
        path, double = take.positions[start:stop, marker], rng.random() < DOUBLE
        extra[start:stop, i] = path if double else _reflection(path, rng)
        extra_owner[start:stop, i], extra_false[start:stop, i] = marker if double else -1, not double
    truth = Mislabels(np.hstack([owner, extra_owner]), tuple(swapped), np.hstack([false, extra_false]), names)
    return MarkerTake(np.hstack([positions, extra]), (*take.names, *names), take.rate, timecode=take.timecode), truth


def _swap(take: MarkerTake, positions, owner, busy, rng: np.random.Generator) -> tuple[str, str, int, int]:
    """Exchange two neighbors for a span in which both are seen; writes into positions, owner and busy."""
    for _ in range(TRIES):
        one, start, stop = _room(busy.copy(), SWAPPED, "swaps", rng)
        away = np.linalg.norm(take.positions[start] - take.positions[start, one], axis=1)
        near = np.argsort(np.where(np.isnan(away), np.inf, away))[1 : 1 + NEIGHBORS]
        two = int(rng.choice(near)) if len(near) else one
        if two != one and not busy[start:stop, two].any():
            both, turned = [one, two], [two, one]
            positions[start:stop, both], owner[start:stop, both] = take.positions[start:stop, turned], turned
            busy[start:stop, both] = True
            return take.names[one], take.names[two], start, stop
    raise InputError("The take has no room for so many swaps of labels; ask for fewer, or give a longer take.")


def _room(busy: np.ndarray, length: tuple[int, int], what: str, rng: np.random.Generator) -> tuple[int, int, int]:
    """A marker and a span of frames in which it is not busy yet; it is afterwards."""
    frames, markers = busy.shape
    for _ in range(TRIES):
        span = int(rng.integers(length[0], length[1] + 1))
        marker, start = int(rng.integers(markers)), int(rng.integers(max(frames - span, 0) + 1))
        if start + span <= frames and not busy[start : start + span, marker].any():
            busy[start : start + span, marker] = True
            return marker, start, start + span
    raise InputError(f"The take has no room for so many {what}; ask for fewer, or give a longer take.")


def _reflection(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A path (S, 3) beside another: it follows by half, from some way off, and drifts."""
    direction = rng.normal(size=3)
    away = direction / np.linalg.norm(direction) * rng.uniform(*STRAY)
    drift = rng.normal(scale=DRIFT, size=path.shape).cumsum(0)
    return path[0] + 0.5 * (path - path[0]) + away + drift
