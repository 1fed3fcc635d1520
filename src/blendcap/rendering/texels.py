"""Which place of the surface each texel of a texture shows."""

from __future__ import annotations

import numpy as np

from blendcap.data import Camera, Mesh
from blendcap.rendering.rasterize import Fragments, rasterize


def texels_of(mesh: Mesh, size: tuple[int, int]) -> Fragments:
    """Face and barycentric coordinates at the center of each texel of a texture of `size` (width, height).

    The mesh needs uv. Where charts overlap, one of them is seen.
    """
    pixels = uv_pixels(mesh, size)
    flat = np.concatenate([pixels, np.ones((len(pixels), 1))], 1)  # a plane at distance 1: pixels are coordinates
    return rasterize(flat, np.asarray(mesh.uv_faces), Camera(np.eye(3), np.eye(4)), size)


def uv_pixels(mesh: Mesh, size: tuple[int, int]) -> np.ndarray:
    """Texture coordinates as pixels (U, 2) of a texture of `size` (width, height), row 0 on top."""
    width, height = size
    return np.asarray(mesh.uv) * [width, -height] + [-0.5, height - 0.5]
