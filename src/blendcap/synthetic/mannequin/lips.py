"""The shapes of the mouth. Each returns a displacement (H, 3) of the left half; the caller mirrors and splits it.

Muscles that end in the lips come from `muscles`; the ring muscle, orbicularis oris, is here. What it does is measured
in the person's own lips: thick lips roll further, a wide mouth purses further.
"""

from __future__ import annotations

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.face import Face, push
from blendcap.synthetic.mannequin.muscles import contract, lip_weights


def _heights(face: Face) -> np.ndarray:
    """Height (H,) of the red of the lip that each point belongs to, mm: 6.6 above and 9.7 below in the plain person."""
    middle, upper, lower = (face.at(name)[1] for name in ("seam.0", "border.0", "border.8"))
    return np.where(face.upper, upper - middle, middle - lower)


def _near_middle(face: Face, width: float, most: float) -> np.ndarray:
    """1 in the middle of the mouth, less towards the corners."""
    return 1 - most + most * smoothstep(27, width, face.across)


def smile(face: Face) -> np.ndarray:
    """The corner goes up, out and back; the cheek rises before it and the nasolabial fold deepens between them."""
    corner = contract(face, {"zygomatic_major": 0.15, "risorius": 0.065})
    lip = lip_weights(face) * smoothstep(2, 22, face.across) ** 1.5 * smoothstep(4, 16, face.across)
    lifted = push(0.045 * face.at("seam.4")[0] * lip, (0, 1.0, -0.5))
    cheek = contract(face, {"malar_pad": 0.36, "cheek_fold": 0.12, "orbicularis_oculi_lower": 0.16})
    return face.sealed(corner + lifted + cheek + _fold(face, 0.26))


def smile_open(face: Face) -> np.ndarray:
    """What an open smile adds to a smile and an open jaw: the corners stay wide and the upper lip bares the teeth."""
    upper = contract(face, {"levator_labii": 0.06}) + _fold(face, 0.12)
    turned_out = push(face.weights({"crest.4": 0.5}), (1, 0.2, 0.2))  # else the red of the corner would fold in
    return upper + contract(face, {"zygomatic_major": 0.03}) + push(_corner_field(face), (1.6, 0, 0)) + turned_out


def _fold(face: Face, share: float) -> np.ndarray:
    """The nasolabial fold sinks as the cheek slides over it; full cheeks fold deeper."""
    depth = share * float(np.linalg.norm(face.at("Q10") - face.at("fold.4")))
    line = face.weights({"fold.3": 0.55, "fold.4": 0.85, "fold.5": 0.25, "around.3": 0.25})
    beside = face.weights({"P10": 0.3, "Q10": 0.6, "K2": 0.2, "P9": 0.15})
    return (0.6 * depth * beside - 0.55 * depth * line)[:, None] * face.normals + push(0.25 * depth * line, (0.4, 1, 0))


def corner_up(face: Face) -> np.ndarray:
    """Levator anguli oris: the corner rises sharply, the cheek fills beside it (action unit 13)."""
    return face.sealed(contract(face, {"levator_anguli": 0.2, "cheek_fold": 0.2}) + _fold(face, 0.12))


def frown(face: Face) -> np.ndarray:
    """The corner goes down."""
    return face.sealed(contract(face, {"depressor_anguli": 0.2, "depressor_anguli_skin": 0.12}))


def dimple(face: Face) -> np.ndarray:
    """The corner is drawn back into the cheek."""
    dent = -1.4 * face.near("fold.4", (5, 6, 8)) * (face.ring != "bag")
    return face.sealed(contract(face, {"buccinator": 0.1}) + push(0.55 * _corner_field(face), (3.6, 0.5, 0))
                       + dent[:, None] * face.normals)  # fmt: skip


def _corner_field(face: Face) -> np.ndarray:
    return face.near("seam.4", (11, 12, 16)) * ~face.on_globe


def stretch(face: Face) -> np.ndarray:
    """The corner goes out and a little down, with the skin of the jaw."""
    return face.sealed(contract(face, {"risorius": 0.15, "depressor_anguli": 0.07, "platysma": 0.12})
                       + push(0.6 * _corner_field(face), (3.4, 0, 0)))  # fmt: skip


def nasolabial_deepen(face: Face) -> np.ndarray:
    """Zygomaticus minor lifts the side of the upper lip and deepens the fold (action unit 11)."""
    return face.sealed(contract(face, {"zygomatic_minor": 0.12, "cheek_fold": 0.14}) + _fold(face, 0.3))


def upper_up(face: Face) -> np.ndarray:
    """The upper lip is raised, the wing of the nose with it."""
    return contract(face, {"levator_labii": 0.15, "levator_alaeque_nasi": 0.035}) + _fold(face, 0.1)


def lower_down(face: Face) -> np.ndarray:
    """The lower lip is drawn down from the teeth."""
    return contract(face, {"depressor_labii": 0.25}) + push(face.lower * lip_weights(face), (0, 0, 1.2))


def part(face: Face) -> np.ndarray:
    """The lips part a little (action unit 25)."""
    opened = 0.22 * _heights(face) * lip_weights(face) * _near_middle(face, 10, 0.8)
    return (opened * (0.4 * face.upper - 1.0 * face.lower))[:, None] * np.array([0, 1, 0]) + push(
        0.3 * opened * face.lower, (0, 0, 1)
    )


def press(face: Face) -> np.ndarray:
    """The lips are pressed together and show less red."""
    weight = lip_weights(face) * (face.upper | face.lower)
    closer = np.clip(0.22 * (face.at("seam.0")[1] - face.points[:, 1]), -1.5, 1.5)
    inward = face.weights({"crest": -0.27, "border": -0.15, "seam": -0.07}) * _heights(face)
    inward *= _near_middle(face, 12, 0.6)
    return face.sealed(weight[:, None] * np.stack([0 * closer, closer, inward], 1))


