"""Wrinkles as reliefs: how high the skin stands, in mm, over the plain mannequin when a shape folds it.

Each is a function of the place, the same on both sides; `SIDED` shapes keep only their own half.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.noise import noise


def _groove(away: np.ndarray, width: float) -> np.ndarray:
    """A furrow, -1 in its middle, with a low rim on both sides."""
    t = (away / width) ** 2
    return (0.9 * t - 1) * np.exp(-t)


def _window(x: np.ndarray, low: float, high: float, soft: float) -> np.ndarray:
    return smoothstep(low - soft, low + soft, x) * smoothstep(high + soft, high - soft, x)


def _lines(phase: np.ndarray, spacing: float, width: float) -> np.ndarray:
    """Furrows where the phase is whole, `spacing` mm apart."""
    return _groove(spacing * (phase - np.round(phase)), width)


def forehead(places: np.ndarray, inner: float, outer: float) -> np.ndarray:
    """Lines across the forehead between two distances from the midline, mm."""
    x, y = np.abs(places[:, 0]), places[:, 1]
    phase = (y - 3 * np.cos(np.clip(x / 26, 0, np.pi)) + 1.8 * noise(places, 0.06, 21)) / 7.5
    deep = 0.75 + 0.5 * noise(places, 0.08, 22)
    return 0.42 * deep * _lines(phase, 7.5, 1.5) * _window(y, 36, 62, 6) * _window(x, inner, outer, 9)


def glabella(places: np.ndarray) -> np.ndarray:
    """Two steep furrows between the brows and one across the root of the nose."""
    x, y = np.abs(places[:, 0]), places[:, 1]
    upright = 0.85 * _groove(x - 4.2 - 0.12 * (y - 16), 1.7) * _window(y, 9, 27, 4)
    return upright + 0.35 * _groove(y - 4.5, 1.6) * _window(x, -9, 7, 3)


def nose(places: np.ndarray) -> np.ndarray:
    """Slanting lines on the side of the nose, from the root down and outwards."""
    x, y = np.abs(places[:, 0]), places[:, 1]
    phase = (y + 0.9 * (x - 8) + 0.8 * noise(places, 0.15, 23)) / 4.6
    return 0.4 * _lines(phase, 4.6, 1.2) * _window(y, -14, 2, 4) * _window(x, 3, 14, 3)


def outer_eye(places: np.ndarray) -> np.ndarray:
    """Crow's feet: a fan of lines from the outer canthus."""
    aside = np.hypot(np.abs(places[:, 0]) - 43.5, np.minimum(places[:, 2] - 73.5, 0)) * (np.abs(places[:, 0]) > 43.5)
    away, turn = np.hypot(aside, places[:, 1]), np.arctan2(places[:, 1], np.maximum(aside, 1e-6))
    fan = sum(_groove(away * np.sin(turn - t), 1.2) * (0.8 + 0.2 * np.cos(5 * t)) for t in (-0.75, -0.3, 0.1, 0.5))
    return 0.4 * fan * _window(away, 8, 21, 4) * (aside > 0) * _window(turn, -1.0, 0.8, 0.25)


def lower_lid(places: np.ndarray) -> np.ndarray:
    """Two lines under the lower lid."""
    x, y = np.abs(places[:, 0]), places[:, 1]
    curve = y + 0.011 * (x - 31) ** 2
    return (0.28 * _groove(curve + 9.5, 1.3) + 0.22 * _groove(curve + 13.5, 1.4)) * _window(x, 22, 40, 6)


def nasolabial(places: np.ndarray) -> np.ndarray:
    """The fold from the wing of the nose past the corner of the mouth."""
    x, y = np.abs(places[:, 0]), places[:, 1]
    path = np.interp(-y, [34, 42, 52, 62, 72], [19.5, 24.5, 30.5, 34.5, 36.5])
    return 0.9 * _groove(x - path, 2.4) * _window(y, -67, -39, 5)


FURROWS: dict[str, Callable[[np.ndarray], np.ndarray]] = {  # by ARKit's names without the side
    "browInnerUp": lambda places: forehead(places, -20, 30),
    "browOuterUp": lambda places: forehead(places, 22, 50),
    "browDown": glabella,
    "noseSneer": lambda places: nose(places) + 0.4 * nasolabial(places),
    "eyeSquint": lambda places: outer_eye(places) + lower_lid(places),
    "cheekSquint": lambda places: 0.8 * outer_eye(places) + 0.6 * lower_lid(places),
    "mouthSmile": lambda places: nasolabial(places) + 0.5 * outer_eye(places),
}
SIDED = frozenset(FURROWS) - {"browInnerUp"}
