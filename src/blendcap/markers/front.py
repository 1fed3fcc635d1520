"""The front of a face as points with normals: where markers can be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from blendcap.data import InputError, Rig

# yaw and pitch, rad, of the pictures that tell the front of the skin from what lies inside and behind it
_VIEWS = ((0.0, 0.0), (0.8, 0.0), (-0.8, 0.0), (0.0, -0.5))
_SIZE = (384, 384)
_TURNED = -0.3  # cosine between a normal and +z from which on skin counts as the back
_MOVES = 0.5  # mm: what a shape must move to say where the face is


@dataclass(frozen=True, eq=False)
class Front:
    """Triangles of a rig that can be seen from the front.

    Parameters
    ----------
    faces : (K,) int64
    points, normals : (K, 3) float64
        Centers, mm, and outward directions of length 1.
    middle : (3,) float64
        The middle of what the shapes move, each shape counting once, mm.
    """

    faces: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    middle: np.ndarray

    @cached_property
    def tree(self):
        """Nearest-neighbor search over `points`."""
        from scipy.spatial import KDTree

        return KDTree(self.points)

    def thinned(self, step: int) -> Front:
        """Every `step`-th triangle, for a quick look."""
        return Front(self.faces[::step], self.points[::step], self.normals[::step], self.middle)


def front_of(rig: Rig) -> Front:
    """The front of the rig's neutral face.

    Raises
    ------
    InputError
        If no shape moves what can be seen from the front (+z).
    """
    from blendcap.rendering import face_camera, rasterize

    mesh, seen = rig.mesh, []
    for yaw, pitch in _VIEWS:
        camera = face_camera(mesh.vertices, _SIZE, yaw, pitch)
        seen.append(np.unique(rasterize(mesh.vertices, mesh.faces, camera, _SIZE).face))
    faces = np.unique(np.concatenate(seen)).astype(np.int64)
    faces = faces[faces >= 0]
    corners = mesh.vertices[mesh.faces[faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(area, 1e-12)[:, None]
    front = (area > 1e-9) & (normals[:, 2] > _TURNED)
    faces, points = faces[front], corners.mean(1)[front]
    return Front(faces, points, normals[front], _middle(rig, faces, points))


def _middle(rig: Rig, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The mean over shapes of the center of each shape's squared motion: the jaw counts no more than a brow."""
    corners, centers = rig.mesh.faces[faces], []
    for delta in rig.deltas:
        squared = np.einsum("vk,vk->v", delta, delta)[corners].mean(1)
        if len(squared) and squared.max() > _MOVES**2:
            centers.append(squared @ points / squared.sum())
    if not centers:
        raise InputError(f"No shape of the rig {rig.name!r} moves a surface that faces +z; turn the rig to the front.")
    return np.mean(centers, axis=0)
