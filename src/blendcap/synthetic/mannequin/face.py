"""A person's authored points with the words that shapes use to speak about them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from blendcap.synthetic.mannequin.cage import EYE_RINGS, MOUTH_RINGS, Cage, ring
from blendcap.synthetic.mannequin.fields import gauss
from blendcap.synthetic.mannequin.identity import Person


class Face:
    """The left half of one person's face, by name.

    Parameters
    ----------
    cage : Cage
    person : Person

    Attributes
    ----------
    points : (H, 3) float64
        Authored points of the left half, mm.
    mouth, eye : (H,) bool
        On a ring round the mouth, round the eye.
    upper, lower : (H,) bool
        On the upper or the lower side of the mouth; the corner is on neither.
    normals : (H, 3) float64
        Outward unit normals of the cage.
    across : (H,) float64
        How far to the side, in the plain person's mm: the corner of the mouth is at 26.
    """

    def __init__(self, cage: Cage, person: Person):
        self.cage, self.person, self.points = cage, person, person.points
        rings = [name.partition(".") for name in cage.names]
        self.ring = np.array([head for head, _, _ in rings])
        self.place = np.array([int(tail) if dot else -1 for _, dot, tail in rings])
        self.mouth = np.isin(self.ring, MOUTH_RINGS)
        self.eye = np.isin(self.ring, EYE_RINGS)
        self.on_globe = np.isin(self.ring, ("sock", "margin", "edge"))
        self.upper = self.mouth & (self.place < 4)
        self.lower = self.mouth & (self.place > 4)
        self._rings = {str(head): np.flatnonzero(self.ring == head) for head in np.unique(self.ring[self.place >= 0])}
        self.normals = _normals(cage, self.points)
        self.across = self.points[:, 0] * (26.0 / self.at("seam.4")[0])

    def at(self, name: str) -> np.ndarray:
        """Where one authored point lies, (3,), mm."""
        return self.points[self.cage.index([name])[0]]

    def spot(self, names: str, *, plain: bool = False) -> np.ndarray:
        """The middle (3,), mm, of some authored points, in this person or in the plain one."""
        return (self.cage.half if plain else self.points)[self.cage.index(names.split())].mean(0)

    def weights(self, table: Mapping[str, float]) -> np.ndarray:
        """A weight (H,) for each point: by its own name, else by its ring, else 0."""
        result, own = np.zeros(len(self.points)), {}
        for name, value in table.items():
            if name in self._rings:
                result[self._rings[name]] = value
            else:
                own[name] = value
        result[self.cage.index(list(own))] = list(own.values())
        return result

    def near(self, center, spread) -> np.ndarray:
        """A Gaussian (H,) about named points' middle or a place on the left."""
        return gauss(self.points, self.spot(center) if isinstance(center, str) else center, spread)

    def pairs(self, name: str, places: range) -> tuple[np.ndarray, np.ndarray]:
        """Points of a ring of the mouth (or eye) and those that face them."""
        count = 8 if name in MOUTH_RINGS else 12
        return self.cage.index(ring(name, places)), self.cage.index(ring(name, [count - k for k in places]))

    def sealed(self, moved: np.ndarray) -> np.ndarray:
        """A displacement (H, 3) whose two sides of the lip seam move as one: the mouth stays shut."""
        moved = moved.copy()
        above, below = self.pairs("seam", range(4))
        moved[above] = moved[below] = 0.5 * (moved[above] + moved[below])
        return moved

    def lined(self, moved: np.ndarray) -> np.ndarray:
        """A displacement (H, 3) whose inside of the mouth goes with the lip seam, less the deeper it lies."""
        moved, seam = moved.copy(), self.cage.index(ring("seam", 9))
        for name, share in (("inner", 0.95), ("lining", 0.25), ("bag", 0.04)):
            moved[self.cage.index(ring(name, 9))] = share * moved[seam]
        return moved


def push(amount: np.ndarray, direction) -> np.ndarray:
    """A displacement (H, 3): an amount (H,) of a direction (3,)."""
    return amount[:, None] * np.asarray(direction, dtype=float)


def _normals(cage: Cage, points: np.ndarray) -> np.ndarray:
    """Outward unit normals (H, 3) of the left half of a cage; in the plane of symmetry on the midline."""
    quads = cage.quads[: len(cage.quads) // 2]
    across = np.cross(points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]])
    normals = np.zeros_like(points)
    for corner in quads.T:
        np.add.at(normals, corner, across)
    normals[points[:, 0] <= 1e-9, 0] = 0
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
