"""An animation as pictures, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from blendcap.data import Animation, Rig
from blendcap.rendering import Surface, prepare_rig, shaped
from blendcap.rendering.parallel import each_ahead
from blendcap.view.image import draw_text, explain, mark
from blendcap.view.posing import VIEWS, side_by_side, warn_of_unknown, weights_on

SKY_RATE = 10.0  # openness to the sky is computed as often a second; it changes slowly and is blended between


@dataclass(frozen=True)
class Film:
    """How an animated face is shown.

    Parameters
    ----------
    size : (width, height)
        Pixels, of all views together.
    yaws : sequence of float
        A view each, rad towards the subject's left.
    title : str
        Written into the lower left corner.
    every : int
        One of so many frames is shown, at a rate that is as many times lower; the picture names the frame of the
        animation.
    """

    size: tuple[int, int] = (1280, 720)
    yaws: Sequence[float] = VIEWS
    title: str = ""
    every: int = 1

    def count(self, animation: Animation) -> int:
        """The number of pictures."""
        return -(-len(animation.weights) // self.every)

    def times(self, animation: Animation) -> np.ndarray:
        """When each picture is, s."""
        return animation.times[:: self.every]

    def rate(self, animation: Animation) -> float:
        """Pictures a second."""
        return animation.rate / self.every


def pictures(
    rig: Rig,
    animation: Animation,
    film: Film,
    *,
    targets: np.ndarray | None = None,
    fitted: np.ndarray | None = None,
) -> Iterator[np.ndarray]:
    """The pictures (H, W, 3) uint8 of a film; markers `targets` and their places `fitted`, (T, M, 3) mm, drawn on."""
    views, frames = side_by_side(rig, film.size, film.yaws), range(0, len(animation.weights), film.every)
    warn_of_unknown(animation, frames)
    weights = weights_on(rig, animation)[:: film.every]

    def draw(task: tuple[int, Surface]) -> np.ndarray:
        t, surface = task
        marked = [None if points is None else points[t] for points in (targets, fitted)]
        parts = [surface.picture(camera, part) for camera, part in views]
        for picture, (camera, _) in zip(parts, views, strict=True):
            mark(picture, camera, *marked)
        picture = np.hstack(parts)
        explain(picture, targets, fitted)
        _caption(picture, film.title, f"frame {t}    {animation.times[t]:.2f} s")
        return picture

    return each_ahead(draw, zip(frames, _surfaces(rig, weights, film.rate(animation)), strict=True))


def reporting(
    frames: Iterable[np.ndarray], count: int, progress: Callable[[int, int], None] | None
) -> Iterator[np.ndarray]:
    """The same frames; `progress` is called with the number done and `count` after each."""
    for done, frame in enumerate(frames, 1):
        yield frame
        if progress is not None:
            progress(done, count)


def _surfaces(rig: Rig, weights: np.ndarray, rate: float) -> Iterator[Surface]:
    """The face under weights (T, N); its openness to the sky is blended between key frames."""
    neutral = prepare_rig(rig)
    if not len(weights):
        return
    last, step = len(weights) - 1, max(round(rate / SKY_RATE), 1)
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
