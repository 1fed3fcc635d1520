"""Paint followed through head-camera video, as rows for the marker solve: what the skin does between the markers.

Not in the papers, which read from the paint which action units it shows. Where a stroke is, is told to a tenth of a
pixel, for every shape of the rig, and no lesson has to be learned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from blendcap.data import Binding, Camera, InputError, MarkerTake, PaintTracks, Rig, Solution, SurfacePoints
from blendcap.makeup.skin_points import SkinPoints, sight_lines, skin_points
from blendcap.numerics.similarity import align, apply
from blendcap.rendering import project

ALIKE = 0.8  # correlation with the neutral window from which on a point is found
FARTHEST = 10.0  # pixels from where a point is sought
FORGET = 0.8  # of how far a point was from where it was expected, in each frame in which it is lost
BLUR = 0.7  # pixels, against noise
BLOCK = 240  # frames whose expected places are laid out at once
FEWEST = 4  # markers that place the face
MOST_SHEAR = 3.0  # by which a window is stretched


def track_paint(
    videos: Sequence[Iterable[np.ndarray]],
    rig: Rig,
    take: MarkerTake,
    binding: Binding,
    cameras: Sequence[Camera],
    solution: Solution,
    *,
    progress: Callable[[int], None] = lambda _: None,
) -> PaintTracks:
    """Follow the paint, and all else on the skin that has contrast, through the film of a take.

    Every picture is matched with the neutral one, so nothing drifts. A point is sought where a solve of the markers,
    with or without the curves of the patches, says that it went.

    Parameters
    ----------
    videos : a sequence of frames (H, W) uint8, grey, per camera
        Read once, a frame at a time. The first frame is neutral.
    rig : Rig
    take : MarkerTake
        The markers of the same frames, in the space of the cameras: that of the helmet. The first frame is neutral.
    binding : Binding
        Of the markers to the rig.
    cameras : sequence of Camera
    solution : Solution
        Of the same take, rig and binding.
    progress : callable
        Told how many frames of all videos together are done.

    Raises
    ------
    InputError
        If a video has other frames than the take, or no picture shows anything that could be followed.
    """
    expected = _Expected(rig, take, binding, solution)
    done = [0] * len(cameras)

    def follow(view: int) -> tuple[SkinPoints, np.ndarray]:
        def tell(frames: int) -> None:
            done[view] = frames
            progress(sum(done))

        return _follow(view, iter(videos[view]), rig, binding, cameras[view], expected, tell)

    with ThreadPoolExecutor() as pool:
        found = list(pool.map(follow, range(len(cameras))))
    if not sum(len(points.pixels) for points, _ in found):
        raise InputError(
            "No camera sees anything on the skin that could be followed; check that the first frame is lit, and that "
            "the cameras are where the camera file says."
        )
    return _as_tracks(found, cameras, take.rate)


class _Expected:
    """Where the skin is in the take's space by a solve: its own motion, and the face placed by the markers."""

    def __init__(self, rig: Rig, take: MarkerTake, binding: Binding, solution: Solution):
        fitted = solution.fitted
        if fitted is None:
            raise InputError("The solution does not say where it put the markers; give one of blendcap.solve.")
        self.rig, self.binding, self.weights = rig, binding, solution.animation.weights
        seen = binding.to_rig(take.select(solution.marker_names).positions)
        seen = np.where(np.isfinite(fitted).all(2, keepdims=True), seen, np.nan)
        enough = np.isfinite(seen).all(2).sum(1) >= FEWEST
        if not enough.any():
            raise InputError(f"No frame of the take has {FEWEST} markers, which it takes to place the face.")
        places = align(fitted[enough], seen[enough], scale=False)[:2]
        nearest = np.maximum(np.cumsum(enough) - 1, 0)  # where there are too few, the frame before
        self.rotation, self.translation = (part[nearest] for part in places)

    def corners(self, faces: np.ndarray, frames: slice) -> np.ndarray:
        """The corners (F, K, 3, 3) of triangles (K,) in some frames, mm."""
        corners = self.rig.mesh.faces[faces].ravel()
        deltas = self.rig.deltas[:, corners].reshape(len(self.rig.names), -1).astype(np.float64)
        weights = self.weights[frames]
        still = self.rig.mesh.vertices[corners] + (weights @ deltas).reshape(len(weights), len(corners), 3)
        posed = self.binding.to_take(apply(still, self.rotation[frames], self.translation[frames]))
        return posed.reshape(len(posed), len(faces), 3, 3)


