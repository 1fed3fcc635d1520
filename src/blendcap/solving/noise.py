"""How noisy the markers are."""

from __future__ import annotations

import numpy as np

MODEL_ERROR = 0.06  # mm: what the best of rigs errs at a marker
# White noise of variance s² has fourth differences of variance (1 + 16 + 36 + 16 + 1) s².
_FOURTH = np.sqrt(70.0)
_MAD = 1.4826  # median absolute deviation to standard deviation, for a Gaussian


def marker_noise(positions: np.ndarray) -> float:
    """Standard deviation of one marker coordinate, mm, from fourth differences in time.

    Motion is smooth over five frames and noise is not; the median keeps out the few frames where motion is fast.

    Parameters
    ----------
    positions : (T, M, 3)
        mm; NaN where missing.

    Returns
    -------
    float
        0 if no marker is seen in five frames in a row.
    """
    if len(positions) < 5:
        return 0.0
    differences = np.diff(positions, 4, axis=0)
    differences = differences[np.isfinite(differences)]
    return float(_MAD * np.median(np.abs(differences)) / _FOURTH) if differences.size else 0.0
