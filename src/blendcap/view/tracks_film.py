"""Head-camera video with the followed points of the skin drawn on: do they sit where they were, on paint and skin?"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

import numpy as np

from blendcap.data import Camera, PaintTracks
from blendcap.io.images import write_image
from blendcap.rendering import project
from blendcap.view.camera_tiles import even, first_of, tile, two_by_two, write_tiles
from blendcap.view.image import draw_text

FOUND, WAY = (120, 230, 140), (236, 112, 99)  # a point that was found, and its way from rest
RADIUS, FINE = 2, 16  # pixels; parts of one


def write_tracks_film(
    path: str | os.PathLike,
    videos: Sequence[Iterable[np.ndarray]],
    cameras: Sequence[Camera],
    tracks: PaintTracks,
    *,
    progress: Callable[[int], None] = lambda _: None,
) -> int:
    """Write a video: all cameras in two columns, each point where it was found, with its way from rest.

    Parameters
    ----------
    path : path
        `.mp4` or `.gif`.
    videos : a sequence of frames (H, W) uint8 per camera
        Of one size.
    cameras : sequence of Camera
    tracks : PaintTracks
        From `track_paint`, of the same frames.
    progress : callable, optional
        Told how many frames are done.
    """
    frames = _pictures(videos, cameras, tracks, range(len(tracks.positions)), progress)
    return write_tiles(path, frames, tracks.rate)


def write_tracks_picture(
    path: str | os.PathLike, videos: Sequence[Iterable[np.ndarray]], cameras: Sequence[Camera], tracks: PaintTracks
) -> int:
    """Write the frame of `write_tracks_film` in which the points have moved most, and say which it is."""
    moved = np.linalg.norm(tracks.positions - tracks.rest, axis=2)
    frame = int(np.nan_to_num(moved).mean(1).argmax())
    write_image(path, first_of(_pictures(videos, cameras, tracks, (frame,), lambda _: None)))
    return frame


def _pictures(videos, cameras, tracks: PaintTracks, wanted: Collection[int], progress) -> Iterator[np.ndarray]:
    for t, frames in enumerate(zip(*videos, strict=False)):
        if t > max(wanted):
            return
        if t in wanted:
            yield even(two_by_two([_tile(frame, view, cameras[view], tracks, t) for view, frame in enumerate(frames)]))
        progress(t + 1)


def _tile(frame: np.ndarray, view: int, camera: Camera, tracks: PaintTracks, t: int) -> np.ndarray:
    import cv2

    picture, scale = tile(frame)
    own = tracks.cameras == view
    rest, found = (scale * project(places[own], camera)[0] for places in (tracks.rest, tracks.positions[t]))
    shift = FINE.bit_length() - 1
    seen = np.isfinite(found[:, 0])
    for start, end in zip(rest[seen], found[seen], strict=True):
        before, after = (np.round(FINE * pixel).astype(int).tolist() for pixel in (start, end))
        cv2.line(picture, before, after, WAY, 1, cv2.LINE_AA, shift)
        cv2.circle(picture, after, FINE * RADIUS, FOUND, -1, cv2.LINE_AA, shift)
    words = f"camera {view}, frame {t}: {np.count_nonzero(seen)} of {seen.size} points found"
    draw_text(picture, words, (8, 8), height=14, anchor="lt", color=FOUND)
    return picture
