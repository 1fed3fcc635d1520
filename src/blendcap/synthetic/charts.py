"""Texture coordinates that fit into one picture: what lies in other tiles, or over other pieces, gets its own cell."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from blendcap.data import Mesh
from blendcap.synthetic.canvas import canvas_of

BORDER = 0.004  # of the picture, between cells


def in_one_picture(mesh: Mesh, kinds: np.ndarray, main: int, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Texture coordinates (U, 2) and their rows (F, 3) in which no two kinds (F,) of faces share a texel.

    Those of the mesh if they do so already. Otherwise each kind in each tile (UDIM) gets a cell, that with the face
    `main` the largest; where a vertex has `own` coordinates (V, 2), not NaN, these are
    taken. Kinds below 0 share one cell, and may lie over each other.
    """
    assert mesh.uv is not None and mesh.uv_faces is not None
    uv, uv_faces = mesh.uv, mesh.uv_faces
    if uv.min() >= 0 and uv.max() <= 1 and not _overlap(uv, uv_faces, kinds):
        return uv, uv_faces
    given = np.all(np.isfinite(own[mesh.faces]), axis=(1, 2))
    uv_faces = np.where(np.expand_dims(given, 1), len(uv) + mesh.faces, uv_faces)
    uv = np.concatenate([uv, np.nan_to_num(own)])
    tile = np.floor(np.clip(uv[uv_faces].mean(1), -99, 99)).astype(int)
    tile[kinds < 0] = 0
    _, group = np.unique(np.column_stack([kinds, tile]), axis=0, return_inverse=True)
    group = group.ravel()
    first = np.argsort(np.arange(group.max() + 1) != group[main], kind="stable")
    pairs, rows = np.unique(np.stack([np.repeat(group, 3), uv_faces.ravel()], 1), axis=0, return_inverse=True)
    placed = uv[pairs[:, 1]].copy()
    for number, (left, bottom, side) in zip(first, _cells(len(first)), strict=True):
        rows_here = pairs[:, 0] == number
        low, high = placed[rows_here].min(0), placed[rows_here].max(0)
        inside = (placed[rows_here] - low) / np.maximum(high - low, 1e-9)
        placed[rows_here] = np.array([left, bottom]) + BORDER + (side - 2 * BORDER) * inside
    return placed, rows.reshape(-1, 3)


def _cells(count: int) -> list[tuple[float, float, float]]:
    """Left, bottom and side of `count` squares: one large, the others below and beside it."""
    if count == 1:
        return [(0.0, 0.0, 1.0)]
    parts = max(4, -(-count // 2))  # a row of `parts` below and `parts - 1` beside
    side = 1 / parts
    small = [(k * side, 0.0, side) for k in range(parts)] + [(1 - side, k * side, side) for k in range(1, parts)]
    return [(0.0, side, 1 - side), *small[: count - 1]]


def _overlap(uv: np.ndarray, uv_faces: np.ndarray, kinds: np.ndarray) -> bool:
    masks = []
    for kind in np.unique(kinds[kinds >= 0]):
        mask = np.zeros((256, 256), dtype=bool)
        mask[canvas_of(uv, np.ascontiguousarray(uv_faces[kinds == kind]), 256).where] = True
        masks.append(mask)
    return any((one & other).mean() > 1e-3 for one, other in combinations(masks, 2))
