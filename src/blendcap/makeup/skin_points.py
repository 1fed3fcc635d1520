"""Which points of the skin a head camera can follow: where the neutral picture has contrast, on paint above all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from blendcap.data import Binding, Camera, Rig
from blendcap.data.anatomy import inside_vertices
from blendcap.makeup.matching import REACH, Windows
from blendcap.modeling.rays import RayTarget
from blendcap.rendering import sight_lines, vertex_normals

SPACING = 8  # pixels between two points
MOST = 300  # points in one picture
CLEAR = 4.0  # times the contrast of plain skin: the least at a point
SURE = 32.0  # times the contrast of plain skin: along a direction with so much, squared errors count half
FACING = 0.35  # cosine between skin and camera: more aslant nothing is followed
ALIKE = 2.0  # mm: what a shape moves by so much more or less than the middle of a window is not of it


class SkinPoints(NamedTuple):
    """Points of the neutral skin that one camera can follow."""

    pixels: np.ndarray  # (K, 2)
    faces: np.ndarray  # (K,) triangles of the rig
    barycentric: np.ndarray  # (K, 3)
    rest: np.ndarray  # (K, 3) where the lines of sight meet the neutral skin, mm, in the take's space
    axes: np.ndarray  # (K, 2, 2) directions in the picture, the best seen first, each as long as it is sure, 0 to 1
    windows: Windows

    def of(self, rows: np.ndarray) -> SkinPoints:
        """The chosen points."""
        pixels, faces, barycentric, rest, axes = (part[rows] for part in self[:-1])
        return SkinPoints(pixels, faces, barycentric, rest, axes, self.windows.of(rows))


def skin_points(picture: np.ndarray, rig: Rig, binding: Binding, camera: Camera) -> SkinPoints:
    """The points of a neutral picture (H, W) float32 that can be followed, the clearest first, `SPACING` apart.

    How surely motion is told along a direction is the structure tensor's eigenvalue (Shi and Tomasi 1994,
    doi:10.1109/CVPR.1994.323794) against that of plain skin: along the edge of a stroke all places look alike. Of the
    window around a point only what the rig moves as it moves the point counts: beside a lid lies the eye, and a brow.
    """
    skin = _SeenSkin(rig, binding, camera)
    contrast = _contrast(picture)
    grid = np.argwhere(contrast > 0)[:, ::-1]
    grid = grid[(grid % SPACING == 0).all(1)]
    grid = grid[skin.under(grid)[0] >= 0]
    plain = float(np.median(Windows.cut(picture, grid).values[:, 0])) if len(grid) else 0.0
    usual = float(np.median(contrast[tuple(grid.T[::-1])])) if len(grid) else 0.0
    clear = np.argwhere(contrast > CLEAR * usual)[:, ::-1]
    clear = clear[np.argsort(-contrast[tuple(clear.T[::-1])], kind="stable")]
    faces, barycentric, places = skin.under(clear)
    kept = _spaced(clear, faces >= 0, picture.shape)
    windows = Windows.cut(picture, clear[kept], skin.moving_alike(clear[kept], faces[kept], barycentric[kept]))
    enough = windows.values[:, 0] > CLEAR * plain  # on what counts alone: the eye beside a lid has contrast, too
    windows, kept = windows.of(enough), kept[enough]
    sure = np.sqrt(windows.values / (windows.values + SURE * plain))
    axes = sure[..., None] * windows.directions
    return SkinPoints(clear[kept].astype(np.float64), faces[kept], barycentric[kept], places[kept], axes, windows)


class _SeenSkin:
    """The neutral face before a camera: what lies under its pixels."""

    def __init__(self, rig: Rig, binding: Binding, camera: Camera):
        self.vertices, self.faces, self.camera = binding.to_take(rig.mesh.vertices), rig.mesh.faces, camera
        self.target = RayTarget(self.vertices, self.faces)
        self.normals = vertex_normals(self.vertices, self.faces)
        moving = np.zeros(len(self.vertices), dtype=bool)
        moving[rig.moving_vertices()] = True
        skin = np.logical_and(moving, ~inside_vertices(rig))
        self.skin = np.all(skin[self.faces], axis=1)
        self.deltas = rig.deltas

    def under(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Triangles (P,), -1 for none and for what is no skin or seen aslant, barycentric and places (P, 3)."""
        ways = sight_lines(pixels.astype(np.float64), self.camera)
        faces, distances, barycentric = self.target.first(np.tile(self.camera.position, (len(ways), 1)), ways)
        normals = np.einsum("kc,kcd->kd", barycentric, self.normals[self.faces[faces]])
        facing = -(normals * ways).sum(1) > FACING * np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
        good = (faces >= 0) & self.skin[faces] & facing
        places = self.camera.position + ways * np.where(good, distances, 0.0)[:, None]
        return np.where(good, faces, -1), barycentric, places

    def moving_alike(self, middles: np.ndarray, faces: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """(K, n, n) bool: which pixels of the windows around pixels (K, 2) show skin that moves as their middles do."""
        arms = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1][::-1].transpose(1, 2, 0)
        around, corners, _ = self.under((middles[:, None, None] + arms).reshape(-1, 2))
        own = _nearest(self.faces, faces, barycentric)
        theirs = _nearest(self.faces, around, corners).reshape(len(middles), *arms.shape[:2])
        alike = (around >= 0).reshape(theirs.shape)
        for deltas in self.deltas:  # a shape at a time: all at once would take much memory
            alike &= np.linalg.norm(deltas[theirs] - deltas[own][:, None, None], axis=-1) < ALIKE
        return alike


def _nearest(faces: np.ndarray, corners: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """The vertices nearest to places in triangles."""
    return faces[corners, barycentric.argmax(-1)]


def _contrast(picture: np.ndarray) -> np.ndarray:
    """(H, W) the larger eigenvalue of the structure tensor; 0 where a window would not be in the picture."""
    import cv2

    values = cv2.cornerEigenValsAndVecs(picture, 2 * REACH + 1, 3)[..., :2].max(-1)
    inside = np.zeros(picture.shape, dtype=bool)
    inside[REACH + 1 : -REACH - 2, REACH + 1 : -REACH - 2] = True
    return np.where(inside, values, 0.0)


def _spaced(pixels: np.ndarray, good: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Rows of good pixels (P, 2), each `SPACING` from those before it, `MOST` at most."""
    import cv2

    taken, kept = np.zeros(shape, dtype=np.uint8), []
    for row in np.flatnonzero(good):
        x, y = int(pixels[row, 0]), int(pixels[row, 1])
        if not taken[y, x]:
            kept.append(row)
            cv2.circle(taken, (x, y), SPACING, 1, -1)
            if len(kept) == MOST:
                break
    return np.array(kept, dtype=np.int64)
