"""Smooth scalar fields on points: the brushes that identities and shapes are painted with."""

from __future__ import annotations

import numpy as np


def gauss(points: np.ndarray, center, spread) -> np.ndarray:
    """A Gaussian (...,) of points (..., 3) with one spread per axis, 1 at its center."""
    return np.exp(-0.5 * (((points - np.asarray(center)) / np.asarray(spread)) ** 2).sum(-1))
