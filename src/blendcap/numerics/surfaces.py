"""Small facts about triangle meshes: edges, borders, normals, parts."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy import sparse
from scipy.sparse.csgraph import connected_components


def edges_of(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2), smaller vertex first, and how many triangles use each, (E,)."""
    faces = np.asarray(faces)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    span = ends.max(initial=0) + 1
    keys, count = np.unique(ends.min(1) * span + ends.max(1), return_counts=True)
    return np.stack([keys // span, keys % span], axis=1), count


def border_vertices(faces: np.ndarray, vertices: int) -> np.ndarray:
    """(V,) bool: on an edge that only one triangle uses."""
    edges, count = edges_of(faces)
    result = np.zeros(vertices, dtype=bool)
    result[edges[count == 1]] = True
    return result


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F, 3) normals as long as twice the triangle's area; zero for a degenerate one."""
    first, second, third = (vertices[faces[:, k]] for k in range(3))
    return np.cross(second - first, third - first)


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


def parts(faces: np.ndarray, vertices: int) -> np.ndarray:
    """(V,) number of the connected part that each vertex belongs to; a vertex of no triangle is a part by itself."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = sparse.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(vertices, vertices))
    return connected_components(graph, directed=False)[1]


def turned_over(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F,) bool: triangles that face against the surface around them: folded over."""
    around = vertex_normals(vertices, faces)[faces].sum(1)
    return (face_normals(vertices, faces) * around).sum(1) < 0
