"""Paint: the color of skin, lips, brows, hair, eyes, teeth as functions of place, baked into one texture.

Colors are functions of the rest position on the plain person and of scalar fields on the cage (lip, lash line, wet rim,
mouth, nostril, auricle), so they ride along with every identity and shape. Fields are thresholded per texel: borders
stay crisp.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from blendcap.synthetic.mannequin.cage import EAR_RINGS, Cage
from blendcap.synthetic.mannequin.fields import smoothstep

Color = tuple[float, float, float]
Paint = np.ndarray | Color | Callable[[np.ndarray], np.ndarray]


class Look(NamedTuple):
    """Colors of one person, linear RGB, 0 to 1."""

    skin: Color = (0.62, 0.42, 0.33)
    lips: Color = (0.50, 0.19, 0.17)
    hair: Color = (0.10, 0.065, 0.045)
    iris: Color = (0.30, 0.20, 0.11)


LOOKS = {
    "plain": Look(),
    "ada": Look((0.68, 0.47, 0.38), (0.50, 0.12, 0.13), (0.075, 0.04, 0.03), (0.20, 0.28, 0.30)),
    "kofi": Look((0.20, 0.105, 0.065), (0.19, 0.07, 0.06), (0.018, 0.013, 0.011), (0.07, 0.04, 0.025)),
    "lars": Look((0.63, 0.40, 0.31), (0.46, 0.20, 0.17), (0.22, 0.17, 0.12), (0.20, 0.30, 0.38)),
    "rosa": Look((0.60, 0.37, 0.28), (0.45, 0.18, 0.16), (0.16, 0.075, 0.035), (0.16, 0.22, 0.12)),
    "mei": Look((0.60, 0.41, 0.28), (0.46, 0.18, 0.15), (0.025, 0.018, 0.016), (0.08, 0.045, 0.025)),
}
_FIELDS: tuple[dict[str, float], ...] = (  # ring weights; the lash line only between the canthi
    {"inner": 1.0, "seam": 1.0, "crest": 1.0, "border": 0.5},
    {"margin": 1.0, "edge": 0.5},
    {"sock": 1.0, "margin": 0.8},
    {"inner": 1.0, "lining": 1.2, "bag": 1.3, "mi": 1.3, "mc": 1.3, "seam": 0.1},
    {"vestibule": 1.0},
    {name: 1.0 for name in EAR_RINGS},
)
FLUSHED = np.array([0.0, 0.17, 0.15], dtype=np.float32)  # how much of each channel a flush takes away
SHADED = np.array([0.5, 0.7, 0.55], dtype=np.float32)
BLOTCHED = np.array([0.6, 1.0, 1.0], dtype=np.float32)
LIP, LASH, WET, MOUTH, NOSTRIL, EAR = range(6)


def cage_fields(cage: Cage) -> np.ndarray:
    """The scalar fields (N, 6) on the cage."""
    rings = [name.partition(".") for name in cage.names]
    left = np.array([[field.get(head, 0.0) for field in _FIELDS] for head, _, _ in rings])
    left[[not (dot and 1 <= int(place) <= 5) for _, dot, place in rings], LASH] = 0
    return cage.mirrored(left, vectors=False)


def paint_skin(places: np.ndarray, fields: np.ndarray, look: Look) -> np.ndarray:
    """Linear color (P, 3) at places (P, 3) of the plain person, mm, with the fields (P, 6)."""
    color = _complexion(places, look)
    y, z = places[:, 1], places[:, 2]
    lashes = 0.93 * smoothstep(0.42, 0.62, fields[:, LASH])

    def layer(here: np.ndarray, strength: Paint, paint: Paint) -> None:
        """Paint over the color where it may show; both strength and paint may depend on the place."""
        amount = strength(here) if callable(strength) else np.asarray(strength)[here]
        over = paint(here) if callable(paint) else np.asarray(paint, dtype=np.float32)
        color[here] += amount[:, None] * (over - color[here])

    lips = fields[:, LIP] > 0.5
    layer(lips, 0.8 * smoothstep(0.50, 0.66, fields[:, LIP]), lambda p: _lip(places[p], fields[p], look))
    layer((z > 40) & (y > 5) & (y < 35), lambda p: _brow(places[p]), look.hair)
    layer(lashes > 0, lashes, np.multiply(0.4, look.hair))
    layer(fields[:, WET] > 0.5, smoothstep(0.5, 0.9, fields[:, WET]) * (1 - lashes), (0.55, 0.28, 0.25))
    layer(fields[:, MOUTH] > 0.35, smoothstep(0.35, 1.15, fields[:, MOUTH]), (0.16, 0.035, 0.03))
    layer(fields[:, NOSTRIL] > 0.1, smoothstep(0.10, 0.55, fields[:, NOSTRIL]), (0.05, 0.018, 0.014))
    layer((y > -75) & (fields[:, EAR] < 0.2) & ((z < 35) | (y > 8)),
          lambda p: 0.9 * _hair(places[p]) * (1 - smoothstep(0.02, 0.2, fields[p, EAR])), look.hair)  # fmt: skip
    return color


def paint_eye(directions: np.ndarray, look: Look) -> np.ndarray:
    """Linear color (P, 3) of an eyeball by direction (P, 3) from its center, gaze +z: sclera, iris, pupil, a glint."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    angle, turn = np.arccos(np.clip(unit[:, 2], -1, 1)), np.arctan2(unit[:, 1], unit[:, 0])
    outer, inner = 0.50, 0.19
    color = np.array([0.70, 0.67, 0.64]) - np.clip(angle - 0.5, 0, 1)[:, None] * np.array([0.10, 0.22, 0.22])
    depth = (angle - inner) / (outer - inner)
    fibers = (0.75 + 0.25 * np.sin(37 * turn) * np.sin(23 * turn + 1.3)) * (1.15 - 0.5 * depth)
    iris = np.asarray(look.iris) * (fibers * (1 - 0.8 * smoothstep(0.70, 0.98, depth)))[:, None]
    color += smoothstep(outer + 0.03, outer - 0.03, angle)[:, None] * (iris - color)
    color += smoothstep(inner + 0.02, inner - 0.02, angle)[:, None] * (0.012 - color)
    glint = np.exp(-((((unit[:, 0] + 0.16) / 0.055) ** 2 + ((unit[:, 1] - 0.17) / 0.06) ** 2) ** 2))
    return color + 0.9 * glint[:, None]


