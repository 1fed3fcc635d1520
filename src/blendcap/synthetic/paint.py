"""Paint on the skin: strokes and dots are drawn by their distance in space, so that the seams of a texture do not cut
them, and kept in uv, so that they move with the skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from blendcap.data import InputError, Rig, landmarks68
from blendcap.data.anatomy import clear_vertices
from blendcap.numerics.barycentric import barycentric_flat
from blendcap.numerics.geodesic import weld
from blendcap.numerics.surfaces import parts
from blendcap.rendering import vertex_normals
from blendcap.rendering.rasterize import visibility

TEXELS = 2048  # of a side of the paint
SPACING = 0.2  # between the points that stand for a stroke, mm
SOFT = 0.35  # width of a stroke's edge, mm
ASTRAY = 10.0  # mm from the nearest vertex: paint for another face
FACING = 0.2  # cosine between the skin under the brush and skin that it may reach: not the other side of a lid


@dataclass(frozen=True, eq=False)
class Stroke:
    """A line of paint on the skin of the neutral face; a dot is a stroke of one point.

    Parameters
    ----------
    name : str
    points : (K, 3) float64
        On the surface, mm.
    radii : (K,) float64
        Half the width at each point, mm.
    """

    name: str
    points: np.ndarray
    radii: np.ndarray


def drawn_faces(rig: Rig) -> np.ndarray:
    """(F,) bool: all but lashes and the clear layers over the eyes, which a picture without transparency leaves out."""
    return np.asarray(~clear_vertices(rig)[rig.mesh.faces].any(1))


def skin_faces(rig: Rig) -> np.ndarray:
    """(F,) bool: the connected piece of surface that carries the landmarks, not eyeballs, teeth or lashes.

    Of a texture that spans several tiles only the first is painted.

    Raises
    ------
    InputError
        If the rig has no points "landmarks68".
    """
    faces = weld(rig.mesh.faces, rig.mesh.vertices, rig.deltas)
    piece = parts(faces, len(rig.mesh.vertices))[faces[:, 0]]
    skin = drawn_faces(rig) & (piece == np.bincount(piece[landmarks68(rig).faces]).argmax())
    if rig.mesh.uv is not None and rig.mesh.uv_faces is not None:
        first = np.asarray(((rig.mesh.uv >= 0) & (rig.mesh.uv <= 1)).all(1))
        skin = skin & first[rig.mesh.uv_faces].all(1)
    return skin


def paint(rig: Rig, layers: list[list[Stroke]], clear: float = 1.2) -> tuple[np.ndarray, np.ndarray]:
    """How much of each place in uv is covered, (TEXELS, TEXELS) uint8, 255 for all, and the faces that may wear paint.

    Parameters
    ----------
    rig : Rig
        Its neutral is the face that holds still for the brush.
    layers : list of lists of Stroke
        An earlier layer keeps `clear` mm of bare skin around it: dots first, then strokes that leave them out.

    Raises
    ------
    InputError
        If the rig has no texture coordinates or no landmarks.
    """
    mesh = rig.mesh
    if mesh.uv is None or mesh.uv_faces is None:
        raise InputError(f"The rig {rig.name!r} has no texture coordinates (uv), so nothing can be painted on it.")
    strokes = [stroke for layer in layers for stroke in layer]
    cover = np.zeros((TEXELS, TEXELS), dtype=np.uint8)
    painted = np.zeros(len(mesh.faces), dtype=bool)
    if not strokes:
        return cover, painted
    skin = np.flatnonzero(skin_faces(rig))
    _check(strokes, mesh.vertices[np.unique(mesh.faces[skin])], rig.name)
    reach = max(stroke.radii.max() for stroke in strokes) + clear + SOFT
    near = _near(mesh.vertices, mesh.faces[skin], np.concatenate([s.points for s in strokes]), reach)
    painted[skin[near]] = True
    rows, columns, place, normal = _texels(rig, skin[near])
    bare = np.ones(len(rows))
    total = np.zeros(len(rows))
    for layer in filter(None, layers):
        inside = _depth(layer, rig, place, normal, reach)  # mm inside the paint's edge
        total = np.maximum(total, bare * np.clip(inside / SOFT + 0.5, 0, 1))
        bare *= np.clip(-(inside + clear) / SOFT + 0.5, 0, 1)
    cover[rows, columns] = np.round(255 * total)
    return _bled(cover, rows, columns), painted


def _check(strokes: list[Stroke], skin: np.ndarray, name: str) -> None:
    """Strokes that were drawn on another face do not lie on this one."""
    tree = KDTree(skin)
    for stroke in strokes:
        distance = float(np.median(tree.query(stroke.points)[0]))
        if distance > ASTRAY:
            raise InputError(
                f"The stroke {stroke.name!r} lies {distance:.0f} mm from the skin of {name!r}; "
                "draw it on this performer."
            )


def _near(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, reach: float) -> np.ndarray:
    """Faces (K,) that may come within `reach` of a point."""
    corners = vertices[faces]
    middle = corners.mean(1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(1)
    distance = KDTree(points).query(middle)[0]
    return np.flatnonzero(distance < radius + reach)


def _texels(rig: Rig, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns, places (K, 3) and normals (K, 3) in the neutral of the texels of some faces."""
    mesh = rig.mesh
    assert mesh.uv is not None and mesh.uv_faces is not None
    pixels = mesh.uv * [TEXELS, -TEXELS] + [-0.5, TEXELS - 0.5]
    flat = np.column_stack([pixels, np.ones(len(pixels))])  # at distance 1, pixels are coordinates
    corners = np.ascontiguousarray(mesh.uv_faces[faces])
    seen = visibility(flat, corners, (TEXELS, TEXELS))[0]
    rows, columns = np.nonzero(seen >= 0)
    found = seen[rows, columns]
    weights = barycentric_flat(np.column_stack([columns, rows]).astype(np.float64), pixels[corners[found]])
    vertices = mesh.faces[faces][found]
    normals = vertex_normals(mesh.vertices, mesh.faces)
    place = np.einsum("kc,kcd->kd", weights, mesh.vertices[vertices])
    normal = np.einsum("kc,kcd->kd", weights, normals[vertices])
    return rows, columns, place, normal


