"""How noisy the markers are, and which shapes they can see at that noise."""

from __future__ import annotations

import numpy as np

# White noise of variance s² has fourth differences of variance (1 + 16 + 36 + 16 + 1) s².
_FOURTH = np.sqrt(70.0)
_MAD = 1.4826  # median absolute deviation to standard deviation, for a Gaussian
VISIBLE = 0.2  # a weight known no better than this is called unseen


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


def weight_errors(deltas: np.ndarray, helmet: np.ndarray, noise: float, seen: np.ndarray) -> np.ndarray:
    """Standard error of each shape's weight if it alone moved, (N,); infinite if no marker moves with it.

    What a rigid motion of the helmet would explain just as well does not count as seen.

    Parameters
    ----------
    deltas : (N, M, 3)
        mm at weight 1.
    helmet : (K, M, 3)
        mm at 1.
    noise : float
        Of one coordinate, mm.
    seen : (M,)
        Part of the frames in which each marker was seen, 0 to 1.
    """
    scale = np.sqrt(seen)[None, :, None]
    shapes = (deltas * scale).reshape(len(deltas), -1)
    if len(helmet):
        basis, *_ = np.linalg.svd((helmet * scale).reshape(len(helmet), -1).T, full_matrices=False)
        shapes = shapes - (shapes @ basis) @ basis.T
    energy = np.linalg.norm(shapes, axis=1)
    return np.divide(noise, energy, out=np.full(len(deltas), np.inf), where=energy > 1e-9)