def _follow(
    view: int, video: Iterator[np.ndarray], rig: Rig, binding: Binding, camera: Camera, expected: _Expected,
    progress: Callable[[int], None],
) -> tuple[SkinPoints, np.ndarray]:  # fmt: skip
    """The points that one camera follows, and where they are (T, K, 3) on their lines of sight, mm; NaN where lost."""
    neutral, count = next(video, None), len(expected.weights)
    if neutral is None:
        raise InputError(f"The video of camera {view} has no frame; check the file.")
    points = skin_points(_soft(neutral), rig, binding, camera)
    rest = project(binding.to_take(rig.mesh.vertices[rig.mesh.faces[points.faces]]), camera)[0]
    follower = _Follower(points)
    places = [points.places[None]]
    for start in range(1, count, BLOCK):
        frames = slice(start, min(start + BLOCK, count))
        corners = expected.corners(points.faces, frames)
        sought = np.einsum("kc,fkcd->fkd", points.barycentric, corners)
        shears = _shears(rest, project(corners, camera)[0])
        pixels = project(sought, camera)[0]
        found = np.full_like(pixels, np.nan)
        for f in range(len(pixels)):
            picture = next(video, None)
            if picture is None:
                raise InputError(f"The video of camera {view} ends after {start + f} frames, but the take has {count}.")
            found[f] = follower.find(picture, pixels[f], shears[f])
            progress(start + f + 1)
        ways = sight_lines(found, camera)
        far = ((sought - camera.position) * ways).sum(2, keepdims=True)
        places.append(camera.position + ways * far)
    if next(video, None) is not None:
        raise InputError(f"The video of camera {view} has more frames than the take, which has {count}.")
    return points, np.concatenate(places)


class _Follower:
    """Finds the points of the neutral picture in one picture after the other."""

    def __init__(self, points: SkinPoints):
        self.windows = points.windows
        self.apart = np.zeros_like(points.pixels)  # how far the points were from where they were expected
        self.keep = np.einsum("kim,kin->kmn", points.axes, points.axes)  # only what is surely seen is carried on

    def find(self, picture: np.ndarray, expected: np.ndarray, shears: np.ndarray) -> np.ndarray:
        """Pixels (K, 2), NaN where a point is lost, from expected ones."""
        start = expected + self.apart
        found, alike = self.windows.find(_soft(picture), start, shears)
        good = (alike > ALIKE) & (np.linalg.norm(found - start, axis=1) < FARTHEST)
        moved = np.einsum("kmn,kn->km", self.keep, found - expected)
        self.apart = np.where(good[:, None], moved, FORGET * self.apart)
        return np.where(good[:, None], found, np.nan)


def _soft(picture: np.ndarray) -> np.ndarray:
    import cv2

    return cv2.GaussianBlur(picture.astype(np.float32), (0, 0), BLUR)


def _shears(rest: np.ndarray, posed: np.ndarray) -> np.ndarray:
    """(F, K, 2, 2) how triangles (K, 3, 2) are turned and stretched in the picture when posed (F, K, 3, 2)."""
    before, after = (corners[..., 1:, :] - corners[..., :1, :] for corners in (rest, posed))
    flat = np.abs(np.linalg.det(before)) < 1e-9
    before = np.where(flat[:, None, None], np.eye(2), before)
    shears = np.swapaxes(np.linalg.inv(before) @ after, -1, -2)
    shears = np.where(flat[:, None, None], np.eye(2), shears)
    return np.clip(shears, -MOST_SHEAR, MOST_SHEAR)


def _as_tracks(found: Sequence[tuple[SkinPoints, np.ndarray]], cameras: Sequence[Camera], rate: float) -> PaintTracks:
    views = np.repeat(np.arange(len(found)), [len(points.pixels) for points, _ in found])
    names = tuple(f"p{k:04}" for k in range(len(views)))
    axes = [_in_space(points, camera) for (points, _), camera in zip(found, cameras, strict=True)]
    faces, barycentric, rest = (
        np.concatenate([getattr(points, part) for points, _ in found]) for part in ("faces", "barycentric", "places")
    )
    positions = np.concatenate([places for _, places in found], axis=1)
    return PaintTracks(SurfacePoints(names, faces, barycentric), views, rest, positions, np.concatenate(axes), rate)


def _in_space(points: SkinPoints, camera: Camera) -> np.ndarray:
    """The axes (K, 2, 3) in space: what a millimetre across the line of sight moves in the picture, in millimetres."""
    step = 0.01
    slopes = [(project(points.places + arm, camera)[0] - project(points.places - arm, camera)[0]) / (2 * step)
              for arm in step * np.eye(3)]  # fmt: skip
    depth = project(points.places, camera)[1]
    size = depth / np.sqrt(np.abs(np.linalg.det(camera.intrinsics[:2, :2])))  # of a pixel, mm
    return points.axes @ (np.stack(slopes, axis=-1) * size[:, None, None])
