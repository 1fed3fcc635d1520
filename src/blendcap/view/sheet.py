"""A contact sheet: the neutral face from three sides, and each shape on its own with its name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from blendcap.data import Rig
from blendcap.data.correctives import needs
from blendcap.io.images import write_image
from blendcap.rendering import face_camera, prepare_rig, shaped
from blendcap.view.image import draw_text
from blendcap.view.posing import framed_vertices

SIDES = {"front": 0.0, "three-quarter": 0.7, "side": 1.5708}  # yaw, rad


def write_contact_sheet(path: str | Path, rig: Rig, *, columns: int = 8, cell: int = 200) -> None:
    """Write the contact sheet of a rig as PNG; see `contact_sheet`."""
    write_image(path, contact_sheet(rig, columns=columns, cell=cell))


def contact_sheet(rig: Rig, *, columns: int = 8, cell: int = 200) -> np.ndarray:
    """Picture (H, W, 3) uint8 of the neutral from three sides and of each shape at its highest weight.

    Parameters
    ----------
    columns : int
        Faces in a row.
    cell : int
        Width of a face, pixels.
    """
    size = (cell, round(cell * 1.2))
    cells = list(_cells(rig, size))
    blank = np.full_like(cells[0], 205)
    cells += [blank] * (-len(cells) % columns)
    return np.vstack([np.hstack(cells[start : start + columns]) for start in range(0, len(cells), columns)])


def _cells(rig: Rig, size: tuple[int, int]) -> Iterator[np.ndarray]:
    neutral, framed = prepare_rig(rig), framed_vertices(rig)
    for name, yaw in SIDES.items():
        yield _named(neutral.picture(face_camera(framed, size, yaw), size), name)
    camera = face_camera(framed, size)
    for n, name in enumerate(rig.names):
        weights = np.zeros(len(rig.names))
        weights[[rig.index(other) for other in needs(rig, name)]] = 1
        weights[n] = rig.bounds[n, 1]
        yield _named(shaped(neutral, rig, weights).picture(camera, size), name)


def _named(picture: np.ndarray, name: str) -> np.ndarray:
    height, width = picture.shape[:2]
    letters = max(min(height // 16, round(1.6 * width / max(len(name), 1))), 6)
    draw_text(picture, name, (width // 2, height - height // 30), height=letters, anchor="ms")
    return picture