def paint_teeth(local: np.ndarray) -> np.ndarray:
    """Linear color (P, 3) of teeth and gum by distance along the arch, height and gap (P, 3)."""
    gap = np.clip(local[:, 2:], 0, 1)
    crown = smoothstep(0.10, 0.2, local[:, 1:2] - 0.08 * gap)
    gum, enamel = np.array([0.60, 0.27, 0.25]), np.array([0.93, 0.89, 0.80])
    return (gum + crown * (enamel - gum)) * (1 - 0.4 * gap)


def paint_caruncle(directions: np.ndarray) -> np.ndarray:
    """Linear color (P, 3): pink towards the nose, white towards the eye."""
    return np.array([0.56, 0.30, 0.26]) + smoothstep(-0.55, 0.75, directions[:, :1]) * np.array([0.10, 0.30, 0.30])


def paint_tongue(directions: np.ndarray) -> np.ndarray:
    """Linear color (P, 3): a darker furrow along the middle."""
    furrow = np.exp(-((directions[:, :1] / 0.12) ** 2)) * (directions[:, 1:2] > 0)
    return np.array([0.52, 0.19, 0.17]) * (1 - 0.2 * furrow)


def _complexion(places: np.ndarray, look: Look) -> np.ndarray:
    x, y, z = np.abs(places[:, 0]), places[:, 1], places[:, 2]

    def spot(cx, cy, sx, sy):
        return np.exp(-(((x - cx) / sx) ** 2) - ((y - cy) / sy) ** 2) * (z > 30)

    tone = np.asarray(look.skin, dtype=np.float32)
    flush = 0.55 * spot(40, -32, 16, 14) + 0.6 * spot(0, -36, 10, 9) + 0.3 * spot(0, -98, 14, 8)
    shade = 0.28 * spot(24, -14, 14, 6) + 0.15 * spot(30, 11, 14, 6)
    color = tone * (1 - flush[:, None] * FLUSHED)
    color *= 1 - shade[:, None] * SHADED
    blotches, pores = 0.035 * _noise(places, 0.12, 1), 0.03 * _noise(places, 0.9, 2)
    return color * (1 + blotches[:, None] * BLOTCHED + pores[:, None])


