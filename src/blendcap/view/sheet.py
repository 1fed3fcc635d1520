"""A contact sheet: the neutral face from three sides, and each shape on its own with its name and where it moves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import sqrt
from pathlib import Path

import numpy as np

from blendcap.data import Camera, Rig
from blendcap.data.correctives import needs
from blendcap.io.images import write_image
from blendcap.rendering import Surface, face_camera, prepare_rig, shaped
from blendcap.view.heatmap import MATT
from blendcap.view.image import draw_text, text_width
from blendcap.view.posing import framed_vertices

SIDES = {"front": 0.0, "three-quarter": 0.7, "side": 1.5708}  # yaw, rad
FACE = 3.0  # mm: what a shape moves by more belongs to the face that fills a cell
TALL, SCREEN = 1.2, 1.6  # a cell's height over its width; the sheet's width over its height, unless columns are given
HEAT = 0.30  # of a cell's width: the small face that shows where a shape moves
NAME, LENGTH = 13, 18  # letters in the height of a cell: of a name, and of how far it moves
STILL, MOVES = np.array([0.80, 0.81, 0.83]), np.array([0.84, 0.12, 0.10])  # sRGB


def write_contact_sheet(path: str | Path, rig: Rig, *, columns: int | None = None, cell: int = 240) -> None:
    """Write the contact sheet of a rig as PNG; see `contact_sheet`."""
    write_image(path, contact_sheet(rig, columns=columns, cell=cell))


def contact_sheet(rig: Rig, *, columns: int | None = None, cell: int = 240) -> np.ndarray:
    """Picture (H, W, 3) uint8 of the neutral from three sides and of each shape at its highest weight.

    The cell of a shape shows the face without the skull, how far the shape moves the skin, mm, and a small face that is
    redder the more a place moves, up to that.

    Parameters
    ----------
    columns : int, optional
        Faces in a row; as many as give the sheet the form of a screen if not given.
    cell : int
        Width of a face, pixels.
    """
    size = (cell, round(cell * TALL))
    cells = list(_cells(rig, size))
    columns = columns or round(sqrt(SCREEN * TALL * len(cells)))
    blank = np.full_like(cells[0], 205)
    cells += [blank] * (-len(cells) % columns)
    return np.vstack([np.hstack(cells[start : start + columns]) for start in range(0, len(cells), columns)])


def _cells(rig: Rig, size: tuple[int, int]) -> Iterator[np.ndarray]:
    neutral, framed = prepare_rig(rig), framed_vertices(rig)
    for name, yaw in SIDES.items():
        yield _named(neutral.picture(face_camera(framed, size, yaw), size), name)
    part = (round(HEAT * size[0]), round(HEAT * size[1]))
    camera, small = (face_camera(reach(rig), pixels) for pixels in (size, part))
    for n, name in enumerate(rig.names):
        weights = np.zeros(len(rig.names))
        weights[[rig.index(other) for other in needs(rig, name)]] = 1
        weights[n] = rig.bounds[n, 1]
        surface = shaped(neutral, rig, weights)
        picture = surface.picture(camera, size)
        moved = weights[n] * np.linalg.norm(rig.deltas[n], axis=1)
        picture[-part[1] :, -part[0] :] = _heat(surface, moved, small, part)
        yield _described(picture, name, moved.max(initial=0))


def reach(rig: Rig) -> np.ndarray:
    """Points (K, 3), mm, around all that the shapes do to the face: it without skull and neck, and the opened jaw."""
    moving = rig.moving_vertices(FACE)
    if not len(moving):
        return rig.mesh.vertices
    still, deltas = rig.mesh.vertices[moving], rig.deltas[:, moving]
    return np.concatenate([still + np.minimum(deltas.min(0), 0), still + np.maximum(deltas.max(0), 0)])


def _heat(surface: Surface, moved: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """A small picture of a shape, redder where it moved by more, (V,) mm."""
    share = (moved / max(moved.max(initial=0), 1e-9))[:, None]
    return surface.painted(STILL + share * (MOVES - STILL)).picture(camera, size, light=MATT)


def _named(picture: np.ndarray, name: str) -> np.ndarray:
    """Write a name into the foot of a cell."""
    height, width = picture.shape[:2]
    letters = _letters([name], picture, 0.96)
    draw_text(picture, name, (width // 2, height - height // 30), height=letters, anchor="ms")
    return picture


def _described(picture: np.ndarray, name: str, moved: float) -> np.ndarray:
    """Write the name of a shape, and under it how far it moves, into the left of the foot of a cell."""
    height, width = picture.shape[:2]
    far, left, bottom = f"{moved:.1f} mm" if moved >= 0.05 else "under 0.05 mm", width // 40, height - height // 40
    lines, small = _halves(name), max(height // LENGTH, 6)
    lines = lines if text_width(name, height // NAME) > (0.97 - HEAT) * width else [name]
    letters = _letters(lines, picture, 0.97 - HEAT)
    draw_text(picture, far, (left, bottom), height=small, anchor="ls")
    for k, line in enumerate(reversed(lines)):
        draw_text(picture, line, (left, bottom - round(1.2 * (small + k * letters))), height=letters, anchor="ls")
    return picture


def _halves(name: str) -> list[str]:
    """A name in two lines, parted before the word nearest to its middle; in one line if it is one word."""
    starts = [found.start() for found in re.finditer(r"(?<=[^_.A-Z])[A-Z_.]", name)]
    if not starts:
        return [name]
    middle = min(starts, key=lambda start: abs(2 * start - len(name)))
    return [name[:middle], name[middle:]]


def _letters(lines: list[str], picture: np.ndarray, share: float) -> int:
    """The height of letters, pixels, with which lines fit into a share of a picture's width."""
    letters = picture.shape[0] // NAME
    while letters > 6 and max(text_width(line, letters) for line in lines) > share * picture.shape[1]:
        letters -= 1
    return letters
