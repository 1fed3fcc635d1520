"""Where on a scan each vertex of a template would go: the closest point, and whether to believe it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from blendcap.numerics.closest import Closest
from blendcap.numerics.surfaces import border_vertices, vertex_normals


class ScanSurface:
    """A scan made ready for closest-point queries, exact on its triangles.

    Parameters
    ----------
    vertices : (S, 3) float64
    faces : (T, 3) int64

    Attributes
    ----------
    vertices : (S, 3) float64
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self._closest = Closest(vertices, faces)
        self.vertices, self._faces = self._closest.vertices, self._closest.faces
        self._normals = vertex_normals(self.vertices, self._faces)
        on_border = border_vertices(self._faces, len(self.vertices))
        self._border = np.asarray(on_border[self._faces].any(1))

    def closest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The closest points (n, 3) to places (n, 3), their distances (n,) and the triangles (n,) they lie on."""
        squared, faces, points = self._closest(places)
        return points, np.sqrt(squared), faces

    def nearest_vertices(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `closest`, but among the scan's vertices only, as the paper does; the triangle is one of the vertex's."""
        if not hasattr(self, "_points"):
            self._points = KDTree(self.vertices)
            self._first = np.zeros(len(self.vertices), dtype=np.int64)
            self._first[self._faces.ravel()] = np.repeat(np.arange(len(self._faces)), 3)
        distance, rows = self._points.query(places)
        return self.vertices[rows], distance, self._first[rows]

    def believable(
        self, faces: np.ndarray, distance: np.ndarray, normals: np.ndarray, cosine: float, reach: float
    ) -> np.ndarray:
        """(n,) whether a match on these triangles is within reach, faces the same way, and is not on a border.

        Parameters
        ----------
        faces, distance : (n,)
            As `closest` gives them.
        normals : (n, 3)
            Of the template's vertices.
        cosine : float
            The least cosine between the two normals.
        reach : float
            The largest distance.
        """
        there = self._normals[self._faces[faces]].mean(1)
        there /= np.maximum(np.linalg.norm(there, axis=1, keepdims=True), 1e-300)
        return ((there * normals).sum(1) > cosine) & ~self._border[faces] & (distance < reach)
