"""An animated face beside the film that it was taken from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from blendcap.data import Animation, InputError, Rig
from blendcap.io.video import Video
from blendcap.io.video_write import write_video
from blendcap.view.film import Film, pictures, reporting

FACE = Film((486, 540), (0.0,))  # how the face is shown beside a film
WIDEST = 16 / 9  # of a film's picture; a wider one is fitted in


def write_beside_film(
    path: str | Path,
    rig: Rig,
    animation: Animation,
    video: Video,
    film: Film = FACE,
    *,
    offset: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write a film: to the left the video at the same moment, to the right the animated face. Returns its frames.

    Parameters
    ----------
    path : path
        `.mp4` or `.gif`.
    film : Film
        How the face is shown; the video is as high.
    offset : float
        When the animation begins in the video, s. Where the video has no picture it is black.
    progress : callable (frames done, frames in all), optional

    Raises
    ------
    InputError
        If the video shows nothing of the animation's time, the animation has a shape that the rig has not, or the file
        cannot be written.
    """
    times, height = film.times(animation), film.size[1]
    wanted = np.floor((times - times[0] + offset) * video.rate + 0.5).astype(int)
    if not ((wanted >= 0) & (wanted < video.count)).any():
        raise InputError(
            f"{video.path} lasts {video.count / video.rate:.1f} s and has no picture of the animation, which begins at "
            f"{offset:g} s of it; give the offset at which it begins."
        )
    width = 2 * round(height * min(video.size[0] / video.size[1], WIDEST) / 2)
    left = (_fitted(picture, (width, height)) for picture in pictures_at(video, wanted))
    pairs = (np.hstack(pair) for pair in zip(left, pictures(rig, animation, film), strict=True))
    size = (width + film.size[0], height)
    return write_video(path, reporting(pairs, len(wanted), progress), film.rate(animation), size)


def pictures_at(video: Video, wanted: np.ndarray) -> Iterator[np.ndarray]:
    """The pictures of a video with these numbers (T,), in rising order; black where it has none."""
    black, frames, at = np.zeros((video.size[1], video.size[0], 3), np.uint8), video.frames(), -1
    picture = black
    for number in wanted.tolist():
        if not 0 <= number < video.count:
            yield black
            continue
        while at < number:
            picture, at = next(frames), at + 1
        yield picture


def _fitted(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The picture in the middle of one of another size (width, height), black around it."""
    scale = min(size[0] / picture.shape[1], size[1] / picture.shape[0])
    small = (max(round(picture.shape[1] * scale), 1), max(round(picture.shape[0] * scale), 1))
    resized = cv2.resize(picture, small, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    result = np.zeros((size[1], size[0], 3), np.uint8)
    x, y = (size[0] - small[0]) // 2, (size[1] - small[1]) // 2
    result[y : y + small[1], x : x + small[0]] = resized
    return result