def _lip(places: np.ndarray, fields: np.ndarray, look: Look) -> np.ndarray:
    lines = 1 + 0.035 * _noise(places, (2.2, 0.35, 0.5), 9)
    return np.asarray(look.lips) * (lines * (1 - 0.25 * smoothstep(0.8, 1.0, fields[:, LIP])))[:, None]


def _brow(places: np.ndarray) -> np.ndarray:
    """Strength (P,) of the brow: an arch from the inner end, painted in strokes that lean outwards."""
    x, y = np.abs(places[:, 0]), places[:, 1]
    t = (x - 12) / 40
    along = np.clip(t, 0, 1)
    middle = 16.5 + 9.0 * along - 22.0 * np.clip(t - 0.60, 0, 1) ** 1.3
    strokes = _noise(
        np.stack([3 * (x * (1 - 0.45 * along) - y * (0.5 + 0.5 * along)), 0.35 * (x + y), 0 * x], 1), 1.0, 11
    )
    across = (y - middle) / (4.2 * (1 - 0.62 * along)) + 0.25 * strokes
    ends = smoothstep(-0.05, 0.12, t) * smoothstep(1.04, 0.85, t)
    return 0.92 * np.exp(-(across**4)) * ends * np.clip(0.78 + 0.20 * strokes, 0.35, 1) * (places[:, 2] > 40)


def _hair(places: np.ndarray) -> np.ndarray:
    """Strength (P,) of short hair: above a ragged line, before the ear, and at the back."""
    x, y, z = np.abs(places[:, 0]), places[:, 1], places[:, 2]
    line = 67 + 8 * np.cos(np.clip(x / 40, 0, 2)) - 52 * smoothstep(47, 71, x)
    ragged = 0.5 * _noise(places, (1.6, 0.5, 1.6), 3) + 0.5 * _noise(places, (3.1, 0.9, 2.6), 8)
    top = smoothstep(-7, 9, y - line + 3.2 * ragged)
    side = smoothstep(-22, -8, y + 2 * ragged) * smoothstep(26, 14, z + 2 * ragged) * smoothstep(64, 69, x)
    back = smoothstep(2, -12, z - 0.25 * (y + 10)) * smoothstep(-72, -45, y)
    return np.clip(np.maximum(np.maximum(top, side), back), 0, 1)


def _noise(places: np.ndarray, frequency: float | Color, seed: int) -> np.ndarray:
    """Smooth noise (P,), deviation about 0.7: a sum of plane waves, the same on both sides."""
    rng, count = np.random.default_rng(seed), 8
    waves = (rng.normal(size=(3, count)) * np.reshape(frequency, (-1, 1))).astype(np.float32)
    phases = places.astype(np.float32)
    phases[:, 0] = np.abs(phases[:, 0])
    phases = phases @ waves + rng.uniform(0, 2 * np.pi, count).astype(np.float32)
    return np.sin(phases, out=phases).sum(1) / np.float32(np.sqrt(count))
