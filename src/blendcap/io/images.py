"""Pictures: any usual file in, PNG out."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np

from blendcap.data import InputError
from blendcap.io.atomic import write_whole


def png(picture: np.ndarray) -> bytes:
    """A picture (H, W, 3) or grey (H, W), uint8, as a PNG file's bytes."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "png")
    return buffer.getvalue()


def decoded(content: bytes | memoryview) -> np.ndarray | None:
    """The picture (H, W, 3) uint8 in a file's bytes, row 0 on top; None if they are no picture that can be read."""
    import cv2

    try:
        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    return None if picture is None else np.ascontiguousarray(picture[..., ::-1])


def write_image(path: str | os.PathLike, picture: np.ndarray) -> None:
    """Write a picture (H, W, 3) or grey (H, W), uint8, as PNG."""
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"Cannot write {path} as a picture; end its name with .png.")
    with write_whole(path) as temporary:
        temporary.write_bytes(png(picture))
