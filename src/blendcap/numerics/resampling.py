"""Values of one rate at the frames of another."""

from __future__ import annotations

import numpy as np

ON_A_FRAME = 1e-3  # of a frame: so near to a frame it is that frame


def at_times(values: np.ndarray, rate: float, times: np.ndarray) -> np.ndarray:
    """Values (T, ...) at a rate, frames a second, at times (K,) in seconds from the first: linear between frames.

    NaN where a neighbour is NaN; before the first frame and after the last the nearest.
    """
    at = np.clip(np.asarray(times) * rate, 0, len(values) - 1)
    at = np.where(np.abs(at - np.round(at)) < ON_A_FRAME, np.round(at), at)
    low = np.floor(at).astype(int)
    high = np.ceil(at).astype(int)  # a frame that is met has no other neighbour
    part = (at - low).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - part) * values[low] + part * values[high]
