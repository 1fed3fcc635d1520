"""Who the mannequin is: named measures, each in mm at the place that it is named after, and asymmetries.

A measure moves space smoothly, so it moves the authored points, the eyes and the teeth alike. The eyeball and the lids
on it move as one body and the lids are put back on their own spheres, so they fit in every identity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral

import numpy as np

from blendcap.data import InputError
from blendcap.synthetic.mannequin.asymmetry import ASYMMETRIES, Bend
from blendcap.synthetic.mannequin.cage import Cage, ring
from blendcap.synthetic.mannequin.draws import drawn
from blendcap.synthetic.mannequin.measures import MEASURES, displacement

GLOBE = np.array([31.5, 0.0, 69.5])  # the left eyeball's center, mm
GLOBE_RADIUS = 11.8
LINING, THIN = 1.2, 0.7  # of the lining of the lids above the eyeball, and at least where the skin lies close, mm
BEHIND = 1.4  # and behind the crease of the lids, mm
OUTER = (4, 5, 7, 8)  # places of the rings of the eye where the skin lies close; the canthus has room

PEOPLE: dict[str, dict[str, float]] = {
    "plain": {},
    "ada": {"bizygomatic_width": -6, "bigonial_width": -10, "chin_width": -8, "nasal_width": -4, "nose_protrusion": -2,
            "nose_tip_rotation": 2.5, "upper_lip_height": 2.2, "lower_lip_height": 2.2, "brow_ridge": -3,
            "brow_height": 2, "eye_height": 1.4, "lower_face_height": -4, "neck_width": -16, "jaw_drop_angle": -4,
            "midface_height": -2, "canthal_tilt": 1},
    "kofi": {"bizygomatic_width": 4, "bigonial_width": 10, "chin_width": 8, "nasal_width": 6, "nose_protrusion": -3,
             "nasal_bridge_height": -3.5, "upper_lip_height": 3, "lower_lip_height": 3, "maxilla": 3, "mouth_width": 5,
             "brow_ridge": 1},
    "lars": {"head_width": -8, "bizygomatic_width": -8, "lower_face_height": 8, "midface_height": 4, "nose_length": 4,
             "dorsal_hump": 3, "nose_protrusion": 5, "nasal_bridge_height": 3, "cheek_fullness": -5,
             "chin_projection": 4, "upper_lip_height": -1.5, "lower_lip_height": -1.5, "brow_ridge": 3,
             "eye_depth": 2.5, "eye_height": -0.8, "forehead_height": 4},
    "rosa": {"cheek_fullness": 6, "bigonial_width": 10, "bizygomatic_width": 8, "chin_width": 4,
             "lower_face_height": -3, "neck_width": 16, "nose_tip_rotation": 2, "nasal_width": 3, "eye_height": -0.6,
             "nose_length": -3},
    "mei": {"nasal_bridge_height": -4, "canthal_tilt": 2, "eye_height": -0.9, "cheekbone": 4, "nasal_width": 2,
            "intercanthal_width": 3, "brow_ridge": -3, "eye_depth": -2.5, "nose_protrusion": -3,
            "bizygomatic_width": 6, "brow_height": 2, "bigonial_width": -4, "dorsal_hump": -1},
}  # fmt: skip

_ON_THE_GLOBE = ("canthal_tilt", "eye_height")  # move the lids over the eyeball, which stays


@dataclass(frozen=True, eq=False)
class Person:
    """One identity, as symmetric as it is built; `bend` then sets the sides apart.

    Parameters
    ----------
    points : (H, 3) float64
        The authored half of the cage, moved, mm.
    globe : (3,) float64
        Center of the left eyeball, mm.
    measures : {name: float}
    """

    points: np.ndarray
    globe: np.ndarray
    measures: Mapping[str, float]

    @property
    def bend(self) -> Bend:
        """What makes the sides differ."""
        return Bend(self.measures, self.globe)

    def moved(self, points: np.ndarray) -> np.ndarray:
        """Free points (..., 3) of the plain head, moved into this one: teeth and tongue."""
        return points + displacement(points, _symmetric(self.measures))


def measures_of(identity: int | str | Mapping[str, float]) -> dict[str, float]:
    """The measures of a seed (0: the plain person), of a name in PEOPLE, or the given ones, checked.

    Raises
    ------
    InputError
        If a name is unknown or a measure is out of its bounds.
    """
    if isinstance(identity, str):
        if identity not in PEOPLE:
            raise InputError(f"There is no mannequin named {identity!r}; choose one of {', '.join(PEOPLE)}.")
        return dict(PEOPLE[identity])
    if isinstance(identity, Integral):
        if identity < 0:
            raise InputError(f"A mannequin's seed is a whole number from 0, but is {identity}.")
        return drawn(int(identity)) if identity else {}
    if not isinstance(identity, Mapping):
        raise InputError(f"A mannequin's identity is a seed, a name or named measures in mm, but is {identity!r}.")
    known = {**MEASURES, **ASYMMETRIES}
    for name, value in identity.items():
        if name not in known:
            raise InputError(f"The mannequin has no measure named {name!r}; it has {', '.join(known)}.")
        limit = 2 * known[name].deviation
        try:
            inside = -limit <= float(value) <= limit
        except (TypeError, ValueError):
            raise InputError(f"The mannequin's {name} must be a number, but is {value!r}.") from None
        if not inside:
            raise InputError(f"The mannequin's {name} is {value:g}, but must lie between {-limit:g} and {limit:g}.")
    return {name: float(value) for name, value in identity.items()}


def _symmetric(measures: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in measures.items() if name in MEASURES}


def _off_globe(points: np.ndarray, globe: np.ndarray) -> np.ndarray:
    """The lining of the lids (P, 3), nowhere nearer to the eyeball than LINING."""
    out = points - globe
    height = np.linalg.norm(out, axis=1, keepdims=True)
    return globe + out / height * np.maximum(height, GLOBE_RADIUS + LINING)


def behind_lids(cage: Cage, points: np.ndarray, globe: np.ndarray) -> np.ndarray:
    """Points (H, 3) of a face whose lining lies behind the skin of the lids, where the eyeball leaves it little room.

    It sinks along its rays from the center of the eyeball; the skin does not move.
    """
    sock, crease = (cage.index(ring(name, OUTER)) for name in ("sock", "crease"))
    out, kept = points[sock] - globe, points.copy()
    height, skin = (np.linalg.norm(points[at] - globe, axis=1, keepdims=True) for at in (sock, crease))
    room = np.maximum(skin - BEHIND, GLOBE_RADIUS + THIN)
    kept[sock] = globe + out / height * np.minimum(height, room)
    return kept


def make_person(cage: Cage, measures: Mapping[str, float]) -> Person:
    """The authored points of `cage` under these measures, lids fitted to the eyeballs."""
    own = _symmetric(measures)
    rigid = {name: value for name, value in own.items() if name not in _ON_THE_GLOBE}
    local = {name: value for name, value in own.items() if name in _ON_THE_GLOBE}
    points = cage.half + displacement(cage.half, own)
    shift = displacement(GLOBE[None], rigid)[0]
    for name, share in (("sock", 1.0), ("margin", 1.0), ("edge", 1.0), ("crease", 0.75)):
        at = cage.index(ring(name, 12))
        rest = cage.half[at]
        moved = rest + share * shift + (1 - share) * displacement(rest, rigid) + displacement(rest, local)
        if name in ("margin", "edge"):
            radius = np.linalg.norm(rest - GLOBE, axis=1, keepdims=True)
            out = moved - (GLOBE + shift)
            moved = GLOBE + shift + out * radius / np.linalg.norm(out, axis=1, keepdims=True)
        if name == "sock":
            moved = _off_globe(moved, GLOBE + shift)
        points[at] = moved
    return Person(behind_lids(cage, points, GLOBE + shift), GLOBE + shift, dict(measures))
