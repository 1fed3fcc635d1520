"""One shaded picture of a rig."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from blendcap.data import Rig
from blendcap.rendering import default_colors, prepare
from blendcap.view.image import write_image
from blendcap.view.posing import VIEWS, side_by_side
from blendcap.view.preview import mark


def write_still(
    path: str | Path,
    rig: Rig,
    weights: np.ndarray | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    yaws: Sequence[float] = VIEWS,
    targets: np.ndarray | None = None,
    fitted: np.ndarray | None = None,
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
    """
    write_image(path, still(rig, weights, size=size, yaws=yaws, targets=targets, fitted=fitted))


def still(
    rig: Rig,
    weights: np.ndarray | None = None,
    *,
    size: tuple[int, int] = (1280, 720),
    yaws: Sequence[float] = VIEWS,
    targets: np.ndarray | None = None,
    fitted: np.ndarray | None = None,
) -> np.ndarray:
    """The picture (H, W, 3) uint8 that `write_still` writes."""
    posed = rig.mesh if weights is None else rig.mesh.with_vertices(rig.pose(weights))
    surface, views = prepare(posed, default_colors(rig)), []
    for camera, part in side_by_side(rig, size, yaws):
        view = surface.picture(camera, part)
        mark(view, camera, targets, fitted)
        views.append(view)
    return np.hstack(views)
