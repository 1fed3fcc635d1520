"""Where patches, dots and still points are in the pictures of calibrated head cameras, told from the markers."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from blendcap.data import Binding, Camera, InputError, MarkerTake, Rig, landmarks68
from blendcap.makeup.regions import seen_patches
from blendcap.rendering import project

FACING = 0.35  # cosine between skin and camera from which on a dot is round enough to follow
BORDER = 12  # pixels between a dot that is followed and the border of the picture


class Setup(NamedTuple):
    """What `each_block` needs to know of a take."""

    places: dict[str, tuple[int, np.ndarray]]  # {patch: (camera, corners (4, 2))}, pixels
    anchors: list[np.ndarray]  # (K, 2) per camera, pixels in the first frame
    dots: list[np.ndarray]  # (T, M, 2) per camera, pixels; NaN where a marker is missing

    def only(self, patches: Collection[str]) -> Setup:
        """With these patches alone; those that are not there are left to whoever needs them to say so."""
        return self._replace(places={name: place for name, place in self.places.items() if name in patches})


def locate(
    rig: Rig,
    take: MarkerTake,
    binding: Binding,
    cameras: Sequence[Camera],
    sizes: Sequence[tuple[int, int]],
    stable: Sequence[str],
) -> Setup:
    """Find the patches by the rig's landmarks, laid over the face by its markers, and the dots by their 3D places.

    Parameters
    ----------
    rig : Rig
        With points "landmarks68".
    take : MarkerTake
        In the space of the cameras: that of the helmet. The first frame is neutral.
    binding : Binding
        Of the markers to the rig.
    cameras : sequence of Camera
    sizes : sequence of (width, height)
        Pixels.
    stable : sequence of str
        Markers that do not move with the face.

    Raises
    ------
    InputError
        If the rig has no landmarks, a stable marker is unknown, or a camera sees fewer than two of them.
    """
    marks = binding.to_take(landmarks68(rig).positions(rig.mesh))
    places = seen_patches(marks, list(cameras), list(sizes))
    used = {view for view, _ in places.values()}
    rest = binding.to_take(binding.points.positions(rig.mesh) + binding.offsets)
    normals = _normals(rig, binding) @ binding.rotation
    rows = [binding.points.names.index(name) for name in stable if name in binding.points.names]
    if len(rows) < len(stable):
        lost = next(name for name in stable if name not in binding.points.names)
        raise InputError(f"The stable marker {lost!r} is not bound to the rig; name others.")
    anchors = []
    for view, (camera, size) in enumerate(zip(cameras, sizes, strict=True)):
        pixels = _seen(rest[rows], normals[rows], camera, size)
        if view in used and len(pixels) < 2:
            raise InputError(
                f"Camera {view} sees {len(pixels)} of the stable markers ({', '.join(stable)}), but needs two; "
                "name stable markers that it sees."
            )
        anchors.append(pixels)
    known = np.nan_to_num(take.positions)
    dots = [np.where(take.missing[..., None], np.nan, project(known, camera)[0]) for camera in cameras]
    return Setup(places, anchors, dots)


def _normals(rig: Rig, binding: Binding) -> np.ndarray:
    """Unit normals (M, 3) of the neutral skin at the markers, in the rig's space."""
    corners = rig.mesh.vertices[rig.mesh.faces[binding.points.faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _seen(points: np.ndarray, normals: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Pixels (K, 2) of the points that face the camera and are well inside its picture."""
    pixels, depth = project(points, camera)
    towards = camera.position - points
    facing = (normals * towards).sum(1) / np.linalg.norm(towards, axis=1)
    inside = (pixels > BORDER).all(1) & (pixels < np.array(size) - BORDER).all(1)
    return pixels[(depth > 0) & (facing > FACING) & inside]
