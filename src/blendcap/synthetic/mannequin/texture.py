"""Bake the paint of skin and parts into one picture."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from blendcap.data import Mesh, triangulate
from blendcap.synthetic.canvas import Canvas, bled, canvas_of, developed
from blendcap.synthetic.mannequin.inside import paint_caruncle, paint_eye, paint_teeth, paint_tongue
from blendcap.synthetic.mannequin.look import Look
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.mannequin.skin import cage_fields, paint_skin

SIZE = 1024  # texels


@lru_cache(maxsize=8)
def painted(look: Look) -> np.ndarray:
    """The texture (SIZE, SIZE, 3) uint8 of a look, sRGB, row 0 on top."""
    linear = np.tile(np.asarray(look.skin, dtype=np.float32), (SIZE, SIZE, 1))
    paints = {
        "skin": lambda values: paint_skin(values[:, :3], values[:, 3:], look),
        "eye": lambda values: paint_eye(values, look.iris),
        "caruncle": paint_caruncle,
        "upper_teeth": paint_teeth,
        "lower_teeth": paint_teeth,
        "tongue": paint_tongue,
    }
    for kind, where, values in _pieces():
        linear[where] = paints[kind](values)
    texture = bled(developed(linear), canvas())
    texture.flags.writeable = False
    return texture


@lru_cache(maxsize=1)
def canvas() -> Canvas:
    """The texels of the mannequin; triangles are those of skin and parts, one after the other."""
    atlas = shared().atlas
    return canvas_of(atlas.uv, triangulate(atlas.quads), SIZE)


@lru_cache(maxsize=1)
def plain_mesh() -> Mesh:
    """The skin of the plain person, with its uv."""
    head = shared()
    quads = head.atlas.quads[: len(head.surface.quads)]
    faces = triangulate(head.surface.quads)
    return Mesh(head.rest, faces, head.surface.quads, head.atlas.uv, triangulate(quads))


@lru_cache(maxsize=1)
def skin_table() -> np.ndarray:
    """Place (mm) and fields (V, 9) of the plain person's skin: what its paint depends on."""
    head = shared()
    return np.concatenate([head.rest, head.surface.matrix @ cage_fields(head.cage)], 1)


@lru_cache(maxsize=1)
def _pieces() -> list[tuple[str, tuple[np.ndarray, np.ndarray], np.ndarray]]:
    """Each piece: its kind, its texels, and the values that their color depends on."""
    head, whole = shared(), canvas()
    tables = [("skin", head.surface.quads, skin_table())]
    tables += [(part.kind, part.quads, part.local) for part in head.parts]
    pieces, first = [], 0
    for kind, quads, values in tables:
        own = triangulate(quads)
        here = whole.part((whole.faces >= first) & (whole.faces < first + len(own)))
        pieces.append((kind, here.where, here._replace(faces=here.faces - first).mixed(values, own)))
        first += len(own)
    return pieces
