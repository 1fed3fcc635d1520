"""How noisy the markers are, and which shapes they can see at that noise."""

from __future__ import annotations

import numpy as np

from blendcap.solving.rows import MarkerRows

# White noise of variance s² has fourth differences of variance (1 + 16 + 36 + 16 + 1) s².
_FOURTH = np.sqrt(70.0)
_MAD = 1.4826  # median absolute deviation to standard deviation, for a Gaussian
VISIBLE = 0.2  # a weight known no better than this is called unseen
HELD = 0.3  # a weight that the rig's own error leaves no better known than this is held at rest


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


def weight_errors(rows: MarkerRows, noise: float, told: np.ndarray | float = 0.0) -> np.ndarray:
    """Standard error of each shape's weight if it alone moved, (N,); infinite if no marker moves with it.

    What a rigid motion of the helmet would explain just as well does not count as seen, and a marker counts as often
    as it was seen.

    Parameters
    ----------
    rows : MarkerRows
    noise : float
        Of one coordinate, mm.
    told : (N,), optional
        Precision, one over variance, of what is known of each weight from elsewhere.
    """
    scaled = rows.rows * np.sqrt(1 - rows.missing.mean(0))[:, None, None]
    columns = scaled.reshape(-1, scaled.shape[2])
    shapes, helmet = columns[:, : rows.shapes], columns[:, rows.shapes :]
    if helmet.shape[1]:
        basis, *_ = np.linalg.svd(helmet, full_matrices=False)
        shapes = shapes - basis @ (basis.T @ shapes)
    energy = np.linalg.norm(shapes, axis=0)
    precision = np.where(energy > 1e-9, (energy / max(noise, 1e-12)) ** 2, 0.0) + told
    return np.divide(1.0, np.sqrt(precision), out=np.full(rows.shapes, np.inf), where=precision > 0)