def _depth(layer: list[Stroke], rig: Rig, place: np.ndarray, normal: np.ndarray, reach: float) -> np.ndarray:
    """How far inside the nearest edge of a layer's paint each place lies, mm; negative outside."""
    points = np.concatenate([_dense(s)[0] for s in layer])
    radii = np.concatenate([_dense(s)[1] for s in layer])
    normals = vertex_normals(rig.mesh.vertices, rig.mesh.faces)
    skin = np.unique(rig.mesh.faces[skin_faces(rig)])
    under = normals[skin[KDTree(rig.mesh.vertices[skin]).query(points)[1]]]
    distance, nearest = KDTree(points).query(place, distance_upper_bound=reach)
    nearest = np.minimum(nearest, len(points) - 1)  # where nothing is near, the distance is infinite
    inside = radii[nearest] - distance
    facing = np.einsum("kd,kd->k", normal, under[nearest]) > FACING
    return np.where(facing, inside, -np.inf)


def _dense(stroke: Stroke) -> tuple[np.ndarray, np.ndarray]:
    """The stroke's points and radii, `SPACING` apart."""
    if len(stroke.points) == 1:
        return stroke.points, stroke.radii
    steps = np.linalg.norm(np.diff(stroke.points, axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(steps)])
    at = np.linspace(0, along[-1], max(2, int(along[-1] / SPACING) + 1))
    points = np.column_stack([np.interp(at, along, stroke.points[:, d]) for d in range(3)])
    return points, np.interp(at, along, stroke.radii)


def _bled(cover: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Paint that runs two texels over the border of its chart, so that a look-up at the border finds paint."""
    import cv2

    inside = np.zeros(cover.shape, dtype=bool)
    inside[rows, columns] = True
    for _ in range(2):
        cover = np.where(inside, cover, cv2.dilate(cover, np.ones((3, 3), dtype=np.uint8)))
    return cover
