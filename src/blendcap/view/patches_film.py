"""Head-camera video with the patches, and what they told, drawn on."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from blendcap.data import Animation, InputError
from blendcap.io import write_video
from blendcap.makeup.setup import Setup
from blendcap.makeup.stabilization import Stabilizer
from blendcap.view.image import draw_text

COLORS = ((236, 112, 99), (247, 204, 86), (110, 193, 228), (130, 214, 140), (200, 150, 230), (240, 160, 90))
GROUND, INK = np.array([24, 26, 30], dtype=np.uint8), (222, 224, 228)
ROW = 16  # pixels a curve
COLUMNS = 3  # of curves


def write_patches_film(
    path: str | os.PathLike,
    videos: Sequence[Iterable[np.ndarray]],
    setup: Setup,
    curves: Animation,
    *,
    progress: Callable[[int], None] | None = None,
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
    frames = _pictures(videos, setup, curves, progress)
    try:
        first = next(frames)
    except StopIteration:
        raise InputError("The head-camera video has no frame; check the files.") from None
    height, width = first.shape[:2]
    return write_video(path, _with_first(first, frames), curves.rate, (width, height))


def _with_first(first: np.ndarray, others: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
    yield first
    yield from others


def _pictures(videos, setup: Setup, curves: Animation, progress) -> Iterator[np.ndarray]:
    stabilizers: list[Stabilizer | None] = [None] * len(videos)
    for t, frames in enumerate(zip(*videos, strict=False)):
        if t == len(curves.weights):
            return
        tiles = []
        for view, frame in enumerate(frames):
            if t == 0 and len(setup.anchors[view]) > 1:
                stabilizers[view] = Stabilizer(frame, setup.anchors[view])
            tiles.append(_tile(frame, view, setup, stabilizers[view]))
        if len(tiles) % 2:
            tiles.append(np.zeros_like(tiles[0]))
        rows = [np.hstack(tiles[k : k + 2]) for k in range(0, len(tiles), 2)]
        picture = np.vstack([*rows, _bars(curves, t, rows[0].shape[1])])
        yield np.ascontiguousarray(picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2])
        if progress is not None:
            progress(t + 1)


def _tile(frame: np.ndarray, view: int, setup: Setup, stabilizer: Stabilizer | None) -> np.ndarray:
    """A camera's picture with its patches, at half the size."""
    import cv2

    picture = cv2.cvtColor(frame, cv2.COLOR_GRAY2RGB)
    matrix = np.eye(3)[:2] if stabilizer is None else stabilizer.follow(frame)[0]
    for k, (camera, corners) in enumerate(setup.places.values()):
        if camera == view:
            moved = corners @ matrix[:, :2].T + matrix[:, 2]
            cv2.polylines(
                picture, [np.round(moved * 16).astype(np.int32)], True, COLORS[k % len(COLORS)], 2, cv2.LINE_AA, 4
            )
    return cv2.resize(picture, (frame.shape[1] // 2, frame.shape[0] // 2), interpolation=cv2.INTER_AREA)


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
        color = GROUND + (0.25 + 0.75 * trust) * (np.array(COLORS[k % len(COLORS)]) - GROUND)
        strip[top : top + ROW, left : left + long] = GROUND + 14
        strip[top : top + ROW, left : left + round(long * value)] = color.astype(np.uint8)
        draw_text(strip, name, (left + 4, top + ROW // 2), height=ROW - 5, anchor="lm", color=INK)
    return strip
