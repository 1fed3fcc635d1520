"""Video files, read a frame at a time."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blendcap.data import InputError
from blendcap.io.opening import existing_file

_STREAM = re.compile(r"Stream #\d+:\d+.*: Video: .*?, (\d{1,5})x(\d{1,5})\b(?:.*?, ([\d.]+)(k?) fps)?")
_FRAMES = re.compile(r"frame=\s*(\d+)")
_TURNED = re.compile(r"rotation of -?(?:90|270)\.")
_HEAR = ["-hide_banner", "-nostdin", "-xerror"]  # stop at the first error instead of going on without a frame


@dataclass(frozen=True)
class Video:
    """A video file. Its pictures stay on disk until they are asked for.

    Parameters
    ----------
    path : Path
    size : (width, height)
        Pixels, as shown: a phone's turned film counts as turned.
    rate : float
        Frames a second; the mean where they are not evenly spaced.
    count : int
        Frames.
    """

    path: Path
    size: tuple[int, int]
    rate: float
    count: int

    def frames(self, *, grey: bool = False) -> Iterator[np.ndarray]:
        """The pictures in order, (H, W, 3) uint8 sRGB, or their brightness (H, W) uint8.

        Each call starts at the first one. Memory does not grow with the length.

        Raises
        ------
        InputError
            If a frame is damaged or missing.
        """
        import imageio_ffmpeg

        pixels = [
            "-map",
            "0:v:0",
            "-fps_mode",
            "passthrough",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "gray" if grey else "rgb24",
        ]
        source = ["-v", "error", *_HEAR, "-i", str(self.path)]
        command = [imageio_ffmpeg.get_ffmpeg_exe(), *source, *pixels, "-"]
        shape = (self.size[1], self.size[0]) if grey else (self.size[1], self.size[0], 3)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert process.stdout is not None
        number = 0
        try:
            while len(content := process.stdout.read(int(np.prod(shape)))) == np.prod(shape):
                yield np.frombuffer(content, dtype=np.uint8).reshape(shape)
                number += 1
            if content or process.wait() or number != self.count:
                raise InputError(
                    f"Cannot read {self.path}: frame {number} of {self.count} is damaged; export the video again."
                )
        finally:
            process.kill()
            process.stdout.close()
            process.wait()


def read_video(path: str | os.PathLike) -> Video:
    """Open a video of any kind that ffmpeg knows and count its frames, without decoding them.

    Raises
    ------
    InputError
        If there is no such file, it holds no video, or it is cut short.
    """
    import imageio_ffmpeg

    path = existing_file(path)
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(),
        *_HEAR,
        "-i",
        str(path),
        "-map",
        "0:v:0",
        "-c",
        "copy",
        "-f",
        "null",
        "-",
    ]
    with tempfile.TemporaryFile() as heard:
        code = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=heard, check=False).returncode
        heard.seek(0)
        said = heard.read().decode(errors="replace")
    stream, counts = _STREAM.search(said), _FRAMES.findall(said)
    if stream is None:
        raise InputError(f"Cannot read {path}: it holds no video, or its end is missing; export it again.")
    count = int(counts[-1]) if counts else 0
    if code or not count or _ends_early(path):
        raise InputError(f"Cannot read {path}: the video is cut short after {count} frames; copy or export it again.")
    if stream[3] is None:
        raise InputError(f"Cannot read {path}: it does not say how many frames a second it has; export it again.")
    width, height = int(stream[1]), int(stream[2])
    rate = float(stream[3]) * (1000 if stream[4] else 1)
    return Video(path, (height, width) if _TURNED.search(said) else (width, height), _exact(rate), count)


def _ends_early(path: Path) -> bool:
    """Whether a box of an MP4 or MOV reaches beyond the file: ffmpeg is silent if it is cut between two frames."""
    end, place = path.stat().st_size, 0
    with path.open("rb") as file:
        while place + 8 <= end:
            file.seek(place)
            head = file.read(16)
            size, kind = int.from_bytes(head[:4], "big"), head[4:8]
            if place == 0 and kind not in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
                return False  # another kind of file
            size = int.from_bytes(head[8:], "big") if size == 1 else size
            if size < 8:  # 0: to the end of the file
                return False
            place += size
    return place > end


def _exact(rate: float) -> float:
    """23.98 is ffmpeg's way to write 24000 / 1001."""
    ntsc = round(rate) * 1000 / 1001
    return ntsc if abs(rate - ntsc) < 0.006 and abs(rate - round(rate)) > 0.006 else rate
