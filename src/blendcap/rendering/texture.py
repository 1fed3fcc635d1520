"""A texture in several sizes, so that a small picture of it does not shimmer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import Mesh
from blendcap.rendering.color import LINEAR, to_srgb

SMALLEST = 32  # texels, of the shorter side: a texture is not halved further


@dataclass(frozen=True, eq=False)
class Texture:
    """The image of a mesh and its halvings.

    Parameters
    ----------
    levels : tuple of (H, W, 3) uint8
        sRGB; each half as large as the one before.
    uv : (U, 2)
    uv_faces : (F, 3)
    """

    levels: tuple[np.ndarray, ...]
    uv: np.ndarray
    uv_faces: np.ndarray

    def at(self, corners: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The level whose texels are about as large as pixels, for the kernels; see `level_for`."""
        if len(self.levels) == 1:
            return self.levels[0], self.uv, self.uv_faces
        level = level_for(corners, faces, self.uv, self.uv_faces, self.levels[0].shape)
        return self.levels[level], self.uv, self.uv_faces


NONE = Texture((np.zeros((1, 1, 3), dtype=np.uint8),), np.zeros((1, 2)), np.zeros((0, 3), dtype=np.int64))


def texture_of(mesh: Mesh, keep) -> Texture:
    """The mesh's texture on the faces to `keep`; `NONE` if it has none."""
    if mesh.texture is None or mesh.uv is None or mesh.uv_faces is None:
        return NONE
    image = mesh.texture[:, :, :3] if mesh.texture.shape[2] >= 3 else np.repeat(mesh.texture[:, :, :1], 3, axis=2)
    levels = [np.ascontiguousarray(image)]
    while min(levels[-1].shape[:2]) >= 2 * SMALLEST:
        levels.append(_halved(levels[-1]))
    return Texture(tuple(levels), mesh.uv, np.ascontiguousarray(mesh.uv_faces[keep]))


def level_for(corners: np.ndarray, faces: np.ndarray, uv: np.ndarray, uv_faces: np.ndarray, shape) -> int:
    """How often to halve a texture of `shape` (H, W, ...) for its texels to be about as large as pixels.

    `corners` (V, 3) are homogeneous pixels; one level serves the whole picture, by the median of its triangles.
    """
    some = slice(None, None, len(faces) // 2000 + 1)  # enough for a median
    pixels = corners[:, :2] / np.where(corners[:, 2:] > 0, corners[:, 2:], np.nan)
    seen, painted = _doubled_areas(pixels, faces[some]), _doubled_areas(uv, uv_faces[some])
    front = (seen < 0) & (painted != 0)  # pixels count downwards, so the front turns the other way
    if not front.any():
        return 0
    texels = np.median(np.abs(painted[front] / seen[front])) * shape[0] * shape[1]  # on the area of a pixel
    most = max(int(np.log2(min(shape[:2]) / SMALLEST)), 0) if min(shape[:2]) >= SMALLEST else 0
    return int(np.clip(np.log2(max(texels, 1)) / 2, 0, most))


def _halved(image: np.ndarray) -> np.ndarray:
    """Each four texels as one, mixed as light."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    blocks = LINEAR.astype(np.float32)[image[: 2 * height, : 2 * width]].reshape(height, 2, width, 2, 3)
    return (to_srgb(blocks.mean((1, 3))) * 255 + 0.5).astype(np.uint8)


def _doubled_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    (ax, ay), (bx, by) = (points[faces[:, k]].T - points[faces[:, 0]].T for k in (1, 2))
    return ax * by - ay * bx
