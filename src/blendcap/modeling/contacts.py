"""Where lids and lips meet: pairs of vertices that a shape brings together, and which pairs meet in which pose."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import KDTree

from blendcap.data import Rig
from blendcap.data.correctives import needs
from blendcap.data.names import canonical
from blendcap.modeling.parts import pieces
from blendcap.numerics.geodesic import sewn_vertices

MEETS = 1.5  # mm: a pair that comes closer than this meets
PARTED = 3.0  # mm: and this much farther apart they are in the open pose
SPACING = 1.5  # mm between pairs along the line of contact
CLOSES = 0.5  # of the gap: a shape that leaves less closes it, one that leaves more keeps it

# name of the contact: shapes of the closed pose and shapes of an open one, in ARKit's spelling
_POSES: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "lids_left": (("eyeBlinkLeft",), ()),
    "lids_right": (("eyeBlinkRight",), ()),
    "lips": ((), ("jawOpen",)),
    "lips_jaw_open": (("jawOpen", "mouthClose"), ("jawOpen",)),
}


def drivers_of(rig: Rig, name: str) -> tuple[int, ...]:
    """Places of the shapes that `name` makes sense with, from the rig or, if it says nothing, from ARKit's rule."""
    return tuple(rig.index(other) for other in needs(rig, name))


def find_contacts(rig: Rig) -> dict[str, np.ndarray]:
    """Vertex pairs (P, 2) of the skin that meet when lids and lips close, found by proximity in the closing poses.

    Lids meet at `eyeBlinkLeft` and `eyeBlinkRight`; lips at rest, if `jawOpen` parts them, and at `jawOpen` with
    `mouthClose` (`lips_jaw_open`; left out if the pairs of `lips` already meet there). A contact whose shapes the rig
    lacks, in any spelling of ARKit's names, or whose pairs never touch is left out.
    """
    found: dict[str, np.ndarray] = {}
    skin = pieces(sewn_vertices(rig.mesh.vertices, rig.deltas)[rig.mesh.faces], len(rig.mesh.vertices))[0]
    for contact, (closing, opening) in _POSES.items():
        closed, opened = _posed(rig, closing), _posed(rig, opening)
        if closed is None or opened is None:
            continue
        if contact == "lips_jaw_open" and "lips" in found and np.median(gaps(closed, found["lips"])) < MEETS:
            continue
        pairs = _touching(closed[skin], opened[skin])
        if len(pairs):
            found[contact] = skin[pairs]
    return found


def gaps(vertices: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Distance (P,) of each pair, mm."""
    return np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)


def _place(rig: Rig, name: str) -> int | None:
    return next((i for i, own in enumerate(rig.names) if canonical(own) == name), None)


def _posed(rig: Rig, names: tuple[str, ...]) -> np.ndarray | None:
    """Vertices (V, 3) with these shapes at 1; None if the rig lacks one."""
    vertices = rig.mesh.vertices
    for name in names:
        place = _place(rig, name)
        if place is None:
            return None
        vertices = vertices + rig.deltas[place]
    return vertices


def _touching(closed: np.ndarray, opened: np.ndarray) -> np.ndarray:
    """Pairs (P, 2) of vertices, each the other's nearest across the opening, spread along the line of contact."""
    distance, near = KDTree(closed).query(closed, k=min(16, len(closed)), distance_upper_bound=MEETS)
    known = np.isfinite(distance)
    near = np.where(known, near, 0)
    apart = np.linalg.norm(opened[:, None] - opened[near], axis=2) - np.where(known, distance, 0.0)
    across = known & (apart > PARTED)
    first = across.argmax(1)
    partner = np.where(across.any(1), near[np.arange(len(near)), first], -1)
    one = np.flatnonzero((partner >= 0) & (partner[partner] == np.arange(len(partner))))
    one = one[one < partner[one]]
    pairs = np.stack([one, partner[one]], axis=1)
    return _spread(pairs, closed[pairs].mean(1) if len(pairs) else np.zeros((0, 3)), gaps(closed, pairs))


def _spread(pairs: np.ndarray, middles: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """The pairs that touch best, none nearer to another than `SPACING`."""
    kept: list[int] = []
    for i in np.argsort(gap, kind="stable"):
        if not kept or np.linalg.norm(middles[kept] - middles[i], axis=1).min() > SPACING:
            kept.append(int(i))
    return pairs[np.sort(np.array(kept, dtype=np.int64))]
