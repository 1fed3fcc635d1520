"""What was captured between the markers: points of the skin that calibrated cameras followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import checks
from blendcap.data.errors import InputError
from blendcap.data.surface import SurfacePoints


@dataclass(frozen=True, eq=False)
class PaintTracks:
    """Points of the skin, on paint above all, that calibrated cameras on the helmet followed.

    One camera does not see how far away a point is, and along the edge of a stroke all places look alike. So each
    point tells its motion along two directions only, and along each as surely as the picture allows.

    Parameters
    ----------
    points : SurfacePoints
        (K,) where they sit on the rig.
    cameras : (K,) int64
        Which camera follows each, counted from 0.
    rest : (K, 3) float64
        The neutral points on their lines of sight, mm, in the take's space.
    positions : (T, K, 3) float64
        The points on their lines of sight, mm, in the take's space; NaN where a point was lost.
    axes : (K, 2, 3) float64
        Directions across the line of sight, each as long as motion along it is surely told: 1 counts as one coordinate
        of a marker, 0 not at all; away from the middle of the picture it may be a little more.
    rate : float
        Frames a second.

    Raises
    ------
    InputError
        If the lengths differ, there is no frame, a position is infinite or the rate is not positive.
    """

    points: SurfacePoints
    cameras: np.ndarray
    rest: np.ndarray
    positions: np.ndarray
    axes: np.ndarray
    rate: float

    def __post_init__(self):
        put, count = object.__setattr__, len(self.points.names)
        put(self, "rate", checks.rate(self.rate, "The tracks' rate"))
        put(self, "cameras", checks.indices(self.cameras, 2**31, (count,), "The tracks' cameras", "camera"))
        put(self, "rest", checks.array(self.rest, (count, 3), "The tracks' rest", finite=True))
        put(self, "axes", checks.array(self.axes, (count, 2, 3), "The tracks' axes", finite=True))
        put(self, "positions", checks.array(self.positions, (checks.ANY, count, 3), "The tracks' positions"))
        if not self.positions.size:
            raise InputError("The tracks are empty: they need at least one frame and one point.")
        if np.isinf(self.positions).any():
            frame, point, _ = np.argwhere(np.isinf(self.positions))[0]
            raise InputError(
                f"The track {self.points.names[point]!r} is at infinity in frame {frame}; mark a lost point with NaN."
            )

    @property
    def lost(self) -> np.ndarray:
        """(T, K) bool: where a point was not found again."""
        return np.any(np.isnan(self.positions), axis=2)
