"""Bake the paint of skin and parts into one picture. Left and right mirror, so only half of the skin is painted."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np
from scipy.ndimage import distance_transform_edt

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

SIZE = 1024


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
    """Give each unpainted texel near paint the color of the nearest painted one, for the sake of interpolation."""
    near, nearest = _margin()
    linear[near] = linear[nearest]


@lru_cache(maxsize=1)
def _margin() -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    bare = np.ones((SIZE, SIZE), dtype=bool)
    for texels in _texels():
        bare[texels.where] = False
    bare[: round((1 - FLOOR) * SIZE), : SIZE // 2] = False  # the half that will be a copy
    distance, nearest = cast(tuple[np.ndarray, np.ndarray], distance_transform_edt(bare, return_indices=True))
    near = np.nonzero(bare & (distance < 4))
    return near, (nearest[0][near], nearest[1][near])


@lru_cache(maxsize=1)
def _texels() -> list[_Texels]:
    head = shared()
    pixels = head.atlas.uv * [SIZE, -SIZE] + [-0.5, SIZE - 0.5]
    flat = np.concatenate([pixels, np.ones((len(pixels), 1))], 1)  # a plane at distance 1: pixels are coordinates
    seen = rasterize(flat, triangulate(head.atlas.quads), Camera(np.eye(3), np.eye(4)), (SIZE, SIZE))
    seen.face[: round((1 - FLOOR) * SIZE), : SIZE // 2] = -1
    fields = head.surface.matrix @ cage_fields(head.cage)
    pieces = [("skin", head.surface.quads, np.concatenate([head.rest, fields], 1))]
    pieces += [(part.kind, part.quads, part.local) for part in head.parts]
    texels, first = [], 0
    for kind, quads, values in pieces:
        triangles = triangulate(quads)
        where = np.nonzero((seen.face >= first) & (seen.face < first + len(triangles)))
        corners, weights = triangles[seen.face[where] - first], seen.barycentric[where].astype(np.float32)
        table = values.astype(np.float32)
        mixed = sum(weights[:, k, None] * table[corners[:, k]] for k in range(3))
        texels.append(_Texels(kind, where, np.asarray(mixed)))
        first += len(triangles)
    return texels
