"""Landmarks that were found, on the scan from the front and the side and on its texture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from blendcap.data import Mesh, SurfacePoints
from blendcap.io.images import write_image
from blendcap.rendering import face_camera, prepare, project
from blendcap.rendering.texels import uv_pixels
from blendcap.view.image import draw_dots, draw_lines

YAWS = (0.0, 0.7)  # rad
FEATURE, ABOVE, BELOW = (214, 51, 46), (46, 160, 67), (33, 110, 200)
FRAMED = 1.4  # times the reach of the landmarks


def write_landmarks(path: str | Path, mesh: Mesh, points: SurfacePoints, *, height: int = 720) -> None:
    """Write a PNG of landmarks on a scan; see `landmark_picture`."""
    write_image(path, landmark_picture(mesh, points, height=height))


def landmark_picture(mesh: Mesh, points: SurfacePoints, *, height: int = 720) -> np.ndarray:
    """Picture (H, W, 3) uint8 of landmarks on a scan, seen from two sides, and on its texture if it has one.

    Features are red; lines, points whose names end in a number, green where they run above and blue below.
    """
    size, places = (height, height), points.positions(mesh)
    surface, views = prepare(mesh), []
    middle = (places.min(0) + places.max(0)) / 2
    framed = middle + FRAMED * (places - middle)
    for yaw in YAWS:
        camera = face_camera(framed, size, yaw)
        view = surface.picture(camera, size)
        _mark(view, points.names, project(places, camera)[0])
        views.append(view)
    if mesh.uv is not None and mesh.texture is not None:
        views.append(_on_texture(mesh, points, height))
    return np.hstack(views)


def _on_texture(mesh: Mesh, points: SurfacePoints, height: int) -> np.ndarray:
    import cv2

    assert mesh.texture is not None
    image = mesh.texture if mesh.texture.shape[2] >= 3 else np.repeat(mesh.texture[..., :1], 3, axis=2)
    width = round(height * image.shape[1] / image.shape[0])
    picture = cv2.resize(np.ascontiguousarray(image[..., :3]), (width, height), interpolation=cv2.INTER_AREA)
    corners = uv_pixels(mesh, (width, height))[np.asarray(mesh.uv_faces)[points.faces]]
    _mark(picture, points.names, (points.barycentric[..., None] * corners).sum(1), joined=False)
    return picture


def _mark(picture: np.ndarray, names: tuple[str, ...], pixels: np.ndarray, joined: bool = True) -> None:
    """Dots for points, and lines between neighbors of one line unless the picture may have a seam between them."""
    radius = len(picture) / 240
    for k, name in enumerate(names):
        line, _, number = name.rpartition("_")
        color = FEATURE if not number.isdigit() else BELOW if "lower" in line else ABOVE
        draw_dots(picture, pixels[k : k + 1], color, radius if not number.isdigit() else 0.6 * radius)
        if joined and number.isdigit() and k and names[k - 1].rpartition("_")[0] == line:
            draw_lines(picture, pixels[k - 1 : k], pixels[k : k + 1], color)
