"""Paint followed through head-camera video, as rows for the marker solve: what the skin does between the markers.

Not in the papers, which read from the paint which action units it shows. Where a stroke is, is told to a tenth of a
pixel (half of the points on the stage), for every shape of the rig, and no lesson has to be learned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from blendcap.data import Binding, Camera, InputError, MarkerTake, PaintTracks, Rig, Solution, SurfacePoints
from blendcap.makeup.expectation import Expectation
from blendcap.makeup.follower import LEVELS, Follower, lids_of, soft
from blendcap.makeup.skin_points import SkinPoints, skin_points
from blendcap.makeup.threads import in_threads
from blendcap.rendering import project, sight_lines
from blendcap.solving.shares import full_weights, in_shares

HEIGHT = 480  # pixels: taller pictures are made smaller by a whole number, as windows and steps are in pixels
BLOCK = 240  # frames whose expected places are laid out at once


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
        If there is not one video a camera, a video has other frames than the take, or no picture shows anything that
        could be followed.
    """
    if len(videos) != len(cameras):
        raise InputError(f"Videos: {len(videos)}; cameras: {len(cameras)}. Give one video a camera, in their order.")
    rig, full = in_shares(rig), full_weights(rig)  # millimetres a shape and levels of a blink are those of all of it
    expected = Expectation(rig, take, binding, solution, full)
    done = [0] * len(cameras)

    def follow(view: int) -> tuple[SkinPoints, np.ndarray]:
        def tell(frames: int) -> None:
            done[view] = frames
            progress(sum(done))

        return _follow(view, iter(videos[view]), rig, binding, cameras[view], expected, tell)

    found = in_threads(follow, range(len(cameras)), most=len(cameras))
    if not sum(len(points.pixels) for points, _ in found):
        raise InputError(
            "No camera sees anything on the skin that could be followed; check that the first frame is lit, and that "
            "the cameras are where the camera file says."
        )
    return _as_tracks(found, cameras, take.rate)


def _follow(
    view: int, video: Iterator[np.ndarray], rig: Rig, binding: Binding, camera: Camera, expected: Expectation,
    progress: Callable[[int], None],
) -> tuple[SkinPoints, np.ndarray]:  # fmt: skip
    """The points that one camera follows, and where they are (T, K, 3) on their lines of sight, mm; NaN where lost."""
    neutral, count = next(video, None), len(expected.weights)
    if neutral is None:
        raise InputError(f"The video of camera {view} has no frame; check the file.")
    scale = max(1, round(neutral.shape[0] / HEIGHT))
    camera = _reduced(camera, scale)
    points = skin_points(soft(neutral, scale), rig, binding, camera)
    lids = lids_of(rig, points)
    follower = Follower(points, lids, scale)
    positions = [points.rest[None]]
    for start in range(1, count, BLOCK):
        frames = slice(start, min(start + BLOCK, count))
        guess = expected.guess(points, camera, frames)
        shut = [
            [expected.guess(points.of(lid.rows), camera, frames, {lid.shape: level}) for level in LEVELS]
            for lid in lids
        ]  # fmt: skip
        found = np.full_like(guess.pixels, np.nan)
        for f in range(len(found)):
            picture = next(video, None)
            if picture is None:
                raise InputError(
                    f"The video of camera {view} ends after {start + f} frames, the take {count}; cut both alike."
                )
            found[f] = follower.find(picture, guess, shut, f)
            progress(start + f + 1)
        ways = sight_lines(found, camera)
        far = ((guess.places - camera.position) * ways).sum(2, keepdims=True)
        positions.append(camera.position + ways * far)
    if next(video, None) is not None:
        raise InputError(
            f"The video of camera {view} has more frames than the take, which has {count}; cut both alike."
        )
    return points, np.concatenate(positions)


def _reduced(camera: Camera, scale: int) -> Camera:
    """The camera of pictures of which so many pixels in each direction have become one."""
    to_small = np.array([[1 / scale, 0, 0.5 / scale - 0.5], [0, 1 / scale, 0.5 / scale - 0.5], [0, 0, 1]])
    return replace(camera, intrinsics=to_small @ camera.intrinsics)


def _as_tracks(found: Sequence[tuple[SkinPoints, np.ndarray]], cameras: Sequence[Camera], rate: float) -> PaintTracks:
    views = np.repeat(np.arange(len(found)), [len(points.pixels) for points, _ in found])
    names = tuple(f"p{k:04}" for k in range(len(views)))
    axes = [_in_space(points, camera) for (points, _), camera in zip(found, cameras, strict=True)]
    faces, barycentric, rest = (
        np.concatenate([getattr(points, part) for points, _ in found]) for part in ("faces", "barycentric", "rest")
    )
    positions = np.concatenate([places for _, places in found], axis=1)
    return PaintTracks(SurfacePoints(names, faces, barycentric), views, rest, positions, np.concatenate(axes), rate)


def _in_space(points: SkinPoints, camera: Camera) -> np.ndarray:
    """The axes (K, 2, 3) in space: what a millimetre across the line of sight moves in the picture, in millimetres."""
    step = 0.01
    slopes = [(project(points.rest + arm, camera)[0] - project(points.rest - arm, camera)[0]) / (2 * step)
              for arm in step * np.eye(3)]  # fmt: skip
    depth = project(points.rest, camera)[1]
    size = depth / np.sqrt(np.abs(np.linalg.det(camera.intrinsics[:2, :2])))  # of a pixel, mm
    return points.axes @ (np.stack(slopes, axis=-1) * size[:, None, None])
