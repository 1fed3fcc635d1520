"""Pictures over time: MP4, GIF or a numbered sequence of PNG."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterable
from itertools import chain
from pathlib import Path

import numpy as np

from blendcap.data import InputError
from blendcap.io.atomic import write_whole
from blendcap.io.images import write_image

FOR_PEOPLE, FOR_PROGRAMS = 19, 8  # H.264's constant rate factor
MP4 = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-preset", "veryfast", "-movflags", "+faststart", "-crf"]
# a palette of its own for each frame, so that ffmpeg need not hold the whole film to choose one
GIF = ["-vf", "split[a][b];[a]palettegen=stats_mode=single[p];[b][p]paletteuse=new=1:dither=bayer", "-loop", "0"]


def write_video(
    path: str | os.PathLike,
    frames: Iterable[np.ndarray],
    rate: float,
    size: tuple[int, int],
    *,
    loss: int = FOR_PEOPLE,
) -> int:
    """Write pictures as they come and return their number; memory does not grow with the length.

    Parameters
    ----------
    path : path
        `.mp4` (H.264, plays in browsers), `.gif`, or `.png` (a sequence: `face.png` becomes `face.0000.png` ...).
    frames : iterable of (H, W, 3) or grey (H, W) uint8
    rate : float
        Frames a second.
    size : (width, height)
        Pixels; both even for `.mp4`.
    loss : int
        What an MP4 may lose, 0 to 51, H.264's constant rate factor: 19 looks good to people, 8 keeps what programs
        measure in a picture.

    Raises
    ------
    InputError
        If the ending is another, the size is odd, a frame is not as large as `size` or the file cannot be written.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".png":
        return _write_sequence(path, frames)
    if ending not in (".mp4", ".gif"):
        raise InputError(f"Cannot write {path} as a video; end its name with .mp4, .gif or .png (a sequence).")
    if ending == ".mp4" and (size[0] % 2 or size[1] % 2):
        raise InputError(
            f"An MP4 needs an even width and height, but {size[0]} x {size[1]} was asked for; add a pixel."
        )
    with write_whole(path) as temporary:
        return _encode(temporary, frames, rate, size, [*MP4, str(loss)] if ending == ".mp4" else GIF)


def _write_sequence(path: Path, frames: Iterable[np.ndarray]) -> int:
    count = 0
    for frame in frames:
        write_image(path.with_name(f"{path.stem}.{count:04d}.png"), frame)
        count += 1
    return count


def _encode(path: Path, frames: Iterable[np.ndarray], rate: float, size: tuple[int, int], codec: list[str]) -> int:
    import imageio_ffmpeg

    frames = iter(frames)
    first = list(zip(range(1), frames, strict=False))  # its kind is the film's
    grey = bool(first) and first[0][1].ndim == 2
    shape = (size[1], size[0]) if grey else (size[1], size[0], 3)
    pixels = ["-pix_fmt", "gray" if grey else "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", f"{rate:.6f}"]
    source = ["-f", "rawvideo", *pixels, "-i", "-"]
    same = ["-fflags", "+bitexact", "-flags:v", "+bitexact"]  # no version, no date: the same frames, the same file
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", *source, *codec, *same, str(path)]
    count = 0
    with tempfile.TemporaryFile() as said:
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said) as process:
            assert process.stdin is not None
            try:
                for frame in chain((frame for _, frame in first), frames):
                    _check(frame, shape, count)
                    process.stdin.write(np.ascontiguousarray(frame))
                    count += 1
                process.stdin.close()
            except BrokenPipeError:
                pass  # ffmpeg gave up; what it said follows
            except BaseException:
                process.kill()
                raise
        if process.returncode:
            said.seek(0)
            reason = said.read().decode(errors="replace").strip().splitlines()
            raise InputError(f"The video could not be written: {reason[-1] if reason else 'ffmpeg stopped'}.")
    return count


def _check(frame: np.ndarray, shape: tuple[int, ...], number: int) -> None:
    if frame.shape != shape or frame.dtype != np.uint8:
        raise InputError(f"Frame {number} is {frame.dtype} {frame.shape}, but the video's are uint8 {shape}.")
