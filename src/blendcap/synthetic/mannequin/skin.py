"""Paint: the color of skin, lips, brows and hair as functions of place.

Colors are functions of the place on the plain person and of scalar fields on the cage (lip, lash line, wet rim, mouth,
nostril, auricle), so they ride along with every identity and shape, and with every face laid over the plain one.
Fields are thresholded per texel: borders stay crisp. Features are the same on both sides; noise is not.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.cage import EAR_RINGS, Cage
from blendcap.synthetic.mannequin.look import Color, Look
from blendcap.synthetic.mannequin.noise import noise, spots

Paint = np.ndarray | Color | Callable[[np.ndarray], np.ndarray]

_FIELDS: tuple[dict[str, float], ...] = (  # ring weights; the lash line only between the canthi
    {"inner": 1.0, "seam": 1.0, "crest": 1.0, "border": 0.5},
    {"margin": 1.0, "edge": 0.5},
    {"sock": 1.0, "margin": 0.8},
    {"inner": 1.0, "lining": 1.2, "bag": 1.3, "mi": 1.3, "mc": 1.3, "seam": 0.1},
    {"vestibule": 1.0},
    {name: 1.0 for name in EAR_RINGS},
)
LIP, LASH, WET, MOUTH, NOSTRIL, EAR = range(6)
FLUSHED = np.array([0.0, 0.17, 0.15], dtype=np.float32)  # how much of each channel a flush takes away
SHADED = np.array([0.5, 0.7, 0.55], dtype=np.float32)
BLOTCHED = np.array([0.6, 1.0, 1.0], dtype=np.float32)
FRECKLED = np.array([0.22, 0.38, 0.48], dtype=np.float32)
BROW_LIGHT = 0.10  # of the lightest brow
WET_RIM, INSIDE, NOSTRIL_INSIDE = (0.55, 0.28, 0.25), (0.16, 0.035, 0.03), (0.05, 0.018, 0.014)


def cage_fields(cage: Cage) -> np.ndarray:
    """The scalar fields (N, 6) on the cage."""
    rings = [name.partition(".") for name in cage.names]
    left = np.array([[field.get(head, 0.0) for field in _FIELDS] for head, _, _ in rings])
    left[[not (dot and 1 <= int(place) <= 5) for _, dot, place in rings], LASH] = 0
    return cage.mirrored(left, vectors=False)


def paint_skin(places: np.ndarray, fields: np.ndarray, look: Look) -> np.ndarray:
    """Linear color (P, 3) at places (P, 3) of the plain person, mm, with the fields (P, 6)."""
    color = _complexion(places, fields, look)
    x, y, z = np.abs(places[:, 0]), places[:, 1], places[:, 2]
    lashes = look.lashes * smoothstep(0.42, 0.62, fields[:, LASH]) * smoothstep(43.2, 41.2, x)

    def layer(here: np.ndarray, strength: Paint, paint: Paint) -> None:
        """Paint over the color where it may show; both strength and paint may depend on the place."""
        amount = strength(here) if callable(strength) else np.asarray(strength)[here]
        over = paint(here) if callable(paint) else np.asarray(paint, dtype=np.float32)
        color[here] += amount[:, None] * (over - color[here])

    if look.stubble > 0:
        layer((y < -18) & (y > -140) & (z > -20), lambda p: _stubble(places[p], look),
              np.multiply(look.hair, 0.7) + np.multiply(look.skin, 0.12))  # fmt: skip
    lips = fields[:, LIP] > 0.42
    layer(lips, 0.85 * smoothstep(0.42, 0.58, fields[:, LIP]), lambda p: _lip(places[p], fields[p], look))
    layer((z > 40) & (y > 5) & (y < 35) & (x > 8), lambda p: brow(places[p], look), _brow_color(look))
    layer(lashes > 0, lashes, np.multiply(0.4, look.hair))
    layer(fields[:, WET] > 0.5, smoothstep(0.5, 0.9, fields[:, WET]) * (1 - lashes), WET_RIM)
    layer(fields[:, MOUTH] > 0.35, smoothstep(0.35, 1.15, fields[:, MOUTH]), INSIDE)
    layer(fields[:, NOSTRIL] > 0.1, smoothstep(0.10, 0.55, fields[:, NOSTRIL]), NOSTRIL_INSIDE)
    scalp = (y > -75) & (fields[:, EAR] < 0.2) & ((z < 35) | (y > 8))
    layer(scalp, lambda p: _cover(places[p], look) * (1 - smoothstep(0.02, 0.2, fields[p, EAR])),
          lambda p: _strands(places[p], look))  # fmt: skip
    return color


def _complexion(places: np.ndarray, fields: np.ndarray, look: Look) -> np.ndarray:
    x, y, front = np.abs(places[:, 0]), places[:, 1], places[:, 2] > 30
    grain = look.grain

    def spot(cx, cy, sx, sy):
        return np.exp(-(((x - cx) / sx) ** 2) - ((y - cy) / sy) ** 2) * front

    flush = 0.55 * spot(40, -32, 16, 14) + 0.6 * spot(0, -36, 10, 9) + 0.3 * spot(0, -98, 14, 8)
    flush += 0.3 * np.minimum(fields[:, EAR], 1)
    shade = 0.28 * spot(24, -14, 14, 6) + 0.15 * spot(30, 11, 14, 6)
    color = np.asarray(look.skin, dtype=np.float32) * (1 - look.blush * flush[:, None] * FLUSHED)
    color *= 1 - look.shade * shade[:, None] * SHADED
    blotches = 0.055 * noise(places, 0.05, grain + 1) + 0.045 * noise(places, 0.16, grain + 2)
    pores = 0.055 * noise(places, 0.75, grain + 3)
    color *= 1 + look.blotches * blotches[:, None] * BLOTCHED + pores[:, None]
    if look.freckles > 0:
        where = look.freckles * np.clip(spot(28, -22, 26, 18) + 0.7 * spot(0, -20, 12, 22) + 0.25 * front, 0, 1)
        color *= 1 - (where * spots(places, 3.4, (0.5, 1.3), 0.55, grain + 4))[:, None] * FRECKLED
    if look.moles > 0:
        color *= 1 - 0.6 * spots(places, 34.0, (0.7, 2.0), 0.5 * look.moles, grain + 5)[:, None] * SHADED
    return color


def _lip(places: np.ndarray, fields: np.ndarray, look: Look) -> np.ndarray:
    lines = 1 + 0.09 * noise(places, (0.85, 0.12, 0.2), look.grain + 9)
    return np.asarray(look.lips) * (lines * (1 - 0.25 * smoothstep(0.8, 1.0, fields[:, LIP])))[:, None]


def brow(places: np.ndarray, look: Look) -> np.ndarray:
    """Strength (P,) of the brow: an arch from the inner end, painted in strokes that lean outwards."""
    x, y = np.abs(places[:, 0]), places[:, 1]
    t = (x - 12) / 44
    along = np.clip(t, 0, 1)
    middle = 16.5 + 9.0 * along - 44.0 * np.clip(t - 0.60, 0, 1) ** 1.3
    middle += 4 * (look.brow_arch - 1) * np.sin(np.pi * np.clip(along * 0.85, 0, 1))
    outwards = x - 0.4 * 44 * along**2  # its slope, 1 to 0.2, never turns back: strokes lie down, and do not curl
    leaning = np.stack([outwards - 0.75 * y, 0.16 * (x + y), 9 * np.sign(places[:, 0])], 1)
    strokes = 1.6 * noise(leaning, 1.1, look.grain + 11)
    across = (y - middle) / (0.5 * look.brow_height * (1 - 0.62 * along)) + 0.25 * strokes
    ends = smoothstep(-0.05, 0.12, t) * smoothstep(1.04, 0.85, t)
    hairs = np.clip(0.78 + 0.3 * strokes, 0.25, 1.1)
    return np.clip(look.brow_density * np.exp(-(across**4)) * ends * hairs, 0, 1)


def _brow_color(look: Look) -> np.ndarray:
    """The hair's, darker; where hair is light, brows are still dark."""
    return np.asarray(look.hair) * min(0.8, BROW_LIGHT / np.mean(look.hair))


