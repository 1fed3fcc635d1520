"""Annotated pictures for training a landmark detector, and the detector that came of them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from blendcap.data import InputError, LandmarkModel
from blendcap.io.models import read_model, write_model
from blendcap.io.opening import read_bytes, read_json, reading

RECTANGLES = "rectangles.json"
KIND, VERSION = "landmark model", 1


def read_annotated(folder: str | os.PathLike) -> tuple[list[np.ndarray], list[dict[str, tuple[float, ...]]]]:
    """Pictures (H, W, 3) uint8 of a folder and their rectangles {name: (left, top, width, height)}, pixels.

    The folder's `rectangles.json` is `{"face01.png": {"nose_tip": [left, top, width, height], ...}, ...}`; a rectangle
    is centered on its point. Pictures that it does not name are left out.
    """
    folder = Path(folder)
    with reading(folder / RECTANGLES, "file of rectangles"):
        content = read_json(folder / RECTANGLES)
        if not isinstance(content, dict) or not content:
            raise InputError(
                f'{folder / RECTANGLES} must be {{"picture.png": {{"nose_tip": [left, top, w, h]}}, ...}}.'
            )
        images, rectangles = [], []
        for file, own in content.items():
            if Path(file).name != file:
                raise InputError(f"{folder / RECTANGLES} names the picture {file!r}; put it into this folder.")
            images.append(_picture(folder / file))
            rectangles.append({str(name): tuple(float(v) for v in box) for name, box in own.items()})
        return images, rectangles


def read_landmark_model(path: str | os.PathLike) -> LandmarkModel:
    """A detector from an .npz that `write_landmark_model` wrote."""
    return LandmarkModel.from_arrays(read_model(path, KIND, VERSION)[1])


def write_landmark_model(path: str | os.PathLike, model: LandmarkModel) -> None:
    """Write a detector as .npz; its filters keep half precision."""
    write_model(path, KIND, VERSION, {"unit": "pixel"}, model.arrays())


def _picture(path: Path) -> np.ndarray:
    import cv2

    picture = cv2.imdecode(np.frombuffer(read_bytes(path), np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise InputError(f"Cannot read {path}: it is no picture; save it as PNG or JPEG.")
    return np.ascontiguousarray(picture[..., ::-1])
