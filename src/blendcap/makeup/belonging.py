"""Is each video its camera's? One that stands where another should is cut in the wrong places, and nothing stops."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from blendcap.data import Camera
from blendcap.rendering import project

log = logging.getLogger(__name__)

DOT = 0.008  # of the picture's height: the radius of a marker, about
PLAINLY = (
    2.0  # times the contrast where another camera would see the markers: 4 on the stage, 0.2 to 0.3 if it is right
)


def check_belonging(
    pictures: Sequence[np.ndarray], markers: np.ndarray, cameras: Sequence[Camera], names: Sequence[str]
) -> None:
    """Warn of pictures (H, W) uint8 that show dots where another camera than theirs would see the markers (M, 3).

    Where dots do not show, nothing can be said, and nothing is. `names` are the cameras'.
    """
    seen = np.asarray(markers)[np.isfinite(markers).all(1)]
    places = [project(seen, camera)[0] for camera in cameras]
    contrasts = np.array([[_contrast(picture, pixels) for pixels in places] for picture in pictures])
    for view, row in enumerate(contrasts):
        best = int(row.argmax())
        if row[best] > PLAINLY * row[view]:
            log.warning(
                "The video of the camera %r shows the markers where the camera %r would see them: give the videos in "
                "the order of the cameras (%s).", names[view], names[best], ", ".join(names),
            )  # fmt: skip


def _contrast(picture: np.ndarray, pixels: np.ndarray) -> float:
    """How much places (M, 2) of a picture differ from what is around them, grey levels, the mean; 0 outside."""
    import cv2

    light, radius = picture.astype(np.float32), DOT * picture.shape[0]
    differs = np.abs(cv2.GaussianBlur(light, (0, 0), radius / 2) - cv2.GaussianBlur(light, (0, 0), 1.5 * radius))
    inside = (pixels > -0.5).all(1) & (pixels < np.array(picture.shape[::-1]) - 0.5).all(1)
    x, y = np.rint(pixels[inside]).astype(int).T
    return float(differs[y, x].sum() / max(len(pixels), 1))
