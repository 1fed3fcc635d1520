"""Bake the paint of skin and parts into one picture. Left and right mirror, so only half of the skin is painted."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from blendcap.data import Camera, triangulate
from blendcap.rendering.rasterize import rasterize
from blendcap.synthetic.mannequin.atlas import FLOOR
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.mannequin.skin import (
    Look,
    cage_fields,
    paint_caruncle,
    paint_eye,
    paint_skin,
    paint_teeth,
    paint_tongue,
)

SIZE, BLEED = 1024, 3  # texels


class _Texels(NamedTuple):
    """The texels of one piece: which they are, and the values that their color depends on."""

    kind: str
    where: tuple[np.ndarray, ...]
    values: np.ndarray


@lru_cache(maxsize=8)
def painted(look: Look) -> np.ndarray:
    """The texture (SIZE, SIZE, 3) uint8 of a look, sRGB, row 0 on top."""
    linear = np.tile(np.asarray(look.skin, dtype=np.float32), (SIZE, SIZE, 1))
    paints = {
        "skin": lambda values: paint_skin(values[:, :3], values[:, 3:], look),
        "eye": lambda values: paint_eye(values, look),
        "caruncle": paint_caruncle,
        "upper_teeth": paint_teeth,
        "lower_teeth": paint_teeth,
        "tongue": paint_tongue,
    }
    for texels in _texels():
        linear[texels.where] = paints[texels.kind](texels.values)
    _bleed(linear)
    skin = round((1 - FLOOR) * SIZE)
    linear[:skin, : SIZE // 2] = linear[:skin, : SIZE // 2 - 1 : -1]
    texture = np.round(255 * np.clip(linear, 0.003, 1) ** (1 / 2.2)).astype(np.uint8)
    texture.flags.writeable = False
    return texture


def _bleed(linear: np.ndarray) -> None:
    """Let the colors run a few texels over the borders of their charts, for the sake of interpolation."""
    painted = np.zeros((SIZE, SIZE), dtype=bool)
    for texels in _texels():
        painted[texels.where] = True
    for _ in range(BLEED):
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            beside = np.nonzero(np.roll(painted, step, axis) & ~painted)
            source = [index - step if k == axis else index for k, index in enumerate(beside)]
            linear[beside] = linear[tuple(source)]
            painted[beside] = True


@lru_cache(maxsize=1)
def _texels() -> list[_Texels]:
    head = shared()
    pixels = head.atlas.uv * [SIZE, -SIZE] + [-0.5, SIZE - 0.5]
    flat = np.concatenate([pixels, np.ones((len(pixels), 1))], 1)  # a plane at distance 1: pixels are coordinates
    triangles = triangulate(head.atlas.quads)
    at = head.atlas.uv[triangles]
    wanted = np.flatnonzero((at[:, :, 0] > 0.499).any(1) | (at[:, :, 1] < FLOOR).all(1))
    seen = rasterize(flat, triangles[wanted], Camera(np.eye(3), np.eye(4)), (SIZE, SIZE))
    rows, columns = np.nonzero(seen.face >= 0)
    faces = wanted[seen.face[rows, columns]]
    weights = seen.barycentric[rows, columns].astype(np.float32)
    fields = head.surface.matrix @ cage_fields(head.cage)
    pieces = [("skin", head.surface.quads, np.concatenate([head.rest, fields], 1))]
    pieces += [(part.kind, part.quads, part.local) for part in head.parts]
    texels, first = [], 0
    for kind, quads, values in pieces:
        own, table = triangulate(quads), values.astype(np.float32)
        here = np.flatnonzero((faces >= first) & (faces < first + len(own)))
        corners = own[faces[here] - first]
        mixed = sum(weights[here, k, None] * table[corners[:, k]] for k in range(3))
        texels.append(_Texels(kind, (rows[here], columns[here]), np.asarray(mixed)))
        first += len(own)
    return texels
