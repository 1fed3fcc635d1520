"""How the two sides of a face differ: named measures that bend space, and the shapes with it.

A face is built symmetric and then bent. Each measure is a smooth field; about an eyeball the field is constant, so the
eye and its lids move as one body. A shape is bent by the field's derivative where each point rests, so points that meet
on the symmetric face meet on the bent one, and the rig stays linear.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.fields import gauss
from blendcap.synthetic.mannequin.measures import Measure

EYE_RIGID, EYE_FREE = 19.0, 33.0  # mm from the middle of the eyeball: within, and from where on the field is free
_STEP = 1e-3  # mm, of the derivative


def _odd(axis: int, center, spread):
    """Half up on the left, half down on the right."""

    def field(q):
        left = np.abs(q) * [1, 0, 0] + q * [0, 1, 1]
        amount = 0.5 * np.tanh(q[:, 0] / 14) * gauss(left, center, spread)
        return tuple(amount if k == axis else 0 for k in range(3))

    return field


def _shift(center, spread):
    """The middle of the face goes to the left."""
    return lambda q: (gauss(q, center, spread), 0, 0)


def _wider(center, spread):
    """The left side stands out and the right side in."""

    def field(q):
        left = np.abs(q) * [1, 0, 0] + q * [0, 1, 1]
        amount = 0.5 * gauss(left, center, spread)
        return 0.7 * amount, 0, 0.7 * amount * np.tanh(q[:, 0] / 14)

    return field


ASYMMETRIES: Mapping[str, Measure] = {  # how much the left is higher, fuller, or the middle goes to the left, mm
    "brow_asymmetry": Measure(0.9, _odd(1, (34, 22, 90), (24, 11, 26))),
    "eye_asymmetry": Measure(0.6, _odd(1, (31, 0, 76), (24, 18, 30))),
    "nose_bend": Measure(0.9, _shift((0, -33, 110), (15, 17, 22))),
    "cheek_asymmetry": Measure(1.1, _wider((48, -42, 66), (22, 22, 32))),
    "mouth_slant": Measure(0.8, _odd(1, (28, -66, 90), (18, 15, 26))),
    "mouth_shift": Measure(0.6, _shift((0, -66, 96), (34, 15, 34))),
    "chin_shift": Measure(0.9, _shift((0, -106, 88), (34, 22, 44))),
    "jaw_asymmetry": Measure(1.3, _wider((58, -78, 16), (30, 26, 36))),
}


class Bend:
    """The field of one person's asymmetries.

    Parameters
    ----------
    measures : {name: mm}
        Names that are no asymmetry are passed over.
    globe : (3,) float64
        Center of the left eyeball, mm.
    """

    def __init__(self, measures: Mapping[str, float], globe: np.ndarray):
        self.measures = {name: value for name, value in measures.items() if value and name in ASYMMETRIES}
        self.globe = globe

    def __bool__(self) -> bool:
        return bool(self.measures)

    def displacement(self, points: np.ndarray) -> np.ndarray:
        """How far points (P, 3) go, (P, 3), mm."""
        moved = self._free(points)
        for side in (1, -1):
            center = self.globe * [side, 1, 1]
            near = smoothstep(EYE_FREE, EYE_RIGID, np.linalg.norm(points - center, axis=1))[:, None]
            moved = np.where(near >= 1, self._free(center[None]), moved + near * (self._free(center[None]) - moved))
        return moved

    def turns(self, points: np.ndarray) -> np.ndarray:
        """What bending does to displacements that start at points (P, 3): matrices (P, 3, 3) to multiply them with."""
        steps = _STEP * np.eye(3)
        slopes = [(self.displacement(points + s) - self.displacement(points - s)) / (2 * _STEP) for s in steps]
        return np.eye(3) + np.stack(slopes, 2)

    def _free(self, points: np.ndarray) -> np.ndarray:
        moved = np.zeros_like(points)
        for name, value in self.measures.items():
            for axis, amount in enumerate(ASYMMETRIES[name].field(points)):
                moved[:, axis] += value * amount
        return moved