def _stubble(places: np.ndarray, look: Look) -> np.ndarray:
    """Strength (P,) of the beard's shadow: lip, chin and jaw up to the sideburn, in fine dots."""
    x, y, z = np.abs(places[:, 0]), places[:, 1], places[:, 2]
    upper = np.interp(x, [0, 18, 27, 38, 52, 64, 70], [-48, -49, -57, -60, -50, -36, -18])
    ragged = y + 4 * noise(places, 0.25, look.grain + 6)
    area = smoothstep(2, -6, ragged - upper) * smoothstep(-136, -116, ragged) * smoothstep(-12, 4, z)
    area *= 1 - 0.75 * np.exp(-((x / 5) ** 2) - ((y + 80) / 4) ** 2)  # thinner below the lip
    area *= 1 - 0.6 * np.exp(-((x - 13) ** 2 / 30) - ((y + 84) / 5) ** 2)
    dots = 0.62 + 0.7 * noise(places, 1.1, look.grain + 7)
    return np.clip(0.75 * look.stubble * area * np.clip(dots, 0.1, 1.2), 0, 1)


def scalp(places: np.ndarray, look: Look) -> np.ndarray:
    """How much hair grows (P,), 0 to 1: above a ragged line, before the ear, and at the back."""
    x, y, z = np.abs(places[:, 0]), places[:, 1], places[:, 2]
    line = 67 + look.hairline + 8 * np.cos(np.clip(x / 40, 0, 2)) - 52 * smoothstep(47, 71, x)
    line += look.temples * np.exp(-(((x - 34) / 13) ** 2))
    ragged = 0.8 * noise(places, (0.3, 0.1, 0.3), look.grain + 8) + 0.8 * noise(places, 0.6, look.grain + 10)
    top = smoothstep(-7, 9, y - line + 3.2 * ragged)
    side = smoothstep(-22, -8, y + 2 * ragged) * smoothstep(26, 14, z + 2 * ragged) * smoothstep(64, 69, x)
    back = smoothstep(2, -12, z - 0.25 * (y + 10)) * smoothstep(-72, -45, y)
    return np.clip(np.maximum(np.maximum(top, side), back), 0, 1)


