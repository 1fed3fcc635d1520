"""Mean shift: the dense places of a cloud of points (Comaniciu and Meer 2002)."""

from __future__ import annotations

import numpy as np

ROUNDS = 100


def mean_shift(points: np.ndarray, bandwidth: float) -> tuple[np.ndarray, np.ndarray]:
    """Centers (K, D) of the clusters of points (P, D), and how many points belong to each (K,), largest first.

    Each point climbs to the mean of the points within `bandwidth` until it stands still; points that end within
    half a bandwidth of each other are one cluster.
    """
    points = np.asarray(points, dtype=np.float64)
    seeds = points.copy()
    for _ in range(ROUNDS):
        near = ((seeds[:, None] - points[None]) ** 2).sum(2) <= bandwidth**2
        moved = near @ points / near.sum(1, keepdims=True)
        if np.allclose(moved, seeds, atol=1e-3 * bandwidth):
            break
        seeds = moved
    centers: list[np.ndarray] = []
    sizes: list[int] = []
    density = (((seeds[:, None] - points[None]) ** 2).sum(2) <= bandwidth**2).sum(1)
    left = np.ones(len(seeds), dtype=bool)
    for seed in np.argsort(-density, kind="stable"):
        if left[seed]:
            own = left & (((seeds - seeds[seed]) ** 2).sum(1) <= (bandwidth / 2) ** 2)
            centers.append(seeds[seed])
            sizes.append(int(own.sum()))
            left &= ~own
    order = np.argsort(-np.array(sizes, dtype=int), kind="stable")
    return np.array(centers).reshape(-1, points.shape[1])[order], np.array(sizes, dtype=int)[order]
