"""An animation as a shaded video."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from blendcap.data import Animation, Camera, InputError, Rig
from blendcap.io.video_write import write_video
from blendcap.rendering import Surface, prepare_rig, project, shaped
from blendcap.rendering.parallel import each_ahead
from blendcap.view.image import draw_dots, draw_lines, draw_text
from blendcap.view.posing import VIEWS, side_by_side, weights_on

SKY_RATE = 10.0  # openness to the sky is computed as often a second; it changes slowly and is blended between
TARGET, FITTED, LINE = (214, 48, 49), (30, 96, 196), (70, 70, 78)


def write_preview(
    path: str | Path,
    rig: Rig,
    animation: Animation,
    *,
    size: tuple[int, int] = (1280, 720),
    yaws: Sequence[float] = VIEWS,
    targets: np.ndarray | None = None,
    fitted: np.ndarray | None = None,
    title: str = "",
    every: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write a video of the animated rig, seen from several sides, and return the number of frames.

    Parameters
    ----------
    path : path
        `.mp4`, `.gif`, or `.png` for a sequence.
    size : (width, height)
        Pixels, of all views together.
    yaws : sequence of float
        A view each, rad towards the subject's left.
    targets, fitted : (T, M, 3), optional
        Markers (red) and their places on the posed rig (blue), mm, in the rig's space.
    title : str
    every : int
        Show one of so many frames, at a rate that is as many times lower; the picture names the frame of the animation.
    progress : callable (frames done, frames in all), optional

    Raises
    ------
    InputError
        If the animation has a shape that the rig has not, a length is wrong or the file cannot be written.
    """
    for what, points in (("targets", targets), ("fitted", fitted)):
        if points is not None and len(points) != len(animation.weights):
            raise InputError(f"The {what} have {len(points)} frames, but the animation has {len(animation.weights)}.")
    targets, fitted = (None if points is None else points[::every] for points in (targets, fitted))
    frames = picture_frames(rig, one_of(animation, every), size, yaws, targets, fitted, title, every, progress)
    return write_video(path, frames, animation.rate / every, size)


def one_of(animation: Animation, every: int) -> Animation:
    """The weights of one of so many frames, at the rate that is left."""
    weights, times = animation.weights[::every], animation.times[::every]
    return Animation(weights, animation.names, animation.rate / every, times=times)


def picture_frames(
    rig: Rig, animation: Animation, size: tuple[int, int], yaws: Sequence[float] = VIEWS,
    targets: np.ndarray | None = None, fitted: np.ndarray | None = None, title: str = "",
    every: int = 1, progress: Callable[[int, int], None] | None = None,
) -> Iterator[np.ndarray]:  # fmt: skip
    """The pictures (H, W, 3) uint8 that `write_preview` writes, one after the other."""
    views, count = side_by_side(rig, size, yaws), len(animation.weights)

    def draw(task: tuple[int, Surface]) -> np.ndarray:
        t, surface = task
        marked = [None if points is None else points[t] for points in (targets, fitted)]
        parts = [surface.picture(camera, part) for camera, part in views]
        for picture, (camera, _) in zip(parts, views, strict=True):
            mark(picture, camera, *marked)
        return np.hstack(parts)

    for t, picture in enumerate(each_ahead(draw, enumerate(_surfaces(rig, animation)))):
        _caption(picture, title, f"frame {t * every}    {animation.times[t]:.2f} s")
        yield picture
        if progress is not None:
            progress(t + 1, count)


def _surfaces(rig: Rig, animation: Animation) -> Iterator[Surface]:
    """The posed face of each frame; its openness to the sky is blended between key frames."""
    weights, neutral = weights_on(rig, animation), prepare_rig(rig)
    if not len(weights):
        return
    last, step = len(weights) - 1, max(round(animation.rate / SKY_RATE), 1)
    sky = neutral.posed(rig.pose(weights[0])).sky
    for start, stop in pairwise([*range(0, last, step), last]):
        coming = neutral.posed(rig.pose(weights[stop])).sky
        for t in range(start, stop):
            share = (t - start) / (stop - start)
            yield shaped(neutral, rig, weights[t], (1 - share) * sky + share * coming)
        sky = coming
    yield shaped(neutral, rig, weights[last], sky)


def _caption(picture: np.ndarray, title: str, counter: str) -> None:
    height, width = picture.shape[:2]
    size, border = max(height // 42, 10), height // 36
    draw_text(picture, title, (border, height - border), height=size, anchor="ls")
    draw_text(picture, counter, (width - border, height - border), height=size, anchor="rs")


def mark(picture: np.ndarray, camera: Camera, targets: np.ndarray | None, fitted: np.ndarray | None) -> None:
    """Draw markers (M, 3), red, their places on the face (M, 3), blue, and lines between, mm, on a picture."""
    radius = max(picture.shape[0] / 220, 2.7)
    places = {}
    for what, points in (("target", targets), ("fitted", fitted)):
        if points is not None:
            places[what] = project(points, camera)[0]
    if len(places) == 2:
        draw_lines(picture, places["target"], places["fitted"], LINE)
    if "fitted" in places:
        draw_dots(picture, places["fitted"], FITTED, radius)
    if "target" in places:
        draw_dots(picture, places["target"], TARGET, radius)
