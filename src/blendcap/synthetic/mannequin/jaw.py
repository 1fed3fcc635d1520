"""The shapes of the lower jaw, and the lips that stay together while it opens."""

from __future__ import annotations

import numpy as np

from blendcap.synthetic.mannequin.cage import ring
from blendcap.synthetic.mannequin.face import Face, push
from blendcap.synthetic.mannequin.identity import Person

HINGE = np.array([0.0, -8.0, 6.0])  # the axis of the jaw joint in the plain person, mm
ANGLE = np.radians(19.0)
SLIDE = 1.5  # the condyle slides forward as the jaw opens, mm
STRETCHED = 1.3  # jawOpen with jawStretch, as a share of jawOpen
SIDEWAYS, FORWARD, BACK, SINK = 7.0, 6.0, -2.5, 0.8  # mm

_SKIN = {
    "R10": 0.72, "R9": 0.62, "R8": 0.42, "S10": 1.0, "S9": 0.97, "S8": 0.55, "M67": 1.0, "M68": 1.0, "M77": 1.0,
    "M78": 1.0, "M87": 0.72, "M88": 0.72, "Q10": 0.16, "Q9": 0.2, "Q8": 0.17, "Q7": 0.04, "neck1.0": 0.28,
    "neck1.1": 0.28, "neck1.2": 0.12, "mi": 0.7, "mc": 0.7,
}  # fmt: skip
_MOUTH = (0, 0, 0.015, 0.21, 0.50, 0.70, 0.97, 1, 1)
_RINGS = {
    "fold": (0, 0, 0, 0.03, 0.34, 0.86, 1, 1, 1),
    "around": (0, 0, 0.015, 0.06, 0.40, 0.82, 0.97, 1, 1),
    "inner": (0, 0, 0.015, 0.22, 0.60, 0.97, 1, 1, 1),
    "lining": (0, 0, 0, 0.06, 0.60, 0.98, 1, 1, 1),
    "bag": (0, 0, 0, 0.05, 0.5, 0.97, 1, 1, 1),
}
_WITH_LIPS = {"bag": 0.08, "lining": 0.3, "inner": 1.0, "seam": 1.0, "crest": 1.0, "border": 0.95,
              "around": 0.7, "fold": 0.32}  # fmt: skip
_CHIN_WITH_LIPS = {"R10": 0.14, "S10": 0.16, "M67": 0.2, "M68": 0.2}


def jaw_weights(face: Face) -> np.ndarray:
    """How much each point (H,) goes with the jaw bone."""
    weights = face.weights(_SKIN)
    for i in np.flatnonzero(face.mouth):
        weights[i] = _RINGS.get(str(face.ring[i]), _MOUTH)[face.place[i]]
    return weights


def opened(points: np.ndarray, share: np.ndarray | float, hinge: np.ndarray) -> np.ndarray:
    """Displacement (P, 3) of points that go with the opening jaw by a share (P,) of its angle: along the arc."""
    angle = ANGLE * np.asarray(share)
    y, z = points[:, 1] - hinge[1], points[:, 2] - hinge[2]
    moved = np.zeros_like(points)
    moved[:, 1] = (np.cos(angle) - 1) * y - np.sin(angle) * z
    moved[:, 2] = np.sin(angle) * y + (np.cos(angle) - 1) * z + SLIDE * np.asarray(share)
    return moved


def hinge_of(person: Person) -> np.ndarray:
    """A point (3,) on the axis of a person's jaw joint, mm."""
    return person.moved(HINGE[None])[0]


def jaw_opened(face: Face, share: float) -> np.ndarray:
    """The jaw falls by a share of its angle; the corners of the mouth are drawn in."""
    moved = opened(face.points, share * jaw_weights(face), hinge_of(face.person))
    drawn = face.near("seam.4", (11, 12, 16)) * np.select([face.ring == "bag", face.ring == "lining"], [0.0, 0.3], 1.0)
    return moved + push(share * drawn * (face.points[:, 0] > 1e-9), (-3.6, 0, -1.2))


def jaw_open(face: Face) -> np.ndarray:
    """The jaw falls."""
    return jaw_opened(face, 1.0)


def jaw_stretch(face: Face) -> np.ndarray:
    """What it takes from the open jaw to the widest (action unit 27)."""
    turned_out = push(face.weights({"crest.5": 0.8}), (1, 0, -0.6)) + push(face.weights({"inner.4": 0.8}), (0.5, 0, -1))
    return jaw_opened(face, STRETCHED) - jaw_opened(face, 1.0) + turned_out


def jaw_forward(face: Face) -> np.ndarray:
    """The jaw comes forward."""
    lips = 0.4 * face.upper * face.weights({"crest": 1, "border": 0.8, "around": 0.4})
    return face.sealed(push(np.maximum(jaw_weights(face), lips), (0, -SINK, FORWARD)))


def jaw_back(face: Face) -> np.ndarray:
    """The jaw draws back."""
    return face.sealed(push(jaw_weights(face), (0, -0.3 * SINK, BACK)))


def jaw_aside(face: Face) -> np.ndarray:
    """The jaw goes to the subject's left; of the whole cage (N, 3), as it has no mirror symmetry."""
    weights = face.sealed(push(jaw_weights(face), (1, 1, 1)))[:, 0]
    inner, seam = (face.cage.index(ring(name, 9)) for name in ("inner", "seam"))
    weights[inner] = 0.5 * (weights[inner] + weights[seam])  # what lies behind the closed lips goes with them
    return push(face.cage.mirrored(weights, vectors=False), (SIDEWAYS, 0, 0))


def mouth_close(face: Face) -> np.ndarray:
    """With the jaw open, the lips meet again: both seams go to one curve, nearer to the upper lip."""
    opening = face.points + jaw_open(face)
    moved = np.zeros_like(opening)
    upper_seam, lower_seam = face.pairs("seam", range(4))
    meeting = 0.66 * opening[upper_seam] + 0.34 * opening[lower_seam]
    meeting[:, 2] = np.maximum(opening[upper_seam, 2], opening[lower_seam, 2]) - 2.0
    for name, share in _WITH_LIPS.items():
        above, below = face.pairs(name, range(4))
        moved[above] = share * (meeting - opening[upper_seam])
        moved[below] = share * (meeting - opening[lower_seam])
    for inner, seam in zip(face.pairs("inner", range(4)), (upper_seam, lower_seam), strict=True):
        behind = (face.points[inner] - face.points[seam]) - (opening[inner] - opening[seam])
        moved[inner] += 0.5 * behind  # what the jaw drew apart lies together again
    chin = face.weights(_CHIN_WITH_LIPS)
    return moved + push(chin, moved[face.cage.index(["seam.6"])[0]])
