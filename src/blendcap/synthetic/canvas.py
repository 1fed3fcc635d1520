"""A texture to paint on: which place of a surface each texel shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from blendcap.data import Camera
from blendcap.rendering.color import PIXELS, STEPS
from blendcap.rendering.rasterize import rasterize

BLEED = 3  # texels


class Canvas(NamedTuple):
    """The texels that a surface covers.

    Parameters
    ----------
    size : int
        Texels of a side.
    where : (rows, columns)
    faces : (T,)
        The triangle that each shows.
    weights : (T, 3) float32
        Barycentric coordinates in it.
    """

    size: int
    where: tuple[np.ndarray, np.ndarray]
    faces: np.ndarray
    weights: np.ndarray

    def part(self, chosen: np.ndarray) -> Canvas:
        """Only the texels `chosen` (T,)."""
        rows, columns = self.where
        return Canvas(self.size, (rows[chosen], columns[chosen]), self.faces[chosen], self.weights[chosen])

    def mixed(self, table: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Values (T, C) float32 of a table (V, C) at the texels; `corners` (F, 3) are rows of it."""
        table, own = np.asarray(table, dtype=np.float32), corners[self.faces]
        values = self.weights[:, :1] * table[own[:, 0]]
        for corner in (1, 2):
            values += self.weights[:, corner : corner + 1] * table[own[:, corner]]
        return values


def canvas_of(uv: np.ndarray, uv_faces: np.ndarray, size: int) -> Canvas:
    """The canvas of texture coordinates (U, 2), v up, at the corners (F, 3) of triangles."""
    pixels = uv * [size, -size] + [-0.5, size - 0.5]
    flat = np.concatenate([pixels, np.ones((len(pixels), 1))], 1)  # a plane at distance 1: pixels are coordinates
    seen = rasterize(flat, uv_faces, Camera(np.eye(3), np.eye(4)), (size, size))
    rows, columns = np.nonzero(seen.face >= 0)
    return Canvas(size, (rows, columns), seen.face[rows, columns], seen.barycentric[rows, columns].astype(np.float32))


def bled(picture: np.ndarray, canvas: Canvas) -> np.ndarray:
    """The picture with colors that run a few texels over the borders of their charts, for interpolation's sake."""
    picture, painted = picture.copy(), np.zeros(picture.shape[:2], dtype=bool)
    painted[canvas.where] = True
    for _ in range(BLEED):
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            beside = np.nonzero(np.roll(painted, step, axis) & ~painted)
            source = [(index - step) % canvas.size if k == axis else index for k, index in enumerate(beside)]
            picture[beside] = picture[tuple(source)]
            painted[beside] = True
    return picture


def developed(linear: np.ndarray) -> np.ndarray:
    """Bytes (H, W, 3), sRGB, of linear light."""
    return PIXELS[(np.clip(linear, 0.003, 1) * (STEPS - 1) + 0.5).astype(np.int32)]
