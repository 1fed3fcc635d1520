"""The shapes of brows, nose, cheeks and neck. Each returns a displacement (H, 3) of the left half."""

from __future__ import annotations

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.face import Face, push
from blendcap.synthetic.mannequin.lids import lids
from blendcap.synthetic.mannequin.muscles import contract, lip_weights


def brow_inner_up(face: Face) -> np.ndarray:
    """The inner ends of the brows rise."""
    return contract(face, {"frontalis_medial": 0.19, "frontalis_middle": 0.055})


def brow_outer_up(face: Face) -> np.ndarray:
    """The outer half of the brow rises."""
    return contract(face, {"frontalis_lateral": 0.17})


def brow_lower(face: Face) -> np.ndarray:
    """Procerus and depressor supercilii draw the brow down."""
    return contract(face, {"depressor_supercilii": 0.24, "procerus": 0.1, "orbicularis_oculi_lateral": 0.12})


def brow_squeeze(face: Face) -> np.ndarray:
    """Corrugator draws the brow to the middle and bunches the skin beside it."""
    return contract(face, {"corrugator": 0.2})


def brow_down(face: Face) -> np.ndarray:
    """The brow is lowered and drawn to the middle."""
    return brow_lower(face) + brow_squeeze(face)


def brow_knit(face: Face) -> np.ndarray:
    """Against each other, frontalis and corrugator lift the inner end of the brow and steepen it."""
    return contract(face, {"frontalis_medial": 0.05, "corrugator": 0.05, "orbicularis_oculi_lateral": 0.07})


def nose_wrinkle(face: Face) -> np.ndarray:
    """The side of the nose wrinkles; the lip keeps still."""
    return contract(face, {"nasalis_transverse": 0.1, "levator_alaeque_nasi": 0.035, "procerus": 0.06})


def nose_sneer(face: Face) -> np.ndarray:
    """The wing of the nose and the lip below it are raised, side and root of the nose wrinkle, the brow sinks a little.

    Action unit 9 lowers the inner brow, too (Ekman, Friesen and Hager, Facial Action Coding System, 2002).
    """
    lip = contract(face, {"levator_labii_medial": 0.045, "levator_alaeque_nasi": 0.1, "nasalis_transverse": 0.1})
    root = contract(face, {"procerus": 0.13, "depressor_supercilii": 0.1})
    # The tip keeps still: a marker on it is one of those that the head's motion is told by.
    bridge = push(face.weights({"N2": 1, "N3": 0.6, "K1": 0.4}), (0, 1.1, 0.2))
    return face.sealed(lip + root + bridge + push(face.weights({"fold.3": 1, "K2": 0.6}), (0.2, 1.4, -0.9)))


def nostril_dilate(face: Face) -> np.ndarray:
    """The wings of the nose flare (action unit 38)."""
    return contract(face, {"nasalis_alar": 0.13})


def nostril_compress(face: Face) -> np.ndarray:
    """The wings of the nose draw in and the tip sinks a little (action unit 39)."""
    return contract(face, {"compressor_naris": 0.1, "depressor_septi": 0.03})


def cheek_squint(face: Face) -> np.ndarray:
    """The cheek rises against the lower lid."""
    return face.sealed(contract(face, {"orbicularis_oculi_cheek": 0.27, "orbicularis_oculi_lower": 0.3}))


def _cheek(face: Face, spread) -> np.ndarray:
    inside = np.isin(face.ring, ("inner", "lining", "bag", "seam"))
    return face.near("Q8 Q9 R9 fold.4", spread) * ~inside * ~face.on_globe


def cheek_puff(face: Face) -> np.ndarray:
    """Air fills the cheeks; the lips hold."""
    lips = lip_weights(face)
    size = 0.2 * float(np.linalg.norm(face.at("R9") - face.at("fold.4")))
    cheek = _cheek(face, (22, 24, 29)) * (1 - 0.6 * face.mouth)
    blown = 1.35 * size * cheek[:, None] * (0.65 * face.normals + [0.45, 0, 0.2])
    return face.sealed(blown + push(0.6 * lips, (0, 0, 2.0)) + push(-0.06 * lips * face.points[:, 0], (1, 0, 0)))


def cheek_suck(face: Face) -> np.ndarray:
    """The cheeks are sucked in between the teeth (action descriptor 35)."""
    lips = lip_weights(face)
    size = 0.2 * float(np.linalg.norm(face.at("R9") - face.at("fold.4")))
    drawn = -1.3 * size * _cheek(face, (13, 15, 22))[:, None] * face.normals
    return face.sealed(drawn * ~face.mouth[:, None] + push(-0.1 * lips * face.points[:, 0], (1, 0, 0)))


def lid_tighten(face: Face) -> np.ndarray:
    """The lids tighten without the cheek (action unit 7)."""
    return lids(face, 0.28, 0.6, 0.6, 0.5)


def squint(face: Face) -> np.ndarray:
    """The ring muscle narrows the eye: mostly the lower lid rises."""
    return lids(face, 0.22, 0.95, 0.8, 0.42) + contract(face, {"orbicularis_oculi_ring": 0.2})


def eye_squeeze(face: Face) -> np.ndarray:
    """The eye is shut tight: lids, cheek and brow close in on it (action units 6, 7 and 43)."""
    around = {"orbicularis_oculi_cheek": 0.3, "orbicularis_oculi_ring": 0.25, "depressor_supercilii": 0.16,
              "orbicularis_oculi_lateral": 0.16}  # fmt: skip
    return face.sealed(lids(face, 1.0, 1.0, 1.0, 0.42) + contract(face, around))


def neck_tighten(face: Face) -> np.ndarray:
    """Platysma spans the neck and draws the skin of the jaw down (action unit 21)."""
    return contract(face, {"platysma": 0.14, "platysma_neck": 0.12})


def neck_swallow(face: Face) -> np.ndarray:
    """The larynx rises under the skin of the throat (action unit 80)."""
    throat = face.near("neck1.0 neck2.0", (11, 16, 14)) * smoothstep(-100, -120, face.points[:, 1])
    return push(throat, (0, 4.0, 2.6))


def jaw_clench(face: Face) -> np.ndarray:
    """Masseter bulges at the angle of the jaw (action descriptor 31)."""
    return contract(face, {"masseter": 0.012})
