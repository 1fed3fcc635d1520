"""A camera as OpenCV has it: x right, y down, z forward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import checks


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics and pose of one camera.

    Parameters
    ----------
    intrinsics : (3, 3) float64
        Pixels; the first picture element's centre is at (0, 0).
    pose : (4, 4) float64
        From world to camera, mm.
    distortion : (5,) float64, optional
        OpenCV's k1, k2, p1, p2, k3; zero if not given.

    Raises
    ------
    InputError
        If a shape is wrong or a number is not finite.
    """

    intrinsics: np.ndarray
    pose: np.ndarray
    distortion: np.ndarray = checks.FILLED

    def __post_init__(self):
        put = object.__setattr__
        put(self, "intrinsics", checks.array(self.intrinsics, (3, 3), "The camera's intrinsics", finite=True))
        put(self, "pose", checks.array(self.pose, (4, 4), "The camera's pose", finite=True))
        distortion = np.zeros(5) if self.distortion is None else self.distortion
        put(self, "distortion", checks.array(distortion, (5,), "The camera's distortion", finite=True))

    @property
    def position(self) -> np.ndarray:
        """Where the camera stands in the world, (3,), mm."""
        return -self.pose[:3, :3].T @ self.pose[:3, 3]
