"""How the markers of one performer are attached to a rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import checks
from blendcap.data.errors import InputError
from blendcap.data.surface import SurfacePoints


@dataclass(frozen=True, eq=False)
class Binding:
    """Markers attached to a rig.

    Parameters
    ----------
    points : SurfacePoints
        Where each marker sits on the rig, by marker name.
    rotation : (3, 3) float64
    translation : (3,) float64
        mm.
    scale : float
        `rig = scale * rotation @ take + translation` takes the neutral markers into the rig's space.
    offsets : (M, 3) float64
        Rest offset of each marker in the rig's space, marker minus surface, mm (the M_i of the 2016 paper, section 6).
    errors : (K,) float64
        Mean marker error after each pass over the range of motion, mm; empty if no range of motion was given.
    automatic : bool
        True if the places were found without correspondences: look at the picture before you trust them.

    Raises
    ------
    InputError
        If a shape is wrong or a number is not finite.
    """

    points: SurfacePoints
    rotation: np.ndarray
    translation: np.ndarray
    scale: float
    offsets: np.ndarray
    errors: np.ndarray
    automatic: bool = False

    def __post_init__(self):
        put, count = object.__setattr__, len(self.points.names)
        put(self, "rotation", checks.array(self.rotation, (3, 3), "The binding's rotation", finite=True))
        put(self, "translation", checks.array(self.translation, (3,), "The binding's translation", finite=True))
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise InputError(f"The binding's scale must be a positive number, but is {self.scale!r}.")
        put(self, "offsets", checks.array(self.offsets, (count, 3), "The binding's offsets", finite=True))
        put(self, "errors", checks.array(self.errors, (checks.ANY,), "The binding's errors"))

    def to_rig(self, positions: np.ndarray) -> np.ndarray:
        """Marker positions (..., 3) of the take in the rig's space, mm."""
        return self.scale * np.asarray(positions) @ self.rotation.T + self.translation

    def to_take(self, positions: np.ndarray) -> np.ndarray:
        """Positions (..., 3) of the rig's space in the take's, mm."""
        return (np.asarray(positions) - self.translation) @ self.rotation / self.scale
