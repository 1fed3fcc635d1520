"""Put the mannequin together: surface, person, shapes, parts and paint become one Rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral

import numpy as np

from blendcap.data import InputError, Mesh, Rig, triangulate
from blendcap.data.facs import ARKIT_NAMES, SHAPE_NAMES, SHAPES
from blendcap.data.names import mirror_map
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import make_person, measures_of
from blendcap.synthetic.mannequin.landmarks import landmarks, markers
from blendcap.synthetic.mannequin.look import LOOKS, Look, draw_look
from blendcap.synthetic.mannequin.parts import Part, dental_arch, make_parts, part_shapes
from blendcap.synthetic.mannequin.shapes import cage_shapes
from blendcap.synthetic.mannequin.shared import Shared, shared
from blendcap.synthetic.mannequin.texture import painted

_PART_REGIONS = {"eye": "eyes", "caruncle": "sockets", "upper_teeth": "teeth", "lower_teeth": "teeth",
                 "tongue": "tongue"}  # fmt: skip


def mannequin(identity: int | str | Mapping[str, float] = 0, shapes: int = 140) -> Rig:
    """The mannequin, a complete head with 140 shapes or the 52 of ARKit.

    Parameters
    ----------
    identity : int, str or {measure: mm}
        A seed (0 is the plain person), a name in `PEOPLE`, or measures by name (see `MEASURES` and `ASYMMETRIES`;
        the others stay 0).
    shapes : int
        140, all of `blendcap.data.facs.SHAPES`, or 52, the first of them: ARKit's.

    Returns
    -------
    Rig
        Skin of quads with its eyes, teeth and tongue, uv and a texture; `regions`, `contacts` (lips, lids_left,
        lids_right), `mirror`, `combinations` and the points "landmarks68" and "markers50". Lips meet in the neutral
        face and at jawOpen + mouthClose, lids at eyeBlink, exactly. Without asymmetry the right half mirrors the
        left; the mirror map pairs shapes in any case.

    Raises
    ------
    InputError
        If the identity is unknown or out of bounds, or there is no such set of shapes.
    """
    if shapes not in (len(ARKIT_NAMES), len(SHAPE_NAMES)):
        raise InputError(f"The mannequin comes with 140 shapes or with ARKit's 52, but {shapes!r} were asked for.")
    names = SHAPE_NAMES[:shapes]
    measures = measures_of(identity)
    head = shared()
    person = make_person(head.cage, measures)
    face, parts = Face(head.cage, person), make_parts(person)
    mesh = _mesh(head, face, parts, _look_of(identity))
    mirror = mirror_map(names)
    points = {"landmarks68": landmarks(head.cage, mesh, head.surface.middles), "markers50": markers(head.cage, mesh)}
    return Rig(
        mesh=mesh,
        deltas=_deltas(head, face, parts, names, mirror),
        names=names,
        mirror=mirror,
        combinations={shape.name: shape.drivers for shape in SHAPES[:shapes] if shape.drivers},
        points=points,
        regions={**head.regions, **_part_regions(parts, head)},
        contacts=head.contacts,
        name=f"mannequin {identity}" if isinstance(identity, (str, Integral)) and identity != 0 else "mannequin",
    )


def _look_of(identity: int | str | Mapping[str, float]) -> Look:
    """A seed draws a look too; 0, and measures alone, have the plain one."""
    if isinstance(identity, str):
        return LOOKS[identity]
    return draw_look(int(identity)) if isinstance(identity, Integral) and identity != 0 else Look()


def _mesh(head: Shared, face: Face, parts: list[Part], look: Look) -> Mesh:
    cage, bend = head.cage.mirrored(face.points), face.person.bend
    skin = head.surface.evened(head.surface.through(cage) + head.auricles)
    if bend:
        skin = skin + head.surface.through(bend.displacement(cage))
    vertices, quads = [skin], [head.surface.quads]
    for part in parts:
        quads.append(part.quads + sum(map(len, vertices)))
        vertices.append(part.vertices + bend.displacement(part.vertices))
    polygons = np.concatenate(quads)
    uv_faces = triangulate(head.atlas.quads)
    return Mesh(np.concatenate(vertices), triangulate(polygons), polygons, head.atlas.uv, uv_faces, painted(look))


def _deltas(head: Shared, face: Face, parts: list[Part], names: Sequence[str], mirror: np.ndarray) -> np.ndarray:
    """Displacements (N, V, 3) float32 of skin and parts; without asymmetry, a shape and its mirror image mirror."""
    cage, bend = head.cage.mirrored(face.points), face.person.bend
    rest = head.surface.through(cage)
    left = triangulate(head.surface.quads[: len(head.surface.quads) // 2])
    moved = cage_shapes(face, dental_arch(parts), rest, left)
    steps = np.stack([moved[name] for name in names], 1)
    if bend:
        skin = head.surface.through(np.einsum("pij,pnj->pni", bend.turns(cage), steps))
    else:
        skin = head.surface.through(steps)
        skin = 0.5 * (skin + head.surface.reflected(skin)[:, mirror])
    of_parts, pieces = part_shapes(parts, face.person), np.concatenate([part.vertices for part in parts])
    deltas = np.zeros((len(names), len(skin) + len(pieces), 3), dtype=np.float32)
    deltas[:, : len(skin)] = skin.transpose(1, 0, 2)
    turns = bend.turns(pieces)
    for row, name in enumerate(names):
        if name in of_parts:
            deltas[row, len(skin) :] = np.einsum("pij,pj->pi", turns, of_parts[name])
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
