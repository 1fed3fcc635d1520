"""What `hybrid.py` counts: frames and closings of lids that are told, and how rough an answer is."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label, maximum_filter1d

from blendcap import Animation, Rig

CLOSED = 0.35  # of the gap between the lids at rest
LATE = 2  # frames by which a blink may be told early or late and still be told


def hits(said: np.ndarray, true: np.ndarray) -> str:
    """Precision and recall, and with tolerance in time."""
    cells = []
    for late in (0, LATE):
        precision = np.count_nonzero(said & near(true, late)) / max(np.count_nonzero(said), 1)
        recall = np.count_nonzero(true & near(said, late)) / max(np.count_nonzero(true), 1)
        cells.append(f"{precision:.2f}, {recall:.2f}")
    return f"{cells[0]} ({cells[1]})"


def blinks(said: np.ndarray, true: np.ndarray) -> str:
    """Precision and recall of closings, runs of flags (T, 2) of either eye, told two frames early or late at most."""
    told = [_met(ours, near(theirs, LATE)) for ours, theirs in zip(said.T, true.T, strict=True)]
    found = [_met(theirs, near(ours, LATE)) for ours, theirs in zip(said.T, true.T, strict=True)]
    precision, recall = (np.concatenate(runs).astype(float) for runs in (told, found))
    return f"{precision.sum() / max(len(precision), 1):.2f}, {recall.sum() / max(len(recall), 1):.2f}"


def _met(flags: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether each run of flags (T,) has a frame in which the others (T,) are up, too."""
    runs, count = label(flags)  # pyright: ignore[reportGeneralTypeIssues]
    return np.array([(others & (runs == k)).any() for k in range(1, count + 1)], dtype=bool)


def near(flags: np.ndarray, frames: int) -> np.ndarray:
    """(T, ...) whether a flag is up within so many frames."""
    return maximum_filter1d(flags, 2 * frames + 1, axis=0, mode="constant", cval=False)


def closed(rig: Rig, answer: Animation) -> np.ndarray:
    """(T, 2) where each eye's lids are closer than `CLOSED` of their gap at rest."""
    gaps = []
    for side in ("lids_left", "lids_right"):
        upper, lower = rig.contacts[side].T
        apart = rig.deltas[:, upper].astype(float) - rig.deltas[:, lower]
        rest = rig.mesh.vertices[upper] - rig.mesh.vertices[lower]
        gap = np.linalg.norm(rest + np.tensordot(answer.weights, apart, axes=1), axis=2).mean(1)
        gaps.append(gap / np.linalg.norm(rest, axis=1).mean() < CLOSED)
    return np.stack(gaps, axis=1)


def roughness(animation: Animation) -> float:
    return float((np.diff(animation.weights, n=2, axis=0) ** 2).mean())
