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

    def at(self, name: str) -> np.ndarray:
        """Where one authored point lies, (3,), mm."""
        return self.points[self.cage.index([name])[0]]

    def weights(self, table: Mapping[str, float]) -> np.ndarray:
        """A weight (H,) for each point: by its own name, else by its ring, else 0."""
        pairs = zip(self.cage.names, self.ring, strict=True)
        return np.array([table.get(name, table.get(head, 0.0)) for name, head in pairs])

    def near(self, center, spread) -> np.ndarray:
        """A Gaussian (H,) about a named point or a place on the left."""
        return gauss(self.points, self.at(center) if isinstance(center, str) else center, spread)

    def pairs(self, name: str, places: range) -> tuple[np.ndarray, np.ndarray]:
        """Points of a ring of the mouth (or eye) and those that face them."""
        count = 8 if name in MOUTH_RINGS else 12
        return self.cage.index(ring(name, places)), self.cage.index(ring(name, [count - k for k in places]))

    def sealed(self, moved: np.ndarray) -> np.ndarray:
        """A displacement (H, 3) whose two sides of the lip seam move as one: the mouth stays shut."""
        moved = moved.copy()
        for name in ("seam", "inner"):
            above, below = self.pairs(name, range(4))
            moved[above] = moved[below] = 0.5 * (moved[above] + moved[below])
        return moved


def push(amount: np.ndarray, direction) -> np.ndarray:
    """A displacement (H, 3): an amount (H,) of a direction (3,)."""
    return amount[:, None] * np.asarray(direction, dtype=float)
