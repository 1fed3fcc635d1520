"""Small facts about triangle meshes: edges, borders, normals, parts."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components


def edges_of(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2), smaller vertex first, and how many triangles use each, (E,)."""
    faces = np.asarray(faces)
    corners = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, count = np.unique(corners, axis=0, return_counts=True)
    return edges, count


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
    """(V, 3) unit normals, the mean of the triangles around, weighted by area; zero where there are none."""
    normals = np.repeat(face_normals(vertices, faces), 3, axis=0)
    total = np.stack([np.bincount(faces.ravel(), normals[:, k], len(vertices)) for k in range(3)], axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def parts(faces: np.ndarray, vertices: int) -> np.ndarray:
    """(V,) number of the connected part that each vertex belongs to; a vertex of no triangle is a part by itself."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = sparse.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(vertices, vertices))
    return connected_components(graph, directed=False)[1]


def turned_over(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F,) bool: triangles that face against the surface around them: folded over."""
    around = vertex_normals(vertices, faces)[faces].sum(1)
    return (face_normals(vertices, faces) * around).sum(1) < 0
