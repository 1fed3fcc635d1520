"""Where patches, dots and still points are in the pictures of calibrated head cameras, told from the markers."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from blendcap.data import Binding, Camera, InputError, MarkerTake, Rig, landmarks68
from blendcap.makeup.regions import seen_patches
from blendcap.modeling.rays import RayTarget
from blendcap.numerics.similarity import align, apply
from blendcap.rendering import project

FACING = 0.35  # cosine between skin and camera from which on a dot is round enough to follow
BEFORE = 2.0  # mm by which something before a marker hides it
STILL = 2.0  # mm by which a shape moves a marker that tells a quarter as much of the head's pose as a still one
LEAST_POSE = 3  # markers that tell it
HOLD = (17, 26, 27, 30, 36, 45, 48, 54)  # landmarks on the head that say where the pictures are
BORDER = 12  # pixels between a dot that is followed and the border of the picture
LEAST_FACE, FACE = 0.08, 0.25  # of the picture's height: no face is seen that is smaller; one before a head camera is
UNITS = {10.0: "cm", 25.4: "in", 1000.0: "m", 0.1: "mm", 1 / 25.4: "mm", 0.001: "mm"}  # what lengths are, by factor


class Setup(NamedTuple):
    """What `each_block` needs to know of a take."""

    places: dict[str, tuple[int, np.ndarray]]  # {patch: (camera, corners (4, 2))}, pixels
    anchors: list[np.ndarray]  # per camera, pixels: (T, K, 2), or (K, 2) in the first frame, to be followed
    dots: list[np.ndarray]  # (T, M, 2) per camera, pixels; NaN where a marker is never seen

    def only(self, patches: Collection[str]) -> Setup:
        """With these patches alone; those that are not there are left to whoever needs them to say so."""
        return self._replace(places={name: place for name, place in self.places.items() if name in patches})


def locate(
    rig: Rig,
    take: MarkerTake,
    binding: Binding,
    cameras: Sequence[Camera],
    sizes: Sequence[tuple[int, int]],
    stable: Sequence[str] = (),
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
    stable : sequence of str, optional
        Markers that do not move with the face, which are followed in the pictures (the papers' way). If not given, the
        pictures are held still by the head's pose, which the markers' places in space tell, those most that the rig's
        shapes move least.

    Raises
    ------
    InputError
        If the rig has no landmarks, a stable marker is unknown, a camera sees fewer than two of them, the first frame
        has fewer than three markers, or the cameras' lengths are in another unit than the take's.
    """
    check_unit(rig, binding, cameras, sizes)
    marks = binding.to_take(landmarks68(rig).positions(rig.mesh))
    places = seen_patches(marks, list(cameras), list(sizes))
    if stable:
        anchors = _anchors(rig, binding, cameras, sizes, stable)
        for view in {view for view, _ in places.values()}:
            if len(anchors[view]) < 2:
                raise InputError(
                    f"Camera {view} sees {len(anchors[view])} of the stable markers ({', '.join(stable)}), but needs "
                    "two; name stable markers that it sees, or none."
                )
    else:
        moved = _carried(marks[list(HOLD)], rig, take, binding)
        anchors = [project(moved, camera)[0] for camera in cameras]
    dots = [project(_filled(take), camera)[0] for camera in cameras]
    return Setup(places, anchors, dots)


def _anchors(rig: Rig, binding: Binding, cameras, sizes, stable: Sequence[str]) -> list[np.ndarray]:
    """Pixels (K, 2) in the first frame, per camera, of the stable markers that it sees."""
    names = binding.points.names
    lost = [name for name in stable if name not in names]
    if lost:
        raise InputError(f"The stable marker {lost[0]!r} is not bound to the rig; name others.")
    rest = binding.to_take(binding.points.positions(rig.mesh) + binding.offsets)
    normals = _normals(rig, binding) @ binding.rotation
    face = RayTarget(binding.to_take(rig.mesh.vertices), rig.mesh.faces)
    anchors = []
    for camera, size in zip(cameras, sizes, strict=True):
        pixels, seen = _seen(rest, normals, camera, size)
        seen &= ~_hidden(rest, camera, face)
        rows = [names.index(name) for name in stable if seen[names.index(name)]]
        anchors.append(pixels[rows])
    return anchors


