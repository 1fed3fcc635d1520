"""Texture coordinates: one chart for the skin, cut along the back midline, and a small one for every hidden piece.

The skin is rolled off a vertical cylinder, the face finer than the rest, and smoothed where that folds. What lies
inside (mouth, sockets, nostrils), the auricle and the parts have charts of their own, which left and right share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from blendcap.synthetic.mannequin.cage import EAR_RINGS, Cage
from blendcap.synthetic.mannequin.parts import Part
from blendcap.synthetic.mannequin.subdivision import LEVELS, Surface, refined

AXIS = -20.0  # z of the cylinder's axis, mm
FLOOR = 0.35  # the skin's chart lies above, all others below
ROUNDS = 3  # in which the folds of the skin are smoothed
CELLS = {  # left, bottom, width and height
    "eye": (0.005, 0.005, 0.33, 0.33),
    "ear": (0.345, 0.03, 0.28, 0.28),
    "nostril": (0.63, 0.02, 0.045, 0.045),
    "socket": (0.63, 0.08, 0.045, 0.045),
    "caruncle": (0.63, 0.14, 0.045, 0.045),
    "mouth": (0.69, 0.18, 0.15, 0.15),
    "tongue": (0.85, 0.18, 0.14, 0.14),
    "upper_teeth": (0.69, 0.095, 0.305, 0.07),
    "lower_teeth": (0.69, 0.015, 0.305, 0.07),
}
_DISCS = {  # pieces of closed rings: the radius of each ring in the chart
    "socket": {"margin": 1.0, "sock": 0.5},
    "nostril": {"nostril": 1.0, "vestibule": 0.5},
    "ear": {name: 1.0 - 0.15 * k for k, name in enumerate(EAR_RINGS)},
}


class Atlas(NamedTuple):
    """Texture coordinates (U, 2), v up, and the rows of them (Q, 4) at the corners of the quads."""

    uv: np.ndarray
    quads: np.ndarray


def make_atlas(cage: Cage, surface: Surface, rest: np.ndarray, parts: list[Part]) -> Atlas:
    """Lay out the skin `rest` (V, 3), mm, of the plain person and the parts."""
    inner, local = _inner_charts(cage)
    corners = _skin_chart(rest, surface.quads, ~np.repeat(inner, 4**LEVELS))
    fine = refined(local)
    hidden = np.repeat(inner, 4**LEVELS)
    corners[hidden] = fine[hidden]
    pieces = [corners, *(_placed(part.kind, part.chart) for part in parts)]
    every = np.round(np.concatenate(pieces), 7)
    uv, rows = np.unique(every.reshape(-1, 2), axis=0, return_inverse=True)
    return Atlas(uv, rows.reshape(-1, 4))


def _placed(cell: str, local: np.ndarray) -> np.ndarray:
    """Coordinates of a cell, 0 to 1, in the atlas."""
    left, bottom, width, height = CELLS[cell]
    return np.array([left, bottom]) + local * np.array([width, height])


def _disc(angle: np.ndarray | float, radius: np.ndarray | float) -> np.ndarray:
    return 0.5 + 0.5 * np.asarray(radius)[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)


def _inner_charts(cage: Cage) -> tuple[np.ndarray, np.ndarray]:
    """Which cage quads (Q,) lie inside, and the atlas coordinates (Q, 4, 2) of their corners."""
    inner, corners = np.zeros(len(cage.quads), dtype=bool), np.zeros((len(cage.quads), 4, 2))
    half = len(cage.quads) // 2
    for i, quad in enumerate(cage.quads[:half]):
        names = [cage.names[corner] for corner in quad]
        rings = {name.partition(".")[0] for name in names}
        for cell, radii in _DISCS.items():
            if rings <= set(radii):
                split = [name.split(".") for name in names]
                count = 12 if cell == "socket" else 6
                spots = np.array([_disc(2 * np.pi * int(k) / count, radii[ring]) for ring, k in split])
                inner[[i, half + i]] = True
                corners[i], corners[half + i] = _placed(cell, spots), _placed(cell, spots[::-1])
        if rings <= {"bag", "lining", "inner", "seam", "mi", "mc"}:
            spots = np.array([_mouth_spot(name) for name in names])
            inner[[i, half + i]] = True
            corners[i], corners[half + i] = _placed("mouth", spots), _placed("mouth", spots[::-1] * [-1, 1] + [1, 0])
    return inner, corners


def _mouth_spot(name: str) -> np.ndarray:
    ring, _, place = name.partition(".")
    radius = {"seam": 1.0, "inner": 0.85, "lining": 0.72, "bag": 0.6, "mi": 0.3, "mc": 0.0}[ring]
    return _disc(np.pi / 2 - np.pi * int(place or 4) / 8, radius)


def _skin_chart(rest: np.ndarray, quads: np.ndarray, outside: np.ndarray) -> np.ndarray:
    """Atlas coordinates (Q, 4, 2) of the corners of all skin quads; those not `outside` are not yet right."""
    behind = (np.abs(rest[quads, 0]) < 1e-9) & (rest[quads, 2] < AXIS)  # on the cut: as far round as its quad's side
    right = rest[quads, 0].mean(1) < 0
    twin = np.where(behind & right[:, None], quads + len(rest), quads)
    double = np.concatenate([rest, rest])
    turn = np.arctan2(np.where(np.abs(double[:, 0]) < 1e-9, 0.0, double[:, 0]), double[:, 2] - AXIS)
    turn[len(rest) :] = np.where(turn[len(rest) :] > 0, turn[len(rest) :] - 2 * np.pi, turn[len(rest) :])
    rolled = np.stack([_denser(turn), _height(double)], 1)
    flat = _unfolded(rolled, twin[outside])
    low, high = flat[twin[outside]].min((0, 1)), flat[twin[outside]].max((0, 1))
    reach = max(-low[0], high[0])
    u = 0.5 + 0.495 * flat[:, 0] / reach
    v = FLOOR + 0.005 + (0.99 - FLOOR) * (flat[:, 1] - low[1]) / (high[1] - low[1])
    return np.stack([u, v], 1)[twin]


def _denser(turn: np.ndarray) -> np.ndarray:
    """Angles round the cylinder, drawn apart in front; mm."""
    return 276 * np.arctan(2.2 * turn / np.pi) / np.arctan(2.2)


def _height(points: np.ndarray) -> np.ndarray:
    """Height on the chart: along the surface over the crown, the neck and the crown shortened; mm."""
    y = points[:, 1]
    crown = 60 + 42 * np.arcsin(np.clip((y - 60) / 58, 0, 1))
    return np.where(y > 60, crown, np.where(y < -115, -115 + 0.5 * (y + 115), y))


def _unfolded(rolled: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Coordinates near `rolled` (V, 2), smoothed more and more around quads that are turned over."""
    count, flat, hold = len(rolled), rolled, np.full(len(rolled), 5.0)
    ends = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    ends = np.unique(np.sort(ends, axis=1), axis=0)
    a, b = np.concatenate([ends, ends[:, ::-1]]).T
    near = sparse.csr_matrix((np.ones(len(a)), (a, b)), shape=(count, count))
    degree = np.asarray(near.sum(1)).ravel()
    for _ in range(ROUNDS):
        first, second = flat[quads[:, 2]] - flat[quads[:, 0]], flat[quads[:, 3]] - flat[quads[:, 1]]
        area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        if (area > 0).all():
            break
        bad = np.zeros(count)
        bad[quads[area <= 0]] = 1
        for _ in range(3):
            bad = np.maximum(bad, (near @ bad > 0) * 1.0)
        hold = np.where(bad > 0, 0.4 * hold, hold)
        system = sparse.diags(degree + hold) - near
        flat = np.asarray(spsolve(sparse.csc_matrix(system), hold[:, None] * rolled))
    return flat
