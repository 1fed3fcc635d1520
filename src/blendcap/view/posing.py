"""An animation on a rig, ready to be looked at."""

from __future__ import annotations

import numpy as np

from blendcap.data import Animation, Rig


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


def framed_vertices(rig: Rig) -> np.ndarray:
    """The vertices (K, 3) that a picture of the face should show: the head above the lowest chin, without the chest."""
    moving = rig.moving_vertices(3.0)
    if not len(moving):
        return rig.mesh.vertices
    heights = rig.mesh.vertices[moving, 1]
    lowest = min(heights.min(), float((heights + rig.deltas[:, moving, 1]).min()))
    return rig.mesh.vertices[rig.mesh.vertices[:, 1] >= lowest]
