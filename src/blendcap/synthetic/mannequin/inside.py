"""Paint of what is no skin: eyes, caruncles, teeth, tongue."""

from __future__ import annotations

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.look import Color

IRIS_ANGLE, PUPIL_ANGLE = 0.50, 0.19  # rad
GUM, ENAMEL, TONGUE = np.array([0.60, 0.27, 0.25]), np.array([0.98, 0.86, 0.74]), np.array([0.52, 0.19, 0.17])


def paint_eye(directions: np.ndarray, iris_color: Color) -> np.ndarray:
    """Linear color (P, 3) of an eyeball by direction (P, 3) from its center, gaze +z: sclera, iris, pupil, a glint."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    angle, turn = np.arccos(np.clip(unit[:, 2], -1, 1)), np.arctan2(unit[:, 1], unit[:, 0])
    outer, inner = IRIS_ANGLE, PUPIL_ANGLE
    color = np.array([0.70, 0.67, 0.64]) - np.clip(angle - 0.5, 0, 1)[:, None] * np.array([0.10, 0.22, 0.22])
    depth = (angle - inner) / (outer - inner)
    fibers = (0.75 + 0.25 * np.sin(37 * turn) * np.sin(23 * turn + 1.3)) * (1.15 - 0.5 * depth)
    iris = np.asarray(iris_color) * (fibers * (1 - 0.8 * smoothstep(0.70, 0.98, depth)))[:, None]
    color += smoothstep(outer + 0.03, outer - 0.03, angle)[:, None] * (iris - color)
    color += smoothstep(inner + 0.02, inner - 0.02, angle)[:, None] * (0.012 - color)
    glint = np.exp(-((((unit[:, 0] + 0.16) / 0.055) ** 2 + ((unit[:, 1] - 0.17) / 0.06) ** 2) ** 2))
    return color + 0.9 * (glint * (unit[:, 2] > 0))[:, None]


def paint_teeth(local: np.ndarray) -> np.ndarray:
    """Linear color (P, 3) of teeth and gum by distance along the arch, height and gap (P, 3)."""
    gap = np.clip(local[:, 2:], 0, 1)
    crown = smoothstep(0.10, 0.2, local[:, 1:2] - 0.08 * gap)
    back = smoothstep(12, 36, np.abs(local[:, :1]))  # molars lie in the shade of the cheeks, more than the sky can tell
    return (GUM + crown * (ENAMEL - GUM)) * (1 - 0.4 * gap) * (1 - 0.65 * back)


def paint_caruncle(directions: np.ndarray) -> np.ndarray:
    """Linear color (P, 3): pink, and paler in the fold before the eye."""
    fold = smoothstep(0.3, 0.9, directions[:, :1])
    return np.array([0.56, 0.30, 0.26]) + fold * np.array([0.08, 0.20, 0.20])


def paint_tongue(directions: np.ndarray) -> np.ndarray:
    """Linear color (P, 3): a darker furrow along the middle."""
    furrow = np.exp(-((directions[:, :1] / 0.12) ** 2)) * (directions[:, 1:2] > 0)
    return TONGUE * (1 - 0.2 * furrow)
