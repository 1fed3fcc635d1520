"""Rigid motions as numbers and as matrices."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation


def motion_matrices(motion: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """(T, 4, 4) of motions (T, 6): a translation, mm, and a rotation vector, rad, about a pivot (3,)."""
    result = np.tile(np.eye(4), (len(motion), 1, 1))
    result[:, :3, :3] = Rotation.from_rotvec(motion[:, 3:]).as_matrix()
    result[:, :3, 3] = motion[:, :3] + pivot - result[:, :3, :3] @ pivot
    return result
