"""One shaded picture of a rig."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from blendcap.data import Camera, Rig
from blendcap.io.images import write_image
from blendcap.rendering import Surface, prepare_rig, project, shaped, vertex_normals
from blendcap.view.image import draw_text, explain, mark, text_width
from blendcap.view.posing import VIEWS, side_by_side


def write_still(
    path: str | Path,
    rig: Rig,
    weights: np.ndarray | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    yaws: Sequence[float] = VIEWS,
    targets: np.ndarray | None = None,
    fitted: np.ndarray | None = None,
    labels: Sequence[str] | None = None,
) -> None:
    """Write a PNG of the rig under weights (N,), neutral if not given, seen from several sides.

    Parameters
    ----------
    size : (width, height)
        Pixels, of all views together.
    yaws : sequence of float
        A view each, rad towards the subject's left.
    targets, fitted : (M, 3), optional
        Markers (red) and their places on the posed rig (blue), mm.
    labels : (M,) str, optional
        Names of the places, written beside those that face the camera.
    """
    write_image(path, still(rig, weights, size=size, yaws=yaws, targets=targets, fitted=fitted, labels=labels))


def still(
    rig: Rig,
    weights: np.ndarray | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    yaws: Sequence[float] = VIEWS,
    targets: np.ndarray | None = None,
    fitted: np.ndarray | None = None,
    labels: Sequence[str] | None = None,
) -> np.ndarray:
    """The picture (H, W, 3) uint8 that `write_still` writes."""
    neutral, views = prepare_rig(rig), []
    surface = neutral if weights is None else shaped(neutral, rig, weights)
    for camera, part in side_by_side(rig, size, yaws):
        view = surface.picture(camera, part)
        mark(view, camera, targets, fitted)
        if labels is not None and fitted is not None:
            _name(view, camera, surface, fitted, labels)
        views.append(view)
    picture = np.hstack(views)
    explain(picture, targets, fitted)
    return picture


def _name(picture: np.ndarray, camera: Camera, surface: Surface, places: np.ndarray, labels: Sequence[str]) -> None:
    """Write the names of places (M, 3), mm, to the right of them, but for those on the far side of the head."""
    normals = vertex_normals(surface.vertices, surface.faces)[KDTree(surface.vertices).query(places)[1]]
    outward = places - surface.vertices.mean(0)  # a marker under brow or chin is in front whatever the skin's normal
    towards = -camera.pose[:3, :3].T @ camera.pose[:3, 3] - places
    height = max(picture.shape[0] // 80, 9)
    pixels = np.round(project(places, camera)[0]).astype(int)
    facing = np.maximum((outward * towards).sum(1), (normals * towards).sum(1)) > 0
    taken: list[tuple[int, int, int]] = []
    for m in sorted(np.flatnonzero(facing).tolist(), key=lambda m: pixels[m, 1]):
        name, (left, middle) = labels[int(m)], pixels[m].tolist()
        left += height // 2
        right = left + text_width(name, height)
        while any(a < right and left < b and abs(middle - y) < height for a, b, y in taken):
            middle += 1
        taken.append((left, right, middle))
        draw_text(picture, name, (left, middle), height=height, anchor="lm")
