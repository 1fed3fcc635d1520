"""Pictures of several cameras, side by side."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from blendcap.data import InputError
from blendcap.io import write_video

TILE = 480  # pixels across a camera's picture, whatever its own size


def tile(frame: np.ndarray) -> tuple[np.ndarray, float]:
    """A grey frame (H, W) as a picture in colours, `TILE` pixels wide, and by how much it was scaled."""
    import cv2

    scale = TILE / frame.shape[1]
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    small = cv2.resize(frame, (TILE, round(frame.shape[0] * scale)), interpolation=way)
    return cv2.cvtColor(small, cv2.COLOR_GRAY2RGB), scale


def two_by_two(tiles: Sequence[np.ndarray]) -> np.ndarray:
    """Pictures of one size in two columns, the last one black if they are odd in number."""
    whole = [*tiles, np.zeros_like(tiles[0])] if len(tiles) % 2 else list(tiles)
    return np.vstack([np.hstack(whole[k : k + 2]) for k in range(0, len(whole), 2)])


def even(picture: np.ndarray) -> np.ndarray:
    """A picture of even height and width, as films need it."""
    return np.ascontiguousarray(picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2])


def write_tiles(path: str | os.PathLike, pictures: Iterator[np.ndarray], rate: float) -> int:
    """Write pictures (H, W, 3) uint8 of one size as a video; how many they were."""
    first = first_of(pictures)
    return write_video(path, chain([first], pictures), rate, (first.shape[1], first.shape[0]))


def first_of(pictures: Iterator[np.ndarray]) -> np.ndarray:
    """The first picture; refuses a film without one."""
    for picture in pictures:
        return picture
    raise InputError("The head-camera video has no frame; check the files.")
