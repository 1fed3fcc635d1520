"""Put the mannequin together: surface, person, shapes, parts and paint become one Rig."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Integral

import numpy as np

from blendcap.data import InputError, Mesh, Rig, triangulate
from blendcap.synthetic.mannequin import shapes as arkit
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import make_person, measures_of
from blendcap.synthetic.mannequin.landmarks import landmarks, markers
from blendcap.synthetic.mannequin.parts import Part, make_parts, part_shapes
from blendcap.synthetic.mannequin.shared import Shared, shared
from blendcap.synthetic.mannequin.skin import LOOKS, Look
from blendcap.synthetic.mannequin.texture import painted

_PART_REGIONS = {"eye": "eyes", "caruncle": "sockets", "upper_teeth": "teeth", "lower_teeth": "teeth",
                 "tongue": "tongue"}  # fmt: skip


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
        Skin of quads with its eyes, teeth and tongue, uv and a texture; `regions`, `contacts` (lips, lids_left,
        lids_right), `mirror`, `combinations` and the points "landmarks68" and "markers50". Lips meet in the neutral
        face and at jawOpen + mouthClose, lids at eyeBlink, exactly. The right half mirrors the left.

    Raises
    ------
    InputError
        If the identity is unknown or out of bounds, or there is no such set of shapes.
    """
    if shapes != len(arkit.ARKIT):
        raise InputError(f"The mannequin comes with {len(arkit.ARKIT)} shapes, but {shapes!r} were asked for.")
    measures = measures_of(identity)
    head = shared()
    person = make_person(head.cage, measures)
    face, parts = Face(head.cage, person), make_parts(person)
    mesh = _mesh(head, face, parts, _look_of(identity))
    place = {name: i for i, name in enumerate(arkit.ARKIT)}
    mirror = np.array([place[arkit.mirror_of(name)] for name in arkit.ARKIT])
    points = {"landmarks68": landmarks(head.cage, mesh, head.surface.middles), "markers50": markers(head.cage, mesh)}
    return Rig(
        mesh=mesh,
        deltas=_deltas(head, face, parts, mirror),
        names=arkit.ARKIT,
        mirror=mirror,
        combinations={"mouthClose": ("jawOpen",)},
        points=points,
        regions={**head.regions, **_part_regions(parts, head)},
        contacts=head.contacts,
        name=f"mannequin {identity}" if isinstance(identity, (str, Integral)) and identity != 0 else "mannequin",
    )


def _look_of(identity: int | str | Mapping[str, float]) -> Look:
    """Seeds take turns with the looks; measures alone say nothing about color."""
    if isinstance(identity, str):
        return LOOKS[identity]
    return tuple(LOOKS.values())[int(identity) % len(LOOKS)] if isinstance(identity, Integral) else Look()


def _mesh(head: Shared, face: Face, parts: list[Part], look: Look) -> Mesh:
    skin = head.surface.evened(head.surface.through(head.cage.mirrored(face.points)) + head.auricles)
    vertices, quads = [skin], [head.surface.quads]
    for part in parts:
        quads.append(part.quads + sum(map(len, vertices)))
        vertices.append(part.vertices)
    polygons = np.concatenate(quads)
    uv_faces = triangulate(head.atlas.quads)
    return Mesh(np.concatenate(vertices), triangulate(polygons), polygons, head.atlas.uv, uv_faces, painted(look))


def _deltas(head: Shared, face: Face, parts: list[Part], mirror: np.ndarray) -> np.ndarray:
    """Displacements (N, V, 3) float32 of skin and parts; a shape and its mirror image mirror each other exactly."""
    moved = arkit.cage_shapes(face)
    skin = head.surface.through(np.stack(list(moved.values()), 1))
    skin = 0.5 * (skin + head.surface.reflected(skin)[:, mirror])
    of_parts = part_shapes(parts, face.person)
    total = sum(len(part.vertices) for part in parts)
    deltas = np.zeros((len(moved), len(skin) + total, 3), dtype=np.float32)
    deltas[:, : len(skin)] = skin.transpose(1, 0, 2)
    for row, name in enumerate(moved):
        if name in of_parts:
            deltas[row, len(skin) :] = of_parts[name]
    return deltas


def _part_regions(parts: list[Part], head: Shared) -> dict[str, np.ndarray]:
    regions: dict[str, np.ndarray] = {}
    start = len(head.rest)
    for part in parts:
        own = np.arange(start, start + len(part.vertices))
        name = _PART_REGIONS[part.kind]
        regions[name] = np.concatenate([regions.get(name, head.regions.get(name, own[:0])), own])
        start += len(part.vertices)
    return regions
