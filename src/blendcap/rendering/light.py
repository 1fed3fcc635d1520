"""What a light sees: shadow of the key light and openness to the sky, both from depth maps."""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.data import Camera
from blendcap.rendering.camera import look_at, to_homogeneous
from blendcap.rendering.parallel import each_band
from blendcap.rendering.rasterize import fill, visibility

SKY_DIRECTIONS = 20
SKY_PIXELS = 112
FAR = 12.0  # distance of a light, in radii of the mesh


def light_camera(vertices: np.ndarray, direction: np.ndarray, pixels: int) -> Camera:
    """The camera that looks along a light from `direction` (3,) and frames the whole mesh in a square picture.

    Centre and radius are rounded, so that the depth maps of an animated face do not crawl.
    """
    low, high = vertices.min(0), vertices.max(0)
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-3)
    step = 1.1 ** np.ceil(np.log(radius) / np.log(1.1))
    center = np.round((low + high) / 2 / (0.05 * step)) * 0.05 * step
    reach = step * 1.06
    focal = (pixels / 2 - 1) * (FAR - 1) * step / reach
    intrinsics = np.array([[focal, 0, (pixels - 1) / 2], [0, focal, (pixels - 1) / 2], [0, 0, 1.0]])
    return Camera(intrinsics, look_at(center + FAR * step * np.asarray(direction), center))


def shadow_map(vertices: np.ndarray, faces: np.ndarray, camera: Camera, pixels: int) -> np.ndarray:
    """One over the distance (pixels, pixels) of what the light reaches first; 0 where it meets nothing."""
    return visibility(to_homogeneous(vertices, camera), faces, (pixels, pixels))[1]


def openness(vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """How much of the sky above its tangent plane each vertex sees, (V,), 0 to 1: ambient occlusion."""
    directions = _sky()
    cameras = [light_camera(vertices, direction, SKY_PIXELS) for direction in directions]
    seen = np.zeros((len(directions), len(vertices)))
    facing = np.maximum(directions @ normals.T, 0)

    def look(start: int, stop: int) -> None:
        for d in range(start, stop):
            corners = to_homogeneous(vertices, cameras[d])
            nearness = np.zeros((SKY_PIXELS, SKY_PIXELS))
            fill(corners, faces, 0, SKY_PIXELS, np.empty(nearness.shape, dtype=np.int32), nearness)
            texel = cameras[d].position @ cameras[d].position
            texel = np.sqrt(texel) / cameras[d].intrinsics[0, 0]
            _reached(corners, facing[d], nearness, texel, seen[d])

    each_band(len(directions), 1, look)
    total = facing.sum(0)
    return np.where(total > 0, (facing * seen).sum(0) / np.where(total > 0, total, 1), 1)


def _sky() -> np.ndarray:
    """Directions (D, 3) spread evenly over the sphere without the part below the chin: a spiral of equal areas."""
    place = (np.arange(SKY_DIRECTIONS) + 0.5) / SKY_DIRECTIONS
    height = 1 - 1.7 * place
    turn = np.pi * (1 + 5**0.5) * np.arange(SKY_DIRECTIONS)
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), height, across * np.sin(turn)], 1)


@njit(cache=True, nogil=True)
def _reached(corners, facing, nearness, texel, out):
    """The share of four texels of a depth map that lets light through to each vertex."""
    pixels = len(nearness)
    for v in range(len(corners)):
        if facing[v] <= 0:
            continue
        depth = corners[v, 2]
        x, y = int(np.floor(corners[v, 0] / depth)), int(np.floor(corners[v, 1] / depth))
        slack = texel * (0.6 + 1.2 / max(facing[v], 0.25))
        free = 0
        for row in range(y, y + 2):
            for column in range(x, x + 2):
                outside = row < 0 or column < 0 or row >= pixels or column >= pixels
                free += outside or nearness[row, column] * (depth - slack) < 1
        out[v] = free / 4
