"""Smooth scalar fields on points: the brushes that identities and shapes are painted with."""

from __future__ import annotations

import numpy as np


def smoothstep(low: float, high: float, x: np.ndarray) -> np.ndarray:
    """0 at `low`, 1 at `high`, level at both; `low` may be the larger."""
    t = np.clip((np.asarray(x) - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def gauss(points: np.ndarray, center, spread) -> np.ndarray:
    """A Gaussian (...,) of points (..., 3) with one spread per axis, 1 at its center."""
    return np.exp(-0.5 * (((points - np.asarray(center)) / np.asarray(spread)) ** 2).sum(-1))