def _cover(places: np.ndarray, look: Look) -> np.ndarray:
    """Strength (P,) of the hair's color over the skin's, by the cut."""
    dots = noise(places, 1.0, look.grain + 12)
    grown = scalp(places, look)
    if look.cut == "bald":
        return np.clip(0.22 * grown * (1 + dots), 0, 1)
    if look.cut == "buzz":
        return np.clip(grown * (0.74 + 0.3 * dots), 0, 1)
    return np.clip(grown * 1.15, 0, 0.97)


def _strands(places: np.ndarray, look: Look) -> np.ndarray:
    """Linear color (P, 3) of the hair: strands that run back from the forehead and down at the sides."""
    color = np.asarray(look.hair, dtype=np.float32)
    if look.cut != "short":  # stubs, some of which are darker: grey hair is salt and pepper
        stubs = 1 + 1.1 * noise(places, 0.8, look.grain + 13) + 0.3 * noise(places, 0.12, look.grain + 14)
        return color * np.clip(stubs, 0.2, 1.5)[:, None]
    high = smoothstep(20, 75, places[:, 1])[:, None]
    turned = places * (high * np.array([0.75, 0.3, 0.09]) + (1 - high) * np.array([0.5, 0.1, 0.75]))
    locks = places * np.array([0.09, 0.04, 0.03])
    light = 1 + 0.6 * noise(turned, 1.3, look.grain + 13) + 0.2 * noise(locks, 1.0, look.grain + 14)
    return color * np.clip(light, 0.35, 2)[:, None]
