"""Blinks on the performer's own scale: another face shows the teacher's blink otherwise, but its lids do meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import find_peaks

LIDS = ("AU43", "AU45")  # the units that shut an eye
RISES = 0.4  # how far lids close, and open again, when they blink
DEEP = 0.6  # lids that are told to close by less do not shut: no blink grows by much more than a half
TOGETHER = 0.5  # of the stronger side, that the weaker does at least; else it is a wink
FEWEST = 3  # blinks that tell a scale
STRONG = 0.65  # the blink that is to shut the eyes is as strong as this part of all: of three, the second
SHUT = 0.95


def with_full_blinks(intensity: np.ndarray, units: Sequence[str]) -> np.ndarray:
    """Intensities in which the strongest blinks of a take, if it has `FEWEST`, reach `SHUT`.

    Blinks that are told as more than shut come down; a squeeze among three, or a noisy frame, does not tell how far.

    One gain for both eyes, told by the blinks that both do: a side that closes less stays so, and a wink tells nothing.
    It does not depend on how long the take is, nor on what else is in it.

    Parameters
    ----------
    intensity : (T, U)
        From 0; lids may be told more than shut.
    units : sequence of str
        Others than lids' stay as they are.

    Returns
    -------
    (T, U)
        0 to 1 of lids; as it was if there are too few blinks.
    """
    lids = [u for u, unit in enumerate(units) if unit.rstrip("LR") in LIDS]
    heights = blink_heights(intensity[:, lids])
    if len(heights) < FEWEST:
        return intensity
    # The empirical quantile, without interpolation: a take that is played twice has the same.
    gain = SHUT / np.quantile(heights, STRONG, method="inverted_cdf")
    result = intensity.copy()
    result[:, lids] = np.clip(gain * result[:, lids], 0, 1)
    return result


def blink_heights(lids: np.ndarray) -> np.ndarray:
    """How far the lids (T, sides) close, mean of the sides, in each blink that all of them do; (B,)."""
    if not lids.size:
        return np.zeros(0)
    # Open before and after, so that what follows a take does not count; what trembles while it is shut is one closing.
    open_before_and_after = np.pad(np.minimum(lids.mean(1), 1), 1)
    places = find_peaks(open_before_and_after, height=DEEP, prominence=RISES)[0] - 1
    blinks = lids[places]
    return blinks.mean(1)[blinks.min(1) >= TOGETHER * blinks.max(1)]
