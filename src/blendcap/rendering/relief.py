"""Where u and v run on a surface, and the slopes that bend its normals along them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from blendcap.data import Mesh
from blendcap.rendering.slopes import halved, slopes_of
from blendcap.rendering.texture import level_for


@dataclass(frozen=True, eq=False)
class Tangents:
    """The direction of u on a surface, as glTF has it: mean over the faces round a corner, one sign for each face.

    With the unit normal n, the direction t of u is made perpendicular to n and of unit length; v runs along
    sign * (n x t).

    Parameters
    ----------
    directions : (K, 3)
        Of u, of any length.
    faces : (F, 3)
        Rows of `directions` at the corners of the triangles.
    signs : (F,)
        -1 where the chart shows the surface mirrored.
    """

    directions: np.ndarray
    faces: np.ndarray
    signs: np.ndarray


@dataclass(frozen=True, eq=False)
class Relief:
    """Slopes on a surface.

    Parameters
    ----------
    slopes : (H, W, 2) float32
        Along u and v (see `slopes`), row 0 on top.
    uv : (U, 2)
    uv_faces : (F, 3)
    tangents : Tangents
    """

    slopes: np.ndarray
    uv: np.ndarray
    uv_faces: np.ndarray
    tangents: Tangents

    def posed(self, vertices: np.ndarray, faces: np.ndarray) -> Relief:
        """The same relief on the surface with vertices (V, 3)."""
        if not len(self.uv_faces):
            return self
        directions = np.zeros_like(self.tangents.directions)
        _sum_directions(vertices, faces, self.uv, self.uv_faces, self.tangents.faces, directions)
        return replace(self, tangents=replace(self.tangents, directions=directions))

    def at(self, corners: np.ndarray, faces: np.ndarray):
        """What the kernels need for a picture in which the vertices lie at homogeneous pixels `corners` (V, 3)."""
        slopes = self.slopes
        if len(self.uv_faces):
            for _ in range(level_for(corners, faces, self.uv, self.uv_faces, slopes.shape)):
                slopes = halved(slopes)
        tangents = self.tangents
        return slopes, self.uv, self.uv_faces, tangents.directions, tangents.faces, tangents.signs


FLAT = Relief(
    np.zeros((1, 1, 2), dtype=np.float32),
    np.zeros((1, 2)),
    np.zeros((0, 3), dtype=np.int64),
    Tangents(np.zeros((1, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros(0)),
)


def relief_of(mesh: Mesh, keep, slopes: np.ndarray | None = None) -> Relief:
    """The relief of the mesh's normal map, or of other slopes, on the faces to `keep`; `FLAT` if there are neither."""
    if slopes is None and mesh.normal_map is not None:
        slopes = slopes_of(mesh.normal_map)
    if slopes is None or mesh.uv is None or mesh.uv_faces is None:
        return FLAT
    faces, uv_faces = np.ascontiguousarray(mesh.faces[keep]), np.ascontiguousarray(mesh.uv_faces[keep])
    relief = Relief(slopes, mesh.uv, uv_faces, _laid_out(faces, mesh.uv, uv_faces))
    return relief.posed(mesh.vertices, faces)


def tangents_of(mesh: Mesh) -> Tangents:
    """The directions of u on a mesh with uv: in this frame its normal map is read, and has to be baked."""
    return relief_of(mesh, slice(None), FLAT.slopes).tangents


def _laid_out(faces: np.ndarray, uv: np.ndarray, uv_faces: np.ndarray) -> Tangents:
    """A row for each vertex with its place and side of the chart; the directions are yet to come."""
    (ax, ay), (bx, by) = (uv[uv_faces[:, k]].T - uv[uv_faces[:, 0]].T for k in (1, 2))
    signs = np.where(ax * by - ay * bx < 0, -1.0, 1.0)
    key = 2 * (faces * (len(uv) + 1) + uv_faces) + (signs[:, None] < 0)
    unique, rows = np.unique(key, return_inverse=True)
    return Tangents(np.zeros((len(unique), 3)), np.ascontiguousarray(rows.reshape(-1, 3)), signs)


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_directions(vertices, faces, uv, uv_faces, rows, directions):
    """Add to each corner the direction of u on its face, in the weight of the face's area."""
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        p, q, r = uv_faces[f, 0], uv_faces[f, 1], uv_faces[f, 2]
        au, av, bu, bv = uv[q, 0] - uv[p, 0], uv[q, 1] - uv[p, 1], uv[r, 0] - uv[p, 0], uv[r, 1] - uv[p, 1]
        side = np.sign(au * bv - av * bu)
        a, b = vertices[j] - vertices[i], vertices[k] - vertices[i]
        along = side * (bv * a - av * b)
        length = np.sqrt(along @ along)
        if length > 0:
            normal = np.cross(a, b)
            along *= np.sqrt(normal @ normal) / length
            for corner in range(3):
                for axis in range(3):
                    directions[rows[f, corner], axis] += along[axis]
