"""A surface: vertices, triangles to compute with, polygons to write back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blendcap.data import checks
from blendcap.data.errors import InputError


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    Parameters
    ----------
    vertices : (V, 3) float64
        Positions, mm.
    faces : (F, 3) int64
        Triangles, counter-clockwise seen from outside.
    polygons : (P, K) int64, optional
        The polygons that `faces` triangulates (see `triangulate`); shorter ones are padded with -1.
    uv : (U, 2) float64, optional
        Texture coordinates, v up.
    uv_faces : (F, 3) int64, optional
        Rows of `uv` at the corners of the triangles; needed only where a seam gives a vertex several.
    texture : (H, W, C) uint8, optional
        Colour, row 0 on top.
    normal_map : (H, W, 3) uint8, optional
        Normals in tangent space, row 0 on top: x along u, y along v upwards (as OpenGL and glTF have it), z out of the
        surface; 128 is 0, so (128, 128, 255) is flat.

    Raises
    ------
    InputError
        If a shape or an index is wrong, or a vertex is not finite.
    """

    vertices: np.ndarray
    faces: np.ndarray
    polygons: np.ndarray | None = None
    uv: np.ndarray | None = None
    uv_faces: np.ndarray | None = None
    texture: np.ndarray | None = None
    normal_map: np.ndarray | None = None

    def __post_init__(self):
        put = object.__setattr__
        put(self, "vertices", checks.array(self.vertices, (checks.ANY, 3), "The mesh's vertices", finite=True))
        count = len(self.vertices)
        put(self, "faces", checks.indices(self.faces, count, (checks.ANY, 3), "The mesh's faces", "vertex"))
        if self.polygons is not None:
            put(self, "polygons", _polygons(self.polygons, count, len(self.faces)))
        if self.uv is not None:
            put(self, "uv", checks.array(self.uv, (checks.ANY, 2), "The mesh's uv", finite=True))
        put(self, "uv_faces", self._checked_uv_faces())
        if self.texture is not None:
            shape = (checks.ANY, checks.ANY, checks.ANY)
            put(self, "texture", checks.array(self.texture, shape, "The mesh's texture", dtype=np.uint8))
        if self.normal_map is not None:
            put(self, "normal_map", checks.normal_map(self.normal_map, "The mesh's normal map"))

    def _checked_uv_faces(self) -> np.ndarray | None:
        if self.uv is None:
            if self.uv_faces is not None:
                raise InputError("The mesh has uv_faces but no uv; give both or neither.")
            return None
        if self.uv_faces is None:
            if len(self.uv) != len(self.vertices):
                raise InputError(
                    f"The mesh has {len(self.uv)} uv rows for {len(self.vertices)} vertices; "
                    "give uv_faces to say which corner uses which row."
                )
            return self.faces
        shape = (len(self.faces), 3)
        return checks.indices(self.uv_faces, len(self.uv), shape, "The mesh's uv_faces", "uv row")

    def with_vertices(self, vertices: np.ndarray) -> Mesh:
        """The same mesh with other positions (V, 3), mm."""
        return replace(self, vertices=vertices)


def triangulate(polygons: np.ndarray) -> np.ndarray:
    """Triangles (F, 3) of polygons (P, K) padded with -1: the fan around each polygon's first corner, in order."""
    polygons = np.asarray(polygons)
    fans = [np.stack([polygons[:, 0], polygons[:, k - 1], polygons[:, k]], 1) for k in range(2, polygons.shape[1])]
    triangles = np.stack(fans, 1).reshape(-1, 3)
    return np.ascontiguousarray(triangles[triangles[:, 2] >= 0], dtype=np.int64)


def _polygons(values, vertices: int, faces: int) -> np.ndarray:
    result = checks.array(values, (checks.ANY, checks.ANY), "The mesh's polygons", dtype=np.int64)
    corners = (result >= 0).sum(1)
    if result.size and (result.max() >= vertices or result.min() < -1 or (corners < 3).any()):
        raise InputError(f"The mesh's polygons need 3 or more corners, each one of its {vertices} vertices (-1 pads).")
    made = int((corners - 2).sum())
    if made != faces:
        raise InputError(f"The mesh's polygons make {made} triangles, but it has {faces} faces; use triangulate().")
    return result
