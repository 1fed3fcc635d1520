"""Smoothing along time."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

ORDER = 2  # of the polynomials


def smooth(values: np.ndarray, rate: float, seconds: float) -> np.ndarray:
    """Savitzky-Golay: a parabola fitted over a window of about `seconds`, along the first axis.

    Keeps what is a parabola exactly, and so the height of a hump far better than a mean does.

    Parameters
    ----------
    values : (T, ...)
    rate : float
        Frames a second.
    seconds : float
        The window; too short for a parabola, or longer than the values, it does what it can.
    """
    frames = min(2 * (round(seconds * rate) // 2) + 1, len(values) - (len(values) + 1) % 2)
    if frames <= ORDER:
        return np.array(values, dtype=np.float64)
    return np.asarray(savgol_filter(values, frames, ORDER, axis=0, mode="interp"))
