"""The closest points of a surface, exact on its triangles."""

from __future__ import annotations

import numpy as np


class Closest:
    """A mesh made ready for closest-point queries (libigl's AABB tree).

    Parameters
    ----------
    vertices : (V, 3)
    faces : (F, 3)
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        import igl

        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self._tree = igl.AABB()
        self._tree.init(self.vertices, self.faces)

    def __call__(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Squared distances (P,), faces (P,) and closest points (P, 3) of places (P, 3)."""
        places = np.ascontiguousarray(places, dtype=np.float64)
        squared, faces, points = self._tree.squared_distance(self.vertices, self.faces, places)
        return np.asarray(squared).ravel(), np.asarray(faces).ravel(), np.asarray(points)
