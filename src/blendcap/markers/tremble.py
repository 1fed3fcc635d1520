"""How much what was measured trembles: a coordinate that does not was not measured."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from blendcap.numerics.stretches import stretches

WINDOW = 12  # frames that one cubic must explain
SURE = 0.1  # of the usual tremble: no window of measured frames is as calm
LIKELY = 0.3  # a window beside a sure one belongs to the same stretch below this
AT_REST = 0.2  # of the markers may be calm at once, or a calm one is nothing special


def usual_tremble(coordinates: np.ndarray, part: float = 0.5) -> np.ndarray:
    """(K,) noise of one coordinate of (T, K, D), mm, by fourth differences, in which little of a motion is left.

    Of a take that was smoothed it is what the smoothing left. `part` of the frames may be as calm as they like.
    """
    squared = (np.diff(coordinates, 4, axis=0) ** 2).mean(2)
    return np.sqrt(quantile(squared, part) / 70.0)


def left_by_cubics(coordinates: np.ndarray, step: int = 1, window: int = WINDOW) -> np.ndarray:
    """(T - window + 1, ...) root mean square per coordinate of what a cubic leaves of each window of (T, ..., D), mm.

    Of white noise it is the noise. Of a measured path, smoothed or not, it is not less; of one that was filled in, it
    is nearly nothing. With a `step` only every such window is looked at.
    """
    # What these rows of length 1 see of a window is what a cubic leaves of it.
    rows = np.linalg.qr(np.vander(np.linspace(-1, 1, window), 4), mode="complete")[0][:, 4:]
    left = sliding_window_view(coordinates, window, axis=0)[::step] @ rows
    return np.sqrt(np.einsum("...dk,...dk->...", left, left) / (left.shape[-2] * left.shape[-1]))


def calm_runs(left: np.ndarray, usual: np.ndarray) -> list[tuple[int, int]]:
    """(first, last) frames of likely windows in a row with a sure one among them.

    Parameters
    ----------
    left, usual : (T - 11,)
        From `left_by_cubics`, and what it is to be compared with.
    """
    sure = left < SURE * usual
    return [(first, last) for first, last in runs(left < LIKELY * usual) if sure[first : last - WINDOW + 2].any()]


def runs(windows: np.ndarray) -> list[tuple[int, int]]:
    """(first, last) frames of windows (T - 11,) bool in a row."""
    return [(first, last + WINDOW - 1) for first, last in stretches(windows)]


def quantile(values: np.ndarray, part: float) -> np.ndarray:
    """(K,) the known value in each column of (R, K) that `part` of the known ones lie below; 0 where none is known."""
    known = np.isfinite(values)
    ordered = np.sort(np.where(known, values, np.inf), axis=0)
    count = known.sum(0)
    place = np.floor(part * np.maximum(count - 1, 0)).astype(int)
    return np.where(count > 0, ordered[place, np.arange(values.shape[1])], 0.0)
