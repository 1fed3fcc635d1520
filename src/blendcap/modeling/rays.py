"""Where rays meet a surface, by Embree."""

from __future__ import annotations

import numpy as np

CHUNK = 1 << 18  # rays at a time


class RayTarget:
    """A surface made ready for rays.

    Parameters
    ----------
    vertices : (V, 3)
    faces : (F, 3)
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        self._middle = (vertices.min(0) + vertices.max(0)) / 2  # Embree counts in single precision
        self._corners = vertices[faces] - self._middle
        self._scene = rtcore_scene.EmbreeScene()  # pyright: ignore[reportAttributeAccessIssue]
        TriangleMesh(self._scene, np.ascontiguousarray(self._corners, dtype=np.float32))

    def first(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The first hits of rays from (P, 3) along unit vectors (P, 3).

        Returns
        -------
        faces : (P,)
            -1 for none.
        distances : (P,)
            Infinite for none; in double precision, from the plane of the triangle.
        barycentric : (P, 3)
        """
        faces = np.empty(len(origins), dtype=np.int64)
        for start in range(0, len(origins), CHUNK):
            part = slice(start, start + CHUNK)
            from_here = np.ascontiguousarray(origins[part] - self._middle, dtype=np.float32)
            towards = np.ascontiguousarray(directions[part], dtype=np.float32)
            faces[part] = self._scene.run(from_here, towards)
        hit = faces >= 0
        distances, barycentric = np.full(len(faces), np.inf), np.zeros((len(faces), 3))
        distances[hit], barycentric[hit] = _meet(
            self._corners[faces[hit]], origins[hit] - self._middle, directions[hit]
        )
        return faces, distances, barycentric


def _meet(corners: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance and barycentric coordinates at which lines meet triangles (Möller and Trumbore 1997)."""
    a, b, off = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], origins - corners[:, 0]
    across, turned = np.cross(directions, b), np.cross(off, a)
    volume = (a * across).sum(1)
    volume = np.where(np.abs(volume) > 0, volume, np.inf)
    v, w = (off * across).sum(1) / volume, (directions * turned).sum(1) / volume
    weights = np.clip(np.stack([1 - v - w, v, w], 1), 0, 1)
    return (b * turned).sum(1) / volume, weights / weights.sum(1, keepdims=True)
