"""Normal maps as slopes, in which wrinkles may be added.

A normal (x, y, z) in tangent space leans by x/z along u and y/z along v: the slopes of the surface, the gradient of the
relief downhill. The gradient of a sum of reliefs is the sum of their gradients, so shapes add their slopes by weight
("partial derivative" blending; Barré-Brisebois and Hill, "Blending in Detail", 2012).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.data import Rig
from blendcap.rendering.parallel import each_band

ROWS = 128  # that one thread blends at a time
OUTWARD = 1 / np.maximum(np.arange(256.0) - 128, 1)  # one over the third component of each byte


def blended_slopes(rig: Rig, weights: np.ndarray) -> np.ndarray | None:
    """The slopes (H, W, 2) float32 of a rig under weights (N,): s = s_0 + sum_i w_i s_i; None if it has no normal map.

    s_0 are the slopes of the mesh's own normal map, 0 if it has none, and s_i those of the map of shape i.
    """
    neutral = rig.mesh.normal_map
    if neutral is None and not rig.normal_maps:
        return None
    parts = [] if neutral is None else [(neutral, 1.0)]
    parts += [(part, float(weights[rig.index(name)])) for name, part in rig.normal_maps.items()]
    slopes = np.zeros((*parts[0][0].shape[:2], 2), dtype=np.float32)
    for part, weight in parts:
        if weight != 0:
            each_band(len(slopes), ROWS, lambda top, stop, p=part, w=weight: _add(slopes[top:stop], p[top:stop], w))
    return slopes


def slopes_of(normal_map: np.ndarray) -> np.ndarray:
    """The slopes (H, W, 2) float32 along u and v of a normal map (H, W, 3) uint8."""
    slopes = np.zeros((*normal_map.shape[:2], 2), dtype=np.float32)
    _add(slopes, normal_map, 1.0)
    return slopes


def normal_map_of(slopes: np.ndarray) -> np.ndarray:
    """The normal map (H, W, 3) uint8 of slopes (H, W, 2) along u and v (upwards), rounded to bytes."""
    normals = np.concatenate([slopes, np.ones_like(slopes[..., :1])], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.clip(np.round(128 + 127 * normals), 1, 255).astype(np.uint8)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(slopes, normal_map, weight):
    """Add `weight` times the slopes of a normal map."""
    for row in range(slopes.shape[0]):
        for column in range(slopes.shape[1]):
            outward = weight * OUTWARD[normal_map[row, column, 2]]
            slopes[row, column, 0] += (int(normal_map[row, column, 0]) - 128) * outward
            slopes[row, column, 1] += (int(normal_map[row, column, 1]) - 128) * outward


@njit(cache=True, nogil=True, error_model="numpy")
def halved(slopes):
    """Each four texels of slopes (H, W, 2) as their mean."""
    height, width = slopes.shape[0] // 2, slopes.shape[1] // 2
    half = np.empty((height, width, 2), dtype=np.float32)
    for row in range(height):
        for column in range(width):
            for axis in range(2):
                above = slopes[2 * row, 2 * column, axis] + slopes[2 * row, 2 * column + 1, axis]
                below = slopes[2 * row + 1, 2 * column, axis] + slopes[2 * row + 1, 2 * column + 1, axis]
                half[row, column, axis] = np.float32(0.25) * (above + below)
    return half
