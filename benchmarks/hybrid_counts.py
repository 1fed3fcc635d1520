"""What `hybrid.py` counts: frames and closings of lids that are told, and how rough an answer is."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from blendcap import Animation, Rig
from blendcap.data.names import match
from blendcap.numerics.stretches import stretches

CLOSED = 0.35  # of the way from a blink to rest: a smaller gap between the lids is told as shut
SHUT, OPEN = 0.25, 0.45  # the same of the truth, plainly: in between nobody could say
LATE = 2  # frames by which a blink may be told early or late and still be told


def hits(said: np.ndarray, true: np.ndarray) -> str:
    """Precision and recall, and with tolerance in time."""
    cells = []
    for late in (0, LATE):
        precision = np.count_nonzero(said & near(true, late)) / max(np.count_nonzero(said), 1)
        recall = np.count_nonzero(true & near(said, late)) / max(np.count_nonzero(true), 1)
        cells.append(f"{precision:.2f}, {recall:.2f}")
    return f"{cells[0]} ({cells[1]})"


def shut(said: np.ndarray, true: np.ndarray) -> str:
    """Precision and recall of frames with shut lids, from gaps (T, 2): where the truth is plain, and in all frames."""
    plain = (true < SHUT) | (true > OPEN)
    cells = []
    for counted in (plain, np.ones_like(plain)):
        told, asked = said[counted] < CLOSED, true[counted] < CLOSED
        both = np.count_nonzero(told & asked)
        cells.append(f"{both / max(told.sum(), 1):.2f}, {both / max(asked.sum(), 1):.2f}")
    return f"{cells[0]} ({cells[1]})"


def blinks(said: np.ndarray, true: np.ndarray) -> str:
    """Precision and recall of closings, from gaps (T, 2) of either eye, told two frames early or late at most.

    A closing lasts from the first frame below `CLOSED` until the lid is plainly open, and one that is told stands for
    one true closing at most. The truth's must reach `SHUT`; what is told where the truth is neither that nor plainly
    open is not counted.
    """
    right = told = asked = 0
    for ours, theirs in zip(said.T, true.T, strict=True):
        free = [run for run in _closings(theirs) if (theirs[run] < SHUT).any()]
        asked += len(free)
        doubtful = near(theirs < OPEN, LATE)
        for run in _closings(ours):
            reach = near(run, LATE)
            met = next((k for k, other in enumerate(free) if (reach & other).any()), None)
            if met is not None:
                free.pop(met)
                right += 1
            told += met is not None or not (run & doubtful).any() or _shut_before(run, theirs)
    return f"{right / max(told, 1):.2f}, {right / max(asked, 1):.2f} ({asked})"


def _shut_before(run: np.ndarray, theirs: np.ndarray) -> bool:
    """Whether a told run meets a true closing, which then was told before: one blink told twice."""
    return any((near(run, LATE) & other).any() for other in _closings(theirs) if (theirs[other] < SHUT).any())


def _closings(gap: np.ndarray) -> list[np.ndarray]:
    """Each closing of a lid with the gap (T,), as flags of its own: from shut until it is plainly open again.

    A lid that lingers at `CLOSED` does not blink each time that it crosses it.
    """
    frames, joined = np.arange(len(gap)), []
    for first, last in stretches(gap < CLOSED):
        lingers = joined and gap[joined[-1][1] : first].max() < OPEN
        joined.append((joined.pop()[0] if lingers else first, last))
    return [(first <= frames) & (frames <= last) for first, last in joined]


def near(flags: np.ndarray, frames: int) -> np.ndarray:
    """(T, ...) whether a flag is up within so many frames."""
    return maximum_filter1d(flags, 2 * frames + 1, axis=0, mode="constant", cval=False)


def gaps(rig: Rig, answer: Animation) -> np.ndarray:
    """(T, 2) how far each eye's lids are apart: 1 at rest, 0 at the rig's own blink (some rigs' lids never meet).

    Along the way that the blink goes, pair by pair: lids that pass each other have met and are not open again, and
    where they pass hides no place where they are open. A pair counts as far as the blink moves it.
    """
    found = []
    for side in ("Left", "Right"):
        upper, lower = rig.contacts[f"lids_{side.lower()}"].T
        apart = rig.deltas[:, upper].astype(float) - rig.deltas[:, lower]
        blink = [rig.index(name) for name in match([f"eyeBlink{side}"], rig.names)[f"eyeBlink{side}"]]
        closing = apart[blink].sum(0)
        way = np.linalg.norm(closing, axis=1)
        along = np.einsum("npc,pc->np", apart, closing / np.maximum(way, 1e-9)[:, None])
        found.append(np.maximum(way - answer.weights @ along, 0).sum(1) / way.sum())
    return np.stack(found, axis=1)


def roughness(animation: Animation) -> float:
    return float((np.diff(animation.weights, n=2, axis=0) ** 2).mean())
