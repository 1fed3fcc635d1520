"""Mean shift: the dense places of a cloud of points (Comaniciu and Meer 2002)."""

from __future__ import annotations

import numpy as np

ROUNDS = 100


def mean_shift(
    points: np.ndarray, bandwidth: float, weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Centers (K, D) of the clusters of points (P, D), and the weight of the points in each (K,), largest first.

    Each point climbs to the mean of the points within `bandwidth` until it stands still; points that end within
    half a bandwidth of each other are one cluster. Without weights (P,) every point counts 1.
    """
    points = np.asarray(points, dtype=np.float64)
    weights = np.ones(len(points)) if weights is None else np.asarray(weights, dtype=np.float64)
    seeds = points.copy()
    for _ in range(ROUNDS):
        near = (_squared(seeds, points) <= bandwidth**2) * weights
        total = near.sum(1, keepdims=True)
        moved = np.where(total > 0, near @ points / np.maximum(total, 1e-300), seeds)
        if np.allclose(moved, seeds, atol=1e-3 * bandwidth):
            break
        seeds = moved
    density = (_squared(seeds, points) <= bandwidth**2) @ weights
    centers, sizes = [], []
    left = np.ones(len(seeds), dtype=bool)
    for seed in np.argsort(np.negative(density), kind="stable"):
        if left[seed]:
            own = left & (((seeds - seeds[seed]) ** 2).sum(1) <= (bandwidth / 2) ** 2)
            centers.append(seeds[seed])
            sizes.append(weights[own].sum())
            left &= ~own
    order = np.argsort(np.negative(sizes), kind="stable")
    return np.array(centers).reshape(-1, points.shape[1])[order], np.array(sizes)[order]


def _squared(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return ((one[:, None] - other[None]) ** 2).sum(2)
