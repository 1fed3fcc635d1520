"""The muscles of the face: where they start on the bone, where they end in the skin, and what skin goes with them.

After Waters (1987), "A muscle model for animating three-dimensional facial expression": a linear muscle draws the skin
of its zone towards its origin, a sheet draws it all in one direction, a sphincter draws it to a center. Both ends are
named points, so they move with the person, and a contraction is a share of the muscle's length: a face with a longer
muscle moves further. The zone of influence grows with the muscle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.face import Face, push
from blendcap.synthetic.mannequin.fields import gauss


class Muscle(NamedTuple):
    """One muscle of the left half of the face."""

    origin: str  # authored points on the bone, their mean if several
    insertion: str  # likewise, in the skin
    zone: tuple[float, float, float]  # spread of the skin that goes with it in the plain person, mm
    carries: str = "skin"  # what it may move: see `_carried`
    bulge: float = 0.0  # how far the skin rises along its normal, per mm that the insertion travels
    sheet: bool = False


MUSCLES: Mapping[str, Muscle] = {
    # forehead and brows
    "frontalis_medial": Muscle("b2 b0", "orbit.1 orbit.2 H2", (10, 10, 20), sheet=True),
    "frontalis_middle": Muscle("b0", "a0", (16, 14, 20), sheet=True),
    "frontalis_lateral": Muscle("b3 b4", "orbit.4", (15, 11, 24), sheet=True),
    "procerus": Muscle("C1 N1", "N0", (11, 8, 14), sheet=True),
    "depressor_supercilii": Muscle("C1 G1", "orbit.2", (14, 8, 20), sheet=True, bulge=0.15),
    "corrugator": Muscle("N0 G1", "orbit.2 orbit.3", (13, 8, 20), bulge=0.35),
    "orbicularis_oculi_lateral": Muscle("sulcus.5", "orbit.4 orbit.5", (13, 9, 20), sheet=True),
    # around the eye
    "orbicularis_oculi_cheek": Muscle("sulcus.8 sulcus.9", "P9", (14, 9, 14), "below_lids", bulge=0.45, sheet=True),
    "orbicularis_oculi_lower": Muscle("margin.9", "crease.9", (13, 5, 10), sheet=True),
    "orbicularis_oculi_ring": Muscle("margin.8", "sulcus.8", (13, 6, 12), sheet=True),
    # nose
    "levator_alaeque_nasi": Muscle("orbit.0", "W2", (8, 10, 10), "nose", sheet=True),
    "nasalis_transverse": Muscle("orbit.0", "K1", (7, 8, 9), "nose", bulge=0.5, sheet=True),
    "nasalis_alar": Muscle("Q10", "W2", (7, 7, 8), "nose", sheet=True),
    "compressor_naris": Muscle("N6", "W2", (7, 7, 8), "nose", sheet=True),
    "depressor_septi": Muscle("fold.0", "N4", (8, 8, 9), "nose", sheet=True),
    # cheek and upper lip
    "levator_labii": Muscle("orbit.9 orbit.10", "border.1 border.2", (14, 9, 14), "upper_lip", sheet=True),
    "levator_labii_medial": Muscle("orbit.0", "border.2", (10, 9, 12), "upper_lip", sheet=True),
    "zygomatic_minor": Muscle("P8", "fold.3 fold.4", (9, 9, 12), "cheek_and_lip", bulge=0.1),
    "zygomatic_major": Muscle("P7", "seam.4", (13, 12, 18), "corner"),
    "levator_anguli": Muscle("P10", "seam.4", (9, 10, 14), "corner"),
    "malar_pad": Muscle("orbit.8 orbit.9", "P9", (15, 12, 18), "cheek", bulge=0.75, sheet=True),
    "cheek_fold": Muscle("P10 P9", "Q10", (10, 11, 14), "cheek", bulge=1.2, sheet=True),
    # corner of the mouth
    "risorius": Muscle("R9", "seam.4", (13, 12, 18), "corner"),
    "buccinator": Muscle("R8", "seam.4", (12, 11, 18), "corner"),
    "depressor_anguli": Muscle("S9 S10", "seam.4", (13, 12, 18), "corner"),
    "depressor_anguli_skin": Muscle("S10", "fold.5", (9, 9, 12), "outside", bulge=0.3, sheet=True),
    # lower lip, chin, neck
    "depressor_labii": Muscle("M67 S10", "border.6", (14, 10, 14), "lower_lip", sheet=True),
    "mentalis": Muscle("fold.8", "M68", (22, 12, 20), "outside", bulge=0.25, sheet=True),
    "platysma": Muscle("S9", "R9", (16, 14, 22), "outside", sheet=True),
    "platysma_neck": Muscle("neck2.1", "neck1.1", (22, 26, 30), "outside", bulge=0.25, sheet=True),
    "masseter": Muscle("Q7", "S8", (10, 16, 20), "outside", bulge=4.0, sheet=True),
}

LIPS = {"inner": 1, "seam": 1, "crest": 1, "border": 0.95, "around": 0.55, "fold": 0.25}


def contract(face: Face, contractions: Mapping[str, float]) -> np.ndarray:
    """Displacement (H, 3) of the left half when each muscle shortens by a share of its length."""
    moved = np.zeros_like(face.points)
    for name, share in contractions.items():
        moved += _pull(face, MUSCLES[name], share)
    return moved


def lip_weights(face: Face) -> np.ndarray:
    """How much each point (H,) goes with the lips."""
    return face.weights(LIPS)


def _pull(face: Face, muscle: Muscle, share: float) -> np.ndarray:
    origin, insertion = face.spot(muscle.origin), face.spot(muscle.insertion)
    length = float(np.linalg.norm(origin - insertion))
    plain = face.spot(muscle.origin, plain=True) - face.spot(muscle.insertion, plain=True)
    grown = length / float(np.linalg.norm(plain))
    zone = gauss(face.points, insertion, np.multiply(muscle.zone, grown))
    amount = share * length * _carried(face, muscle.carries, zone)
    fibre = origin - (insertion if muscle.sheet else face.points)
    fibre = fibre / np.maximum(np.linalg.norm(fibre, axis=-1, keepdims=True), 1e-9)
    return amount[:, None] * fibre + push(muscle.bulge * abs(amount), (1, 1, 1)) * face.normals


def _carried(face: Face, what: str, zone: np.ndarray) -> np.ndarray:
    """The part (H,) of a zone that a muscle may move: skin slides over lids, teeth and the other lip."""
    lips = lip_weights(face)
    if what == "corner":
        along = 0.55 * lips * smoothstep(2, 22, face.across) ** 1.5
        return np.maximum(zone, along) * ~face.on_globe
    if what in ("upper_lip", "lower_lip"):
        side, width = (face.upper, 14) if what == "upper_lip" else (face.lower, 12)
        return side * lips * (0.35 + 0.65 * smoothstep(25, width, face.across))
    outside = {
        "skin": ~face.on_globe & (face.points[:, 2] > 0),
        "below_lids": ~face.on_globe & ~face.mouth,
        "nose": ~face.on_globe & ~face.lower & ~((lips > 0.3) & face.mouth),
        "cheek": ~face.on_globe & ~face.mouth,
        "cheek_and_lip": ~face.on_globe & ~face.lower,
        "outside": ~face.on_globe & ((~face.mouth) | (face.ring == "fold")),
    }[what]
    return zone * outside
