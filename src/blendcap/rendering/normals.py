"""Normals of a surface."""

from __future__ import annotations

import numpy as np
from numba import njit


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3) at the vertices: the sum of the faces' normals, weighted with their area.

    A vertex that no face uses, or whose faces have no area, has the normal (0, 0, 0).
    """
    vertices = np.ascontiguousarray(vertices, dtype=np.float64)
    return _vertex_normals(vertices, np.ascontiguousarray(faces, dtype=np.int64))


@njit(cache=True, nogil=True, error_model="numpy")
def _vertex_normals(vertices, faces):
    normals = np.zeros_like(vertices)
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        ax, ay, az = vertices[j, 0] - x, vertices[j, 1] - y, vertices[j, 2] - z
        bx, by, bz = vertices[k, 0] - x, vertices[k, 1] - y, vertices[k, 2] - z
        normal = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
        for corner in (i, j, k):
            for d in range(3):
                normals[corner, d] += normal[d]
    for v in range(len(normals)):
        x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0:
            for d in range(3):
                normals[v, d] /= length
    return normals
