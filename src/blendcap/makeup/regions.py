"""Where on a face the makeup patches are: rectangles placed by the 68 landmarks, in pixels or in space.

After Figure 7 of Reading Between the Dots (2016): the forehead in two parts, between the brows with the root of the
nose, the eyes, the lips. The sides of the nose are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from blendcap.data import Camera, InputError
from blendcap.rendering import project

PATCH_SIZE = (56, 44)  # pixels of a patch after resampling: width, height


class Patch(NamedTuple):
    """A rectangle on the face: its middle is a mean of landmarks plus a shift; all lengths in eye distances."""

    landmarks: tuple[int, ...]
    shift: tuple[float, float]  # to the subject's left, up
    size: tuple[float, float]


# Lengths in distances between the outer corners of the eyes (landmarks 36 and 45).
PATCHES: Mapping[str, Patch] = {
    "forehead_right": Patch((18, 19, 20), (0.0, 0.10), (0.54, 0.40)),
    "forehead_left": Patch((23, 24, 25), (0.0, 0.10), (0.54, 0.40)),
    "glabella": Patch((21, 22, 27), (0.0, -0.05), (0.42, 0.54)),
    "eye_right": Patch((36, 37, 38, 39, 40, 41), (0.0, -0.03), (0.50, 0.42)),
    "eye_left": Patch((42, 43, 44, 45, 46, 47), (0.0, -0.03), (0.50, 0.42)),
    "nose_right": Patch((29, 31), (-0.05, 0.05), (0.28, 0.32)),
    "nose_left": Patch((29, 35), (0.05, 0.05), (0.28, 0.32)),
    "mouth_right": Patch((48, 51, 57), (0.0, 0.0), (0.56, 0.50)),
    "mouth_left": Patch((54, 51, 57), (0.0, 0.0), (0.56, 0.50)),
}


def patch_corners(landmarks: np.ndarray) -> dict[str, np.ndarray]:
    """Corners (4, D) of each patch: subject's upper right, upper left, lower left, lower right.

    Parameters
    ----------
    landmarks : (68, D)
        Of a neutral face: pixels (D = 2) of a camera that stands before it, or mm (D = 3).
    """
    landmarks = np.asarray(landmarks, dtype=np.float64)
    if landmarks.ndim != 2 or len(landmarks) != 68 or not np.isfinite(landmarks).all():
        raise InputError(f"Patches are placed by 68 landmarks of the neutral face, but these are {landmarks.shape}.")
    across = landmarks[45] - landmarks[36]
    unit = float(np.linalg.norm(across))
    if unit == 0:
        raise InputError("The outer corners of the eyes (landmarks 36 and 45) coincide; check the landmarks.")
    across = across / unit
    up = landmarks[27] - landmarks[8]
    up = up - (up @ across) * across
    up /= np.linalg.norm(up)
    signs = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    corners = {}
    for name, (places, shift, size) in PATCHES.items():
        arms = (np.array(shift) + signs * np.array(size) / 2) * unit
        corners[name] = landmarks[list(places)].mean(0) + arms @ np.stack([across, up])
    return corners


def seen_patches(
    landmarks: np.ndarray, cameras: list[Camera], sizes: list[tuple[int, int]]
) -> dict[str, tuple[int, np.ndarray]]:
    """The camera that sees each patch best, and the patch's corners (4, 2) in its pixels.

    Parameters
    ----------
    landmarks : (68, 3)
        Of the neutral face, mm, in the space of the cameras.
    cameras : list of Camera
    sizes : list of (width, height)
        Of the cameras' pictures, pixels.

    Raises
    ------
    InputError
        If no camera has a patch in its picture.
    """
    found = {}
    for name, corners in patch_corners(landmarks).items():
        views = [_view(corners, camera, size) for camera, size in zip(cameras, sizes, strict=True)]
        best = max(range(len(views)), key=lambda view: views[view][0])
        if views[best][0] <= 0:
            raise InputError(f"No camera has the patch {name!r} in its picture; check landmarks and calibration.")
        found[name] = (best, views[best][1])
    return found


def _view(corners: np.ndarray, camera: Camera, size: tuple[int, int]) -> tuple[float, np.ndarray]:
    """How large the patch is in the picture, square pixels (0 if a corner is outside or behind), and its pixels."""
    pixels, depth = project(corners, camera)
    if (depth <= 0).any() or (pixels < 0).any() or (pixels > np.array(size) - 1).any():
        return 0.0, pixels
    x, y = pixels.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)), pixels  # seen from behind it is negative
