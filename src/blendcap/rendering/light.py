"""What a light sees: shadow of the key light and openness to the sky, both from depth maps."""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.data import Camera
from blendcap.rendering.camera import look_at, to_homogeneous
from blendcap.rendering.parallel import each_band
from blendcap.rendering.rasterize import fill, line_up, visibility

SKY_DIRECTIONS = 20
SKY_PIXELS = 112
FAR = 12.0  # distance of a light, in radii of the mesh
REACH = (FAR - 1) / 1.06  # focal length of a light that frames the mesh, in half pictures
FOCAL = (SKY_PIXELS / 2 - 2) * REACH


def light_camera(bounds: tuple[np.ndarray, np.ndarray], direction: np.ndarray, pixels: int) -> Camera:
    """The camera that looks along a light from `direction` (3,) and frames a box, lowest and highest corner, mm.

    Centre and radius are rounded, so that the depth maps of an animated face do not crawl.
    """
    low, high = bounds
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-3)
    radius = 1.1 ** np.ceil(np.log(radius) / np.log(1.1))
    center = np.round((low + high) / (0.1 * radius)) * 0.05 * radius
    focal = (pixels / 2 - 2) * REACH
    intrinsics = np.array([[focal, 0, (pixels - 1) / 2], [0, focal, (pixels - 1) / 2], [0, 0, 1.0]])
    return Camera(intrinsics, look_at(center + FAR * radius * np.asarray(direction), center))


def box(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner of a mesh, mm."""
    columns = np.ascontiguousarray(vertices.T)  # NumPy is slow along rows of three
    return columns.min(1), columns.max(1)


def shadow_map(vertices: np.ndarray, faces: np.ndarray, camera: Camera, pixels: int) -> np.ndarray:
    """One over the distance (pixels, pixels) of what the light reaches first; 0 where it meets nothing."""
    return visibility(to_homogeneous(vertices, camera), faces, (pixels, pixels))[1]


def openness(vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """How much of the sky above its tangent plane each vertex sees, (V,), 0 to 1: ambient occlusion."""
    directions, bounds = _sky(), box(vertices)
    seen, total = np.zeros((2, len(directions), len(vertices)))

    def look(start: int, stop: int) -> None:
        for d in range(start, stop):
            camera = light_camera(bounds, directions[d], SKY_PIXELS)
            projection = camera.intrinsics @ camera.pose[:3]
            _look(vertices, normals, faces, projection, directions[d], seen[d], total[d])

    each_band(len(directions), 1, look)
    weight = total.sum(0)
    return np.where(weight > 0, seen.sum(0) / np.where(weight > 0, weight, 1), 1)


def _sky() -> np.ndarray:
    """Directions (D, 3) spread evenly over the sphere without the part below the chin: a spiral of equal areas."""
    place = (np.arange(SKY_DIRECTIONS) + 0.5) / SKY_DIRECTIONS
    height = 1 - 1.7 * place
    turn = np.pi * (1 + 5**0.5) * np.arange(SKY_DIRECTIONS)
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), height, across * np.sin(turn)], 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _look(vertices, normals, faces, projection, direction, seen, total):
    """How squarely each vertex faces one piece of sky, `total`, and how much of that reaches it, `seen`."""
    corners = np.empty((len(vertices), 3))
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        for c in range(3):
            corners[v, c] = projection[c, 0] * x + projection[c, 1] * y + projection[c, 2] * z + projection[c, 3]
    face, nearness = np.empty((SKY_PIXELS, SKY_PIXELS), dtype=np.int32), np.empty((SKY_PIXELS, SKY_PIXELS))
    queue, fronts, backs = line_up(corners, faces, SKY_PIXELS, SKY_PIXELS)
    fill(corners, faces, queue, fronts, backs, 0, face, nearness)
    for v in range(len(vertices)):
        facing = normals[v, 0] * direction[0] + normals[v, 1] * direction[1] + normals[v, 2] * direction[2]
        if facing > 0:
            depth = corners[v, 2]
            total[v] = facing
            seen[v] = facing * _reached(corners[v, 0] / depth, corners[v, 1] / depth, depth, facing, nearness)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _reached(x, y, depth, facing, nearness):
    """The share of four texels of a depth map that lets light through."""
    slack = depth / FOCAL * (0.6 + 1.2 / max(facing, 0.25))
    column, row = int(np.floor(x)), int(np.floor(y))
    free = 0
    for r in range(max(row, 0), min(row + 2, SKY_PIXELS)):
        for c in range(max(column, 0), min(column + 2, SKY_PIXELS)):
            free += nearness[r, c] * (depth - slack) < 1
    return free / 4
