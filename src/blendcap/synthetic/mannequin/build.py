"""Put the mannequin together: cage, person, shapes, skin and parts become one Rig."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from blendcap.data import InputError, Mesh, Rig, triangulate
from blendcap.synthetic.mannequin import shapes as arkit
from blendcap.synthetic.mannequin.cage import Cage, head_cage, ring
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import make_person, measures_of
from blendcap.synthetic.mannequin.landmarks import landmarks, markers
from blendcap.synthetic.mannequin.parts import Part, make_parts, part_shapes
from blendcap.synthetic.mannequin.regions import skin_regions
from blendcap.synthetic.mannequin.subdivision import Surface, subdivide

_PART_REGIONS = {
    "eye": "eyes",
    "caruncle": "sockets",
    "upper_teeth": "teeth",
    "lower_teeth": "teeth",
    "tongue": "tongue",
}

_CONTACTS = ("lips", "lids_left", "lids_right")


class Skin(NamedTuple):
    """What all mannequins share."""

    cage: Cage
    surface: Surface
    regions: Mapping[str, np.ndarray]
    contacts: Mapping[str, np.ndarray]


def mannequin(identity: int | str | Mapping[str, float] = 0, shapes: int = 52) -> Rig:
    """The mannequin, a complete head with the shapes of ARKit.

    Parameters
    ----------
    identity : int, str or {measure: mm}
        A seed (0 is the plain person), a name in `PEOPLE`, or measures by name (see `MEASURES`; the others stay 0).
    shapes : int
        How many shapes: 52.

    Returns
    -------
    Rig
        Skin of quads with its eyes, teeth and tongue; `regions`, `contacts` (lips, lids_left, lids_right), `mirror`,
        `combinations` and the points "landmarks68" and "markers50". Lips meet in the neutral face and at
        jawOpen + mouthClose, lids at eyeBlink, exactly.

    Raises
    ------
    InputError
        If the identity is unknown or out of bounds, or there is no such set of shapes.
    """
    if shapes != len(arkit.ARKIT):
        raise InputError(f"The mannequin comes with {len(arkit.ARKIT)} shapes, but {shapes!r} were asked for.")
    skin = shared_skin()
    person = make_person(skin.cage, measures_of(identity))
    face = Face(skin.cage, person)
    parts = make_parts(person)
    mesh = _mesh(skin, face, parts)
    names = arkit.ARKIT
    place = {name: i for i, name in enumerate(names)}
    return Rig(
        mesh=mesh,
        deltas=_deltas(skin, face, parts),
        names=names,
        mirror=np.array([place[arkit.mirror_of(name)] for name in names]),
        combinations={"mouthClose": ("jawOpen",)},
        points={
            "landmarks68": landmarks(skin.cage, mesh, skin.surface.middles),
            "markers50": markers(skin.cage, mesh),
        },
        regions={**skin.regions, **_part_regions(parts, skin)},
        contacts=skin.contacts,
        name="mannequin" if identity == 0 else f"mannequin {identity}",
    )


@lru_cache(maxsize=1)
def shared_skin() -> Skin:
    """Cage, subdivision, regions and contacts; they are the same for every identity."""
    cage = head_cage()
    lips = [_both(cage, ring("seam", range(5))), _both(cage, ring("seam", range(8, 3, -1)))]
    lids = [cage.index(ring("margin", range(7))), cage.index(ring("margin", (0, 11, 10, 9, 8, 7, 6)))]
    chains = [*lips, *lids, *(cage.twin[chain] for chain in lids)]
    surface = subdivide(cage.size, cage.quads, cage.sharpness, cage.corners, chains)
    pairs = [np.stack(surface.chains[k : k + 2], 1) for k in (0, 2, 4)]
    contacts = {name: pair[pair[:, 0] != pair[:, 1]] for name, pair in zip(_CONTACTS, pairs, strict=True)}
    return Skin(cage, surface, skin_regions(cage, surface), contacts)


def _both(cage: Cage, names: list[str]) -> np.ndarray:
    """A chain from the midline to the left corner, continued to the right corner."""
    left = cage.index(names)
    return np.concatenate([cage.twin[left[:0:-1]], left])


def _mesh(skin: Skin, face: Face, parts: list[Part]) -> Mesh:
    vertices, quads = [skin.surface.through(skin.cage.mirrored(face.points))], [skin.surface.quads]
    for part in parts:
        quads.append(part.quads + sum(map(len, vertices)))
        vertices.append(part.vertices)
    polygons = np.concatenate(quads)
    return Mesh(np.concatenate(vertices), triangulate(polygons), polygons)


def _deltas(skin: Skin, face: Face, parts: list[Part]) -> np.ndarray:
    moved = arkit.cage_shapes(face)
    on_skin = skin.surface.through(np.stack(list(moved.values()), 1))
    of_parts = part_shapes(parts, face.person)
    total = sum(len(part.vertices) for part in parts)
    deltas = np.zeros((len(moved), len(on_skin) + total, 3), dtype=np.float32)
    deltas[:, : len(on_skin)] = on_skin.transpose(1, 0, 2)
    for row, name in enumerate(moved):
        if name in of_parts:
            deltas[row, len(on_skin) :] = of_parts[name]
    return deltas


def _part_regions(parts: list[Part], skin: Skin) -> dict[str, np.ndarray]:
    regions: dict[str, np.ndarray] = {}
    start = skin.surface.matrix.shape[0]
    for part in parts:
        own = np.arange(start, start + len(part.vertices))
        name = _PART_REGIONS[part.kind]
        regions[name] = np.concatenate([regions.get(name, skin.regions.get(name, own[:0])), own])
        start += len(part.vertices)
    return regions
