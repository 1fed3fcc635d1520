"""Polygons from the triangle fans that `triangulate` made of them: a file need only keep how many corners each had."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError


def fans_to_polygons(faces: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The polygons (P, K), padded with -1, whose fans are `faces` (F, 3), given their numbers of corners (P,)."""
    sizes = np.asarray(sizes, dtype=np.int64)
    if len(sizes) == 0 or sizes.min() < 3 or int((sizes - 2).sum()) != len(faces):
        raise InputError("The polygon sizes do not fit the triangles; export the rig again.")
    polygons = np.full((len(sizes), int(sizes.max())), -1, np.int64)
    first = np.concatenate([[0], np.cumsum(sizes - 2)[:-1]])
    polygons[:, :2] = faces[first, :2]
    for corner in range(2, polygons.shape[1]):
        has = sizes > corner
        polygons[has, corner] = faces[first[has] + corner - 2, 2]
    return polygons


def run_lengths(values: np.ndarray) -> list[list[int]]:
    """Equal neighbours of `values` (P,) counted: [[value, how many], ...]."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    lengths = np.diff(np.concatenate([starts, [len(values)]]))
    return [[int(values[s]), int(n)] for s, n in zip(starts, lengths, strict=True)]


def from_run_lengths(runs: list[list[int]], most: int) -> np.ndarray:
    """The values that `run_lengths` counted, if they are no more than `most`."""
    if sum(int(many) for _, many in runs) > most or any(many < 0 for _, many in runs):
        raise InputError(f"The polygon sizes count more than {most} polygons; export the rig again.")
    return np.repeat([value for value, _ in runs], [many for _, many in runs])