def _carried(points: np.ndarray, rig: Rig, take: MarkerTake, binding: Binding) -> np.ndarray:
    """Points (K, 3) of the head as its motion carries them, (T, K, 3); NaN where too few markers are seen.

    The pose is a least-squares fit to all markers, the less the rig's shapes move one the more it counts.
    """
    rest = binding.to_take(binding.points.positions(rig.mesh) + binding.offsets)
    motion = np.linalg.norm(rig.sample(binding.points)[1], axis=2).max(0, initial=0.0)
    seen = take.select(binding.points.names).positions
    known = np.isfinite(seen).all(2).sum(1) >= LEAST_POSE
    if not known[0]:
        raise InputError(
            f"The first frame has fewer than {LEAST_POSE} of the markers, and the pictures cannot be held still; begin "
            "with a frame that has more."
        )
    counts = (STILL**2 / (STILL**2 + motion**2)) ** 2
    rotation, translation, _ = align(rest, seen[known], scale=False, weights=counts)
    carried = np.full((len(seen), *points.shape), np.nan)
    carried[known] = apply(points, rotation, translation)
    return carried


def _filled(take: MarkerTake) -> np.ndarray:
    """Positions (T, M, 3), also where a marker is missing: on the straight way, for its dot is in the picture still."""
    filled, frames = take.positions.copy(), np.arange(len(take.positions))
    for path, missing in zip(filled.transpose(1, 0, 2), take.missing.T, strict=True):
        if missing.any() and not missing.all():
            for axis in path.T:
                axis[missing] = np.interp(frames[missing], frames[~missing], axis[~missing])
    return filled


def check_unit(rig: Rig, binding: Binding, cameras: Sequence[Camera], sizes: Sequence[tuple[int, int]]) -> None:
    """Refuse cameras that see no face, but would in another unit: the paint is not at fault."""
    marks = binding.to_take(landmarks68(rig).positions(rig.mesh))
    if _largest_face(marks, cameras, sizes, 1.0) >= LEAST_FACE:
        return
    faces = {factor: _largest_face(marks, cameras, sizes, factor) for factor in UNITS}
    best = max(faces, key=lambda factor: faces[factor])
    if faces[best] >= FACE:
        raise InputError(
            f"The cameras see no face where the markers are, but would if their poses' lengths were {best:g} times as "
            f'long: their unit is wrong; give it in the camera file, probably "unit": "{UNITS[best]}".'
        )


def _largest_face(marks: np.ndarray, cameras: Sequence[Camera], sizes, factor: float) -> float:
    """How large the landmarks are in the picture where they are largest, in its heights; 0 where half are outside."""
    seen = [0.0]
    for camera, size in zip(cameras, sizes, strict=True):
        pose = camera.pose.copy()
        pose[:3, 3] *= factor
        pixels, depth = project(marks, replace(camera, pose=pose))
        inside = (depth > 0) & (pixels > 0).all(1) & (pixels < size).all(1)
        seen.append(float(np.ptp(pixels[inside], axis=0).max()) / size[1] if inside.mean() > 0.5 else 0.0)
    return max(seen)


def _normals(rig: Rig, binding: Binding) -> np.ndarray:
    """Unit normals (M, 3) of the neutral skin at the markers, in the rig's space."""
    corners = rig.mesh.vertices[rig.mesh.faces[binding.points.faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _seen(
    points: np.ndarray, normals: np.ndarray, camera: Camera, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (M, 2) of points, and which of them (M,) bool face the camera and are well inside its picture."""
    pixels, depth = project(points, camera)
    towards = camera.position - points
    facing = (normals * towards).sum(1) / np.linalg.norm(towards, axis=1)
    inside = (pixels > BORDER).all(1) & (pixels < np.array(size) - BORDER).all(1)
    return pixels, (depth > 0) & (facing > FACING) & inside


def _hidden(points: np.ndarray, camera: Camera, face: RayTarget) -> np.ndarray:
    """Which points (M, 3) lie behind something, (M,) bool: a nose, lips."""
    ways = points - camera.position
    far = np.linalg.norm(ways, axis=1)
    _, distances, _ = face.first(np.tile(camera.position, (len(points), 1)), ways / far[:, None])
    return distances < far - BEFORE