def tighten(face: Face) -> np.ndarray:
    """The lips draw narrow and their red turns in (action unit 23)."""
    weight = lip_weights(face)
    heights = _heights(face)
    inward = face.weights({"crest": -0.3, "border": -0.12, "seam": -0.1}) * heights * _near_middle(face, 12, 0.7)
    closer = face.weights({"border": 0.22, "crest": 0.12, "around": 0.1}) * heights * (1.0 * face.lower - face.upper)
    closer *= _near_middle(face, 12, 0.9)
    return face.sealed(np.stack([-0.07 * face.points[:, 0] * weight, closer, inward], 1))


def _sphincter(face: Face, narrower: float, apart: float, forward: float, curl: float) -> np.ndarray:
    """Orbicularis oris draws the mouth together and forward."""
    half = face.at("seam.4")[0] / 26.0
    ring = face.weights({"seam": 1, "crest": 1, "border": 0.95, "around": 0.75, "fold": 0.3})
    ring = np.maximum(ring, 0.25 * face.near("Q10 R10 fold.4", (10, 14, 14)) * ~face.mouth)
    side = face.upper * 1.0 - face.lower * 1.0
    rolled = (
        curl * _near_middle(face, 14, 0.8) * face.weights({"crest": 1, "border": 0.35, "seam": 0.4}) * _heights(face)
    )
    out = forward * half * ring * (0.55 + 0.45 * smoothstep(28, 6, face.across)) + rolled
    open_ = apart * _heights(face) * ring * side * smoothstep(30, 10, face.across)
    return np.stack([-narrower * face.points[:, 0] * ring, open_, out], 1)


def funnel(face: Face) -> np.ndarray:
    """The lips form a funnel, as in "ooh" said through a tube: open and forward."""
    return _sphincter(face, 0.40, 0.5, 6.0, 0.22)


def pucker(face: Face) -> np.ndarray:
    """The lips close to a kiss."""
    closer = (
        face.weights({"crest": 0.1, "border": 0.1})
        * _near_middle(face, 14, 0.9)
        * _heights(face)
        * (face.lower * 1.0 - face.upper * 1.0)
    )
    tucked = push(face.weights({"crest.4": 0.3}), (-1, -0.5, 0))  # else thin lips fold in the corner
    return face.sealed(_sphincter(face, 0.50, 0, 7.0, 0.13) + push(closer, (0, 1, 0)) + tucked)


def mouth_aside(face: Face) -> np.ndarray:
    """The mouth goes to the subject's left, round the teeth; of the whole cage (N, 3), as it has no mirror symmetry."""
    lips = np.maximum(lip_weights(face), face.weights({"around": 0.8, "fold": 0.45}))
    weight = np.maximum(lips, 0.45 * face.near("fold.4 fold.5 Q10 R10", (16, 18, 18)))
    weight = face.cage.mirrored(weight * ~face.on_globe, vectors=False)
    half = face.at("seam.4")[0]
    leading = smoothstep(5 / 26, 25 / 26, face.cage.mirrored(face.points)[:, 0] / half)
    return weight[:, None] * np.stack([np.full_like(leading, 0.2 * half), leading, -2.2 * leading], 1)


def _rolled(face: Face, side: np.ndarray, direction) -> np.ndarray:
    ring = face.weights({"seam": 0.95, "crest": 1, "border": 0.75, "around": 0.3})
    return push(ring * side * _heights(face) * _near_middle(face, 12, 0.85), direction)


def roll_upper(face: Face) -> np.ndarray:
    """The upper lip rolls in over the teeth."""
    return face.sealed(_rolled(face, face.upper, (0, -0.26, -0.62)))


def roll_lower(face: Face) -> np.ndarray:
    """The lower lip rolls in over the teeth."""
    return face.sealed(_rolled(face, face.lower, (0, 0.34, -0.46)))


def bite(face: Face) -> np.ndarray:
    """The lower lip comes under the upper teeth (action descriptor 32)."""
    upper = push(face.upper * lip_weights(face) * _near_middle(face, 10, 0.9), (0, 1.6, 0.8))
    return _rolled(face, face.lower, (0, 0.24, -0.52)) + upper


def shrug_upper(face: Face) -> np.ndarray:
    """The upper lip goes up and forward, the lower lip after it."""
    lifted = 0.46 * face.at("border.0")[1] - 0.46 * face.at("seam.0")[1]
    return face.sealed(push(lifted * lip_weights(face) * (face.upper + 0.6 * face.lower), (0, 1.0, 0.56)))


def shrug_lower(face: Face) -> np.ndarray:
    """The chin pushes the lower lip up and forward, and the upper lip before it."""
    middle = 0.5 + 0.5 * smoothstep(26, 10, face.across)
    lip = lip_weights(face) * (face.lower + 0.6 * face.upper) * middle
    rise = 0.32 * (face.at("fold.8")[1] - face.at("M68")[1])
    return face.sealed(push(rise * lip, (0, 1.0, 0.55)) + chin_raise(face))


def chin_raise(face: Face) -> np.ndarray:
    """Mentalis draws the skin of the chin up and bunches it; the lip hardly follows."""
    return face.sealed(contract(face, {"mentalis": 0.3}))


def tongue_passes(face: Face) -> np.ndarray:
    """The lips part in the middle for the tongue."""
    middle = lip_weights(face) * smoothstep(24, 8, face.across)
    return push(middle * face.upper, (0, 1.5, 0.8)) + push(middle * face.lower, (0, -4.0, 1.0))
