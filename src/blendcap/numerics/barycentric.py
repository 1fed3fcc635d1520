"""Where points lie in their triangles: weights of the corners that sum to 1."""

from __future__ import annotations

import numpy as np


def barycentric(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Weights (P, 3), none negative, of points (P, 3) on or near their triangles (P, 3, 3)."""
    one, two, arm = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    aa, ab, bb = (one**2).sum(1), (one * two).sum(1), (two**2).sum(1)
    pa, pb = (arm * one).sum(1), (arm * two).sum(1)
    area = np.maximum(aa * bb - ab**2, 1e-30)
    v, w = (bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area
    weights = np.clip(np.stack([1 - v - w, v, w], axis=1), 0, None)
    return weights / weights.sum(1, keepdims=True)


def barycentric_flat(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Weights (P, 3) of points (P, 2) in flat triangles (P, 3, 2); negative outside, not finite without an area."""
    a, b, c = (corners[:, k] for k in range(3))
    parts = _cross(b - points, c - points), _cross(c - points, a - points), _cross(a - points, b - points)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack(parts, 1) / _cross(b - a, c - a)[:, None]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
