"""A face as it looks from straight in front, always at the same size: brightness of its texture and its form.

The picture is the place where points of a scan are looked for when its texture has no layout that one knows.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from blendcap.data import Camera, Mesh, SurfacePoints
from blendcap.numerics.barycentric import barycentric_flat
from blendcap.rendering import Fragments, rasterize, vertex_normals
from blendcap.rendering.camera import look_at, project
from blendcap.rendering.texture import texture_of

SIZE = 320  # pixels, of a side
PIXEL = 0.6  # mm
MIDDLE = np.array([0.0, -25.0, 80.0])  # of the picture, on an average face whose pupils are at height 0, mm
DISTANCE = 4000.0  # of the camera, mm: nearly parallel rays
EDGE, GAP = 4, 5.0  # pixels, and mm: a step in depth this near and this large is the edge of a gap
LIGHT = np.array([0.0, 0.5, 0.85])  # on the form: from above, so that it tells up from down


@dataclass(frozen=True, eq=False)
class Frontal:
    """The picture and what each of its pixels sees.

    Parameters
    ----------
    image : (H, W, C) float32
        0 to 1: brightness of the texture, if there is one, and the form as if of clay. What is not seen takes the
        value of the nearest pixel that is.
    fragments : Fragments
    pixels : (V, 2)
        Where the vertices fall.
    """

    image: np.ndarray
    fragments: Fragments
    pixels: np.ndarray


def frontal(mesh: Mesh, place: np.ndarray, size: int = SIZE, pixel: float = PIXEL, textured: bool = True) -> Frontal:
    """The face of a mesh that the similarity `place` (4, 4) carries onto the average face.

    Parameters
    ----------
    size : int
        Pixels, of a side.
    pixel : float
        mm.
    textured : bool
        With the brightness of the mesh's texture as first channel.
    """
    vertices = mesh.vertices @ place[:3, :3].T + place[:3, 3]
    camera = frontal_camera(size, pixel)
    seen = rasterize(vertices, mesh.faces, camera, (size, size))
    channels = [_form(vertices, mesh.faces, seen)]
    if textured:
        channels.insert(0, _brightness(mesh, vertices, camera, seen))
    image = np.stack(channels, 2).astype(np.float32)
    hidden = seen.face < 0
    if hidden.any() and not hidden.all():
        image = image[_nearest(~hidden)]
    return Frontal(image, seen, project(vertices, camera)[0])


def frontal_camera(size: int = SIZE, pixel: float = PIXEL) -> Camera:
    """The camera of the picture."""
    focal, middle = DISTANCE / pixel, (size - 1) / 2
    pose = look_at(MIDDLE + np.array([0, 0, DISTANCE]), MIDDLE)
    return Camera(np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]]), pose)


def out_of_gaps(depth: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """`pixels` (M, 2) moved to the nearest one on the near side, where they look past an edge into a gap.

    A line between lips runs along such edges, and a pixel beside it sees the back of the mouth.
    """
    height, width = depth.shape
    reach = np.arange(-EDGE, EDGE + 1)
    x, y = np.meshgrid(reach, reach)
    moved = np.array(pixels, dtype=np.float64)
    for k, (column, row) in enumerate(np.round(pixels).astype(int)):
        columns, rows = np.clip(column + x, 0, width - 1), np.clip(row + y, 0, height - 1)
        around = depth[rows, columns]
        near = around <= around.min() + GAP
        if np.isfinite(around).any() and not near[EDGE, EDGE]:
            best = np.where(near, x**2 + y**2, np.inf).argmin()
            moved[k] = columns.ravel()[best], rows.ravel()[best]
    return moved


def lift(seen: Fragments, corners: np.ndarray, names, pixels: np.ndarray) -> SurfacePoints:
    """The points of a surface at `pixels` (M, 2) of a picture of it, to a fraction of a pixel.

    Parameters
    ----------
    seen : Fragments
        What each pixel of the picture sees.
    corners : (F, 3, 2)
        Pixels of the triangles' corners.
    """
    known = seen.face >= 0
    rows, columns = _nearest(known)
    height, width = known.shape
    x, y = np.clip(np.round(pixels).astype(int), 0, [width - 1, height - 1]).T
    near = rows[y, x], columns[y, x]
    face = seen.face[near].astype(np.int64)
    inside = known[y, x]
    wanted = np.where(inside[:, None], pixels, np.stack(near[::-1], 1))
    weights = barycentric_flat(wanted, corners[face])
    weights = np.where(np.isfinite(weights).all(1, keepdims=True), weights, seen.barycentric[near])
    weights = np.clip(weights, 0, 1)
    return SurfacePoints(tuple(names), face, weights / weights.sum(1, keepdims=True))


def _nearest(known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row and column (H, W) of the known pixel nearest to each pixel."""
    places = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    return places[0], places[1]


def _form(vertices: np.ndarray, faces: np.ndarray, seen: Fragments) -> np.ndarray:
    normals = vertex_normals(vertices, faces)
    image = (seen.barycentric[..., None] * normals[faces[seen.face]]).sum(2)
    image *= np.where(image[..., 2:] < 0, -1, 1)  # what is seen faces the camera, whichever way the scanner turned it
    return np.clip(image @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)


def _brightness(mesh: Mesh, vertices: np.ndarray, camera: Camera, seen: Fragments) -> np.ndarray:
    corners = np.concatenate([project(vertices, camera)[0], np.ones((len(vertices), 1))], 1)
    level, uv, uv_faces = texture_of(mesh, slice(None)).at(corners, mesh.faces)
    at = (seen.barycentric[..., None] * uv[uv_faces[seen.face]]).sum(2)
    x = (at[..., 0] * level.shape[1] - 0.5).astype(np.float32)
    y = ((1 - at[..., 1]) * level.shape[0] - 0.5).astype(np.float32)
    grey = level.astype(np.float32).mean(2) / 255
    return cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
