"""The thirty measures of a head: how much each varies and what 1 mm of it does to space.

Each field maps points (P, 3) of the left half (x >= 0; mm) to a displacement, 1 mm in the named sense at its place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.fields import gauss


class Measure(NamedTuple):
    """One way in which heads differ."""

    deviation: float  # mm (neck_width: percent); the bounds are twice that
    field: Callable[[np.ndarray], tuple]  # x, y and z displacement per unit


def _half(x: np.ndarray, reach: float, most: float = 1.0) -> np.ndarray:
    """Half a width, growing from 0 on the midline to 1/2 at `reach`."""
    return 0.5 * np.clip(x / reach, 0, most)


def _head_width(q):
    return 0.5 * q[:, 0] / 75 * np.exp(-(((q[:, 1] - 45) / 75) ** 2)), 0, 0


def _bizygomatic_width(q):
    x, y, z = q.T
    return _half(x, 64) * np.exp(-(((y + 8) / 42) ** 2)) * smoothstep(-60, 20, z), 0, 0


def _upper_lip_height(q):
    rise = smoothstep(-63.5, -57, q[:, 1]) * gauss(q, (0, -55, 102), (20, 6, 16))
    return 0, rise, 0.45 * gauss(q, (0, -60, 104), (24, 4.2, 10))


def _lower_lip_height(q):
    drop = smoothstep(-66.5, -74, q[:, 1]) * gauss(q, (0, -76, 99), (20, 6, 16))
    return 0, -drop, 0.45 * gauss(q, (0, -71, 103), (24, 5.0, 10))


def _cheek_fullness(q):
    return 0.8 * gauss(q, (50, -48, 62), (18, 20, 30)), 0, gauss(q, (42, -42, 76), (20, 18, 28))


def _cheekbone(q):
    return 0.8 * gauss(q, (58, -16, 62), (14, 12, 24)), 0, gauss(q, (50, -20, 74), (14, 10, 24))


def _canthal_tilt(q):
    return 0, np.clip((q[:, 0] - 31) / 13, -1.3, 1.3) * gauss(q, (31, 0, 78), (16, 13, 20)), 0


def _eye_height(q):
    y = q[:, 1]
    upper = smoothstep(1, 4, y) * gauss(q, (31, 5, 82), (9, 4, 8))
    lower = smoothstep(-2, -4.5, y) * gauss(q, (31, -5, 82), (9, 4, 8))
    return 0, upper - 0.5 * lower, 0


def _neck_width(q):
    grown = 0.01 * smoothstep(-95, -125, q[:, 1])
    return grown * q[:, 0], 0, grown * (q[:, 2] + 20)


def _ear_protrusion(q):
    x, y, z = q.T
    return smoothstep(76, 88, x) * ((z < 10) & (y > -50) & (y < 30)), 0, 0


def _along(axis: int, center, spread, gain: float = 1.0) -> Callable[[np.ndarray], tuple]:
    """A Gaussian push along one axis."""

    def field(q):
        amount = gain * gauss(q, center, spread)
        return tuple(amount if k == axis else 0 for k in range(3))

    return field


def _wider(reach: float, center, spread, gain: float = 1.0, most: float = 1.0) -> Callable[[np.ndarray], tuple]:
    """A Gaussian widening, half on each side."""
    return lambda q: (gain * _half(q[:, 0], reach, most) * gauss(q, center, spread), 0, 0)


MEASURES: Mapping[str, Measure] = {
    "head_width": Measure(4, _head_width),
    "head_length": Measure(5, lambda q: (0, 0, -smoothstep(30, -90, q[:, 2]) * smoothstep(-120, -40, q[:, 1]))),
    "forehead_height": Measure(3, lambda q: (0, smoothstep(20, 112, q[:, 1]), 0)),
    "bizygomatic_width": Measure(4, _bizygomatic_width),
    "midface_height": Measure(2.5, lambda q: (0, -smoothstep(-2, -44, q[:, 1]), 0)),
    "lower_face_height": Measure(4, lambda q: (0, -smoothstep(-46, -100, q[:, 1]), 0)),
    "bigonial_width": Measure(5, _wider(55, (60, -78, 15), (60, 24, 42))),
    "chin_width": Measure(4, _wider(20, (22, -106, 85), (26, 14, 26))),
    "chin_projection": Measure(2.5, _along(2, (0, -103, 95), (26, 15, 40))),
    "jaw_drop_angle": Measure(3, _along(1, (56, -80, 12), (30, 24, 26), -1)),
    "intercanthal_width": Measure(2, _wider(16, (28, 2, 80), (22, 18, 30))),
    "nose_length": Measure(2.5, _along(1, (0, -38, 108), (16, 11, 22), -1.05)),
    "nose_protrusion": Measure(2.5, _along(2, (0, -34, 116), (9, 13, 14), 1.05)),
    "nasal_bridge_height": Measure(2, _along(2, (0, -4, 95), (8.5, 15, 12))),
    "nasal_width": Measure(3, _wider(14, (17, -39, 99), (9, 9, 13), 1.1)),
    "dorsal_hump": Measure(1.5, _along(2, (0, -13, 101), (7, 8, 12))),
    "nose_tip_rotation": Measure(1.5, _along(1, (0, -36, 115), (8, 8, 8))),
    "mouth_width": Measure(3, _wider(26, (26, -65, 90), (14, 12, 20), 1.0, 1.15)),
    "upper_lip_height": Measure(1.5, _upper_lip_height),
    "lower_lip_height": Measure(1.5, _lower_lip_height),
    "maxilla": Measure(1.5, _along(2, (0, -58, 100), (34, 16, 34))),
    "brow_ridge": Measure(1.5, _along(2, (24, 20, 94), (22, 8, 20))),
    "brow_height": Measure(1.5, _along(1, (30, 22, 90), (24, 9, 25))),
    "cheek_fullness": Measure(3, _cheek_fullness),
    "cheekbone": Measure(2, _cheekbone),
    "canthal_tilt": Measure(1, _canthal_tilt),
    "eye_height": Measure(0.75, _eye_height),
    "eye_depth": Measure(1.25, _along(2, (31, 1, 80), (18, 13, 22), -1)),
    "neck_width": Measure(8, _neck_width),
    "ear_protrusion": Measure(2, _ear_protrusion),
}


def displacement(points: np.ndarray, measures: Mapping[str, float]) -> np.ndarray:
    """How far the measures move points (P, 3) of either side, (P, 3), mm; mirror symmetric."""
    left = np.abs(points) * [1, 0, 0] + points * [0, 1, 1]
    moved = np.zeros_like(left)
    for name, value in measures.items():
        for axis, amount in enumerate(MEASURES[name].field(left)):
            moved[:, axis] += value * amount
    moved[:, 0] *= np.sign(points[:, 0])
    return moved
