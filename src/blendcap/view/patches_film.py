"""Head-camera video with the patches, and what they told, drawn on."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

import numpy as np

from blendcap.data import Animation
from blendcap.io.images import write_image
from blendcap.makeup.setup import Setup
from blendcap.makeup.stabilization import Held, Stabilizer, held
from blendcap.view.camera_tiles import even, first_of, tile, two_by_two, write_tiles
from blendcap.view.image import draw_text, text_width

COLORS = ((236, 112, 99), (247, 204, 86), (110, 193, 228), (130, 214, 140), (200, 150, 230), (240, 160, 90))
GROUND, INK = np.array([24, 26, 30], dtype=np.uint8), (222, 224, 228)
ROW = 18  # pixels a curve
NAME = 12  # pixels of text at a patch
COLUMNS = 3  # of curves


def write_patches_film(
    path: str | os.PathLike,
    videos: Sequence[Iterable[np.ndarray]],
    setup: Setup,
    curves: Animation,
    *,
    progress: Callable[[int], None] = lambda _: None,
) -> int:
    """Write a video: all cameras in two columns, the patches where they were cut, and a bar for each curve.

    Parameters
    ----------
    path : path
        `.mp4` or `.gif`.
    videos : a sequence of frames (H, W) uint8 per camera
        Of one size.
    setup : Setup
    curves : Animation
        From `classify`, of the same frames.
    progress : callable, optional
        Told how many frames are done.
    """
    frames = _pictures(videos, setup, curves, range(len(curves.weights)), progress)
    return write_tiles(path, frames, curves.rate)


def write_patches_picture(
    path: str | os.PathLike, videos: Sequence[Iterable[np.ndarray]], setup: Setup, curves: Animation
) -> int:
    """Write one frame of `write_patches_film` as a picture, the one whose curves are highest, and say which it is."""
    frame = int(np.nan_to_num(curves.weights).sum(1).argmax())
    write_image(path, first_of(_pictures(videos, setup, curves, (frame,), lambda _: None)))
    return frame


def _pictures(videos, setup: Setup, curves: Animation, wanted: Collection[int], progress) -> Iterator[np.ndarray]:
    """The wanted frames; the others are only followed."""
    stabilizers: list[Stabilizer | Held | None] = [None] * len(videos)
    for t, frames in enumerate(zip(*videos, strict=False)):
        if t > max(wanted):
            return
        matrices = []
        for view, frame in enumerate(frames):
            if t == 0 and setup.anchors[view].shape[-2] > 1:  # else no patch is there
                stabilizers[view] = held(frame, setup.anchors[view])
            stabilizer = stabilizers[view]
            matrices.append(np.eye(3)[:2] if stabilizer is None else stabilizer.follow(frame)[0])
        if t in wanted:
            yield _picture(frames, matrices, setup, curves, t)
        progress(t + 1)


def _picture(frames: Sequence[np.ndarray], matrices: Sequence[np.ndarray], setup: Setup, curves: Animation, t: int):
    """The cameras two by two, and the bars below."""
    cameras = two_by_two([_tile(frame, view, t, setup, matrices[view]) for view, frame in enumerate(frames)])
    return even(np.vstack([cameras, _bars(curves, t, cameras.shape[1])]))


def _tile(frame: np.ndarray, view: int, t: int, setup: Setup, matrix: np.ndarray) -> np.ndarray:
    """A camera's picture with its patches and their names."""
    import cv2

    picture, scale = tile(frame)
    for k, (name, (camera, corners)) in enumerate(setup.places.items()):
        if camera == view:
            color = COLORS[k % len(COLORS)]
            moved = scale * (corners @ matrix[:, :2].T + matrix[:, 2])
            cv2.polylines(picture, [np.round(moved * 16).astype(np.int32)], True, color, 1, cv2.LINE_AA, 4)
            left, top = (int(n) for n in np.round(moved.min(0)))
            _name(picture, name.replace("_", " "), left, top, color)
    draw_text(picture, f"camera {view}, frame {t}", (8, 8), height=14, anchor="lt", color=INK)
    return picture


def _name(picture: np.ndarray, text: str, left: int, top: int, color: tuple[int, int, int]) -> None:
    """A name above a patch, on a dark plate: paint is as bright as letters."""
    wide = text_width(text, NAME)
    plate = picture[max(top - NAME - 4, 0) : max(top, 0), max(left, 0) : max(left + wide + 6, 0)]
    plate[:] = plate // 4
    draw_text(picture, text, (left + 3, top - 2), height=NAME, anchor="lb", color=color)


def _bars(curves: Animation, t: int, width: int) -> np.ndarray:
    """A bar for each curve, pale where it is not trusted."""
    count = len(curves.names)
    per_column = -(-count // COLUMNS)
    strip = np.tile(GROUND, (per_column * (ROW + 4) + 12, width, 1))
    column = width // COLUMNS
    for k, name in enumerate(curves.names):
        left, top = 8 + k // per_column * column, 6 + k % per_column * (ROW + 4)
        long = column - 24
        trust = 1.0 if curves.confidence is None else float(np.nan_to_num(curves.confidence[t, k]))
        value = float(np.nan_to_num(curves.weights[t, k]))
        color = GROUND + (0.2 + 0.5 * trust) * (np.array(COLORS[k % len(COLORS)]) - GROUND)
        strip[top : top + ROW, left : left + long] = GROUND + 14
        strip[top : top + ROW, left : left + round(long * value)] = color.astype(np.uint8)
        draw_text(strip, name, (left + 4, top + ROW // 2), height=ROW - 5, anchor="lm", color=INK)
    return strip
