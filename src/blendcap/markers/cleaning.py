"""A take made fit to solve: names put right, short gaps bridged, wild points and unlabeled trajectories removed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from blendcap.data import InputError, MarkerTake

# What Vicon ("*12"), OptiTrack ("Unlabeled 1234") and Qualisys ("uname*3") call trajectories that nobody labeled.
_UNLABELED = re.compile(r"\*\d*|unlabell?ed\b.*|uname\*?\d*", re.IGNORECASE)
NEUTRAL_FRAMES = 10
_SPIKE = 50.0  # m/s²: no face moves like that
_COMPLETE = 0.9  # of the markers that the take ever sees, for a frame to count for the neutral


def rename(take: MarkerTake, label_map: Mapping[str, str]) -> MarkerTake:
    """The take with markers renamed, {old: new}; markers that the map does not name keep their name.

    Raises
    ------
    InputError
        If the map names a marker that the take does not have, or two markers would end with one name.
    """
    unknown = [old for old in label_map if old not in take.names]
    if unknown:
        known = ", ".join(take.names[:8])
        raise InputError(
            f"The label map names the marker {unknown[0]!r}, which the take does not have; it has {known} ..."
        )
    return replace(take, names=tuple(label_map.get(name, name) for name in take.names))


def drop_unlabeled(take: MarkerTake) -> MarkerTake:
    """The take without trajectories that nobody labeled: "*12", "Unlabeled 1234", "uname*3".

    Raises
    ------
    InputError
        If nothing would be left.
    """
    labeled = [name for name in take.names if not _UNLABELED.fullmatch(name)]
    if not labeled:
        raise InputError(f"None of the take's {len(take.names)} trajectories is labeled; label them before the solve.")
    return take if len(labeled) == len(take.names) else take.select(labeled)


def drop_spikes(take: MarkerTake) -> MarkerTake:
    """The take with points that jump out and back within one frame marked missing.

    A point is a spike if its neighbors in time were seen, it lies farther from their middle than they lie apart, and
    to come back from it takes an acceleration above _SPIKE: |x_t - (x_(t-1) + x_(t+1)) / 2| > _SPIKE / (2 rate²). The
    fastest facial motions, blinks and plosive lips, stay below about 20 m/s². At low rates the bound is wide (7 mm at
    60 frames a second, 28 mm at 30) and catches swapped labels rather than jitter.
    """
    before, here, after = take.positions[:-2], take.positions[1:-1], take.positions[2:]
    deviation = np.nan_to_num(np.linalg.norm(here - 0.5 * (before + after), axis=-1))
    comes_back = np.linalg.norm(after - before, axis=-1) <= deviation
    beyond = deviation > 1000.0 * _SPIKE / (2.0 * take.rate**2)
    spikes = np.pad(beyond & comes_back, ((1, 1), (0, 0)))
    return replace(take, positions=np.where(spikes[..., None], np.nan, take.positions)) if spikes.any() else take


def fill_gaps(take: MarkerTake, longest: float = 0.1) -> MarkerTake:
    """The take with its short gaps bridged by a monotone cubic (PCHIP) through the samples around them.

    Each coordinate stays between its values at the two ends of the gap, so a bridge never overshoots; it also cannot
    know a motion that happened within the gap. Gaps longer than `longest`, and those at the start and the end of the
    take, stay missing: the solve does without them. Fritsch and Butland (1984), doi:10.1137/0905021.

    Parameters
    ----------
    longest : float
        Longest gap that is filled, s. At 0.1 s a syllable or a blink can hide in a gap; longer is guessing.

    Raises
    ------
    InputError
        If `longest` is no number of seconds, or negative.
    """
    from scipy.interpolate import PchipInterpolator

    if not 0 <= longest < np.inf:
        raise InputError(f"The longest gap to fill must be a number of seconds from 0 on, but is {longest!r}.")
    limit = int(np.floor(min(longest * take.rate, len(take.positions)) + 1e-9))
    missing = take.missing
    fill = _short_gaps(missing, limit)
    if not fill.any():
        return take
    positions = take.positions.copy()
    for marker in np.flatnonzero(fill.any(0)):
        seen = np.flatnonzero(~missing[:, marker])
        curve = PchipInterpolator(seen, take.positions[seen, marker], axis=0, extrapolate=False)
        frames = np.flatnonzero(fill[:, marker])
        positions[frames, marker] = curve(frames)
    return replace(take, positions=positions)


def neutral_frame(take: MarkerTake, frame: int = 0, count: int = NEUTRAL_FRAMES) -> np.ndarray:
    """The performer's neutral: the median of the first `count` nearly complete frames from `frame` on.

    The 2016 paper (section 6) takes the first frame of the performance as neutral; a few more take the noise out.
    `frame` names another place, `count=1` that single frame.

    Parameters
    ----------
    frame : int
        Where the neutral begins.
    count : int
        Frames to use. A frame is nearly complete if it sees nine in ten of the markers that the take ever sees.

    Returns
    -------
    (M, 3) float64
        mm; NaN for a marker that none of these frames saw.

    Raises
    ------
    InputError
        If the take has no such frame, or no nearly complete one after it.
    """
    frames = len(take.positions)
    if not 0 <= frame < frames:
        raise InputError(f"The neutral is to begin at frame {frame}, but the take has the frames 0 to {frames - 1}.")
    seen = ~take.missing
    needed = _COMPLETE * seen.any(0).sum()
    complete = frame + np.flatnonzero((seen.sum(1) >= needed)[frame:])[:count]
    if len(complete) == 0 or needed == 0:
        raise InputError(
            f"From frame {frame} on no frame of the take sees nine in ten of its markers, so there is no neutral; "
            "name a better frame or remove markers that are mostly missing."
        )
    neutral = np.full(take.positions.shape[1:], np.nan)
    there = seen[complete].any(0)
    neutral[there] = np.nanmedian(take.positions[complete][:, there], axis=0)
    return neutral


def _short_gaps(missing: np.ndarray, limit: int) -> np.ndarray:
    """(T, M) bool: missing frames of runs of at most `limit` frames that are seen on both sides."""
    frames = np.arange(len(missing))[:, None]
    before = np.maximum.accumulate(np.where(missing, -1, frames), axis=0)
    after = np.minimum.accumulate(np.where(missing, len(missing), frames)[::-1], axis=0)[::-1]
    inside = (before >= 0) & (after < len(missing))
    return missing & inside & (after - before - 1 <= limit)
