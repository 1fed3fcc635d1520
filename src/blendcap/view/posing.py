"""An animation on a rig, ready to be looked at."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from blendcap.data import Animation, Camera, Rig
from blendcap.data.names import listed
from blendcap.rendering import face_camera

log = logging.getLogger(__name__)

VIEWS = (0.0, 0.62)  # yaw, rad: from the front, and three quarters from the subject's left


def weights_on(rig: Rig, animation: Animation) -> np.ndarray:
    """The animation's weights (T, N) in the order of the rig's shapes; 0 where it says nothing.

    Raises
    ------
    InputError
        If the animation has a shape that the rig does not have.
    """
    weights = np.zeros((len(animation.weights), len(rig.names)))
    weights[:, [rig.index(name) for name in animation.names]] = np.nan_to_num(animation.weights)
    return weights


def warn_of_unknown(animation: Animation, frames: Sequence[int] | None = None) -> None:
    """Say which weights of the frames to be drawn, all if not given, are NaN: pictures show them at rest."""
    drawn = np.arange(len(animation.weights)) if frames is None else np.asarray(frames)
    unknown = np.isnan(animation.weights[drawn])
    if not unknown.any():
        return
    rows = drawn[unknown.any(1)]
    names = [animation.names[n] for n in np.flatnonzero(unknown.any(axis=0))]
    where = f"frame {rows[0]}" if len(rows) == 1 else f"{len(rows)} frames from {rows[0]} to {rows[-1]}"
    which = "all shapes" if len(names) == len(animation.names) else f"{len(names)} shapes ({listed(names)})"
    log.warning("Weights of %s are unknown in %s; the pictures show them at rest.", which, where)


def framed_vertices(rig: Rig) -> np.ndarray:
    """The vertices (K, 3) that a picture of the face should show: the head above the lowest chin, without the chest."""
    moving = rig.moving_vertices(3.0)
    if not len(moving):
        return rig.mesh.vertices
    heights = rig.mesh.vertices[moving, 1]
    lowest = min(heights.min(), float((heights + rig.deltas[:, moving, 1]).min()))
    return rig.mesh.vertices[rig.mesh.vertices[:, 1] >= lowest]


def side_by_side(rig: Rig, size: tuple[int, int], yaws: Sequence[float]) -> list[tuple[Camera, tuple[int, int]]]:
    """A camera and the size of its picture for each view of the face; together they are `size` (width, height)."""
    framed, widths = framed_vertices(rig), np.diff(np.linspace(0, size[0], len(yaws) + 1).astype(int))
    parts = [(int(width), size[1]) for width in widths]
    return [(face_camera(framed, part, yaw), part) for part, yaw in zip(parts, yaws, strict=True)]
