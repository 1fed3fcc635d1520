"""Lips that an answer leaves apart although the markers around them are hardly farther apart than at rest."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from blendcap.data import Binding, Rig, Solution
from blendcap.data.names import canonical
from blendcap.modeling.contacts import find_contacts
from blendcap.numerics.stretches import stretches
from blendcap.view.posing import weights_on

UP = 1  # the axis along which lips part
# mm from the middle of the lips, sideways and in all: a marker that tells whether they are shut
ASIDE, AWAY = 15.0, 30.0
CLOSE = 1.5  # mm: markers that came no farther apart than this are about as close as at rest
PARTED = 2.0  # mm: what an eye sees
UNKNOWN = 1000.0  # mm: markers that nobody sees are not close
AROUND = 0.5  # seconds over which both are averaged, and for which it must last


def parted_lips(rig: Rig, solution: Solution, binding: Binding) -> tuple[float, int, int] | None:
    """The longest stretch of them: how far apart lips are at most, mm beyond the neutral, first and last frame.

    Markers do not sit where lips meet, so that nothing in the data tells the last millimetres.

    Returns
    -------
    (float, int, int) or None
        None if there is no such stretch, the rig's lips never meet or have no `jawOpen`, or no marker lies above or
        none below them.
    """
    opening = _opening(rig, solution)
    if opening is None or solution.targets is None:
        return None
    way, middle = opening
    markers = _upper_and_lower(binding.points.positions(rig.mesh) - middle)
    if markers is None:
        return None
    apart = np.linalg.norm(solution.targets[:, markers[0]] - solution.targets[:, markers[1]], axis=1)
    at_rest = binding.points.positions(rig.mesh) + binding.offsets
    apart = np.nan_to_num(apart - np.linalg.norm(at_rest[markers[0]] - at_rest[markers[1]]), nan=UNKNOWN)
    width = max(1, round(AROUND * solution.animation.rate))
    way, apart = (uniform_filter1d(values, width, mode="nearest") for values in (way, apart))
    first, last = max(
        stretches((way > PARTED) & (apart < CLOSE)), key=lambda stretch: stretch[1] - stretch[0], default=(0, -1)
    )
    if last - first + 1 < width:
        return None
    return float(way[first : last + 1].max()), first, last


def _opening(rig: Rig, solution: Solution) -> tuple[np.ndarray, np.ndarray] | None:
    """How far lips part beyond the neutral, (T,) mm, positive as `jawOpen` parts them, and their middle (3,)."""
    names = [canonical(name) for name in rig.names]
    pairs = rig.contacts["lips"] if "lips" in rig.contacts else find_contacts(rig).get("lips", np.zeros((0, 2), int))
    if not len(pairs) or "jawOpen" not in names:
        return None
    across = rig.deltas[:, pairs[:, 0], UP] - rig.deltas[:, pairs[:, 1], UP]
    across = across * np.sign(across[names.index("jawOpen")])
    return weights_on(rig, solution.animation) @ across.mean(1), rig.mesh.vertices[pairs].mean((0, 1))


def _upper_and_lower(places: np.ndarray) -> tuple[int, int] | None:
    """Of places (M, 3) from the middle of the lips, the nearest above and the nearest below."""
    distance = np.linalg.norm(places, axis=1)
    near = (np.abs(places[:, 0]) < ASIDE) & (distance < AWAY)
    sides = [np.flatnonzero(near & (sign * places[:, UP] > 0)) for sign in (1, -1)]
    if not all(len(side) for side in sides):
        return None
    upper, lower = (int(side[distance[side].argmin()]) for side in sides)
    return upper, lower
