"""The shapes of the mouth. Each returns a displacement (H, 3) of the left half; the caller mirrors and splits it."""

from __future__ import annotations

import numpy as np

from blendcap.synthetic.mannequin.face import Face, push
from blendcap.synthetic.mannequin.fields import smoothstep

_LIPS = {"bag": 0.3, "inner": 0.9, "seam": 1, "crest": 1, "border": 0.95, "around": 0.55, "fold": 0.25}


def _lips(face: Face) -> np.ndarray:
    return face.weights(_LIPS)


def _corner(face: Face) -> np.ndarray:
    """What follows the corner of the mouth: its surroundings, and the lips increasingly towards it."""
    x, y, z = face.at("seam.4")
    around = face.near((x + 2, y + 1, z), (13, 12, 18))
    along = 0.55 * _lips(face) * smoothstep(2, 22, face.points[:, 0]) ** 1.5
    return np.maximum(around, along) * ~face.on_globe


def smile(face: Face) -> np.ndarray:
    """The corner goes up, out and back; the cheek rises before it and the nasolabial fold deepens between them."""
    x = face.points[:, 0]
    lip = _lips(face) * smoothstep(2, 22, x) ** 1.5 * smoothstep(4, 16, x)
    cheek = face.near((40, -32, 84), (15, 13, 18)) * ~(face.mouth | face.on_globe)
    return face.sealed(
        push(_corner(face), (7.5, 7.8, -4.5))
        + push(0.35 * lip, (0, 1.2, -0.6))
        + push(cheek, (2.0, 4.2, 2.6))
        + push(face.near("Q10", (11, 10, 14)), (1.0, 1.4, 1.2))
        + push(face.weights({"Q10": 1, "P10": 0.5}), (-0.5, 1.5, 2.2))
        + push(face.weights({"fold.3": 0.9, "fold.4": 1, "fold.5": 0.4}), (0.4, 1.2, -1.8))
        + push(face.near("crease.9", (12, 4, 9)) * ~face.on_globe, (0, 1.0, 0.4))
    )


def frown(face: Face) -> np.ndarray:
    """The corner goes down."""
    below = face.near("fold.5", (9, 9, 12))
    return face.sealed(push(_corner(face), (1.5, -7.0, -1.0)) + push(below, (0, -2.5, 1.0)))


def dimple(face: Face) -> np.ndarray:
    """The corner is drawn back into the cheek."""
    return face.sealed(push(_corner(face), (4.5, 0.8, -4.5)))


def stretch(face: Face) -> np.ndarray:
    """The corner goes out and a little down, with the skin of the jaw."""
    jaw = face.near((40, -85, 70), (16, 14, 22))
    return face.sealed(push(_corner(face), (7.5, -3.0, -4.0)) + push(jaw, (2.0, -2.0, 0)))


def press(face: Face) -> np.ndarray:
    """The lips are pressed together and show less red."""
    weight = _lips(face) * (face.upper | face.lower)
    closer = np.clip(0.22 * (face.at("seam.0")[1] - face.points[:, 1]), -1.5, 1.5)
    inward = face.weights({"crest": -2.2, "border": -1.2, "seam": -0.6})
    return face.sealed(weight[:, None] * np.stack([0 * closer, closer, inward], 1))


def lower_down(face: Face) -> np.ndarray:
    """The lower lip is drawn down from the teeth."""
    weight = face.lower * _lips(face) * (0.35 + 0.65 * smoothstep(25, 12, face.points[:, 0]))
    return push(weight, (1.0, -6.5, 0.6))


def upper_up(face: Face) -> np.ndarray:
    """The upper lip is raised, the wing of the nose with it."""
    weight = face.upper * _lips(face) * (0.35 + 0.65 * smoothstep(25, 14, face.points[:, 0]))
    return push(weight, (0.4, 5.5, 0.8)) + push(face.near("W2", (8, 9, 9)) * ~face.mouth, (0, 1.6, 0))


def _sphincter(face: Face, narrower: float, apart: float, forward: float, curl: float) -> np.ndarray:
    """The ring muscle of the mouth draws it together and forward."""
    x = face.points[:, 0]
    ring = face.weights({"bag": 0.3, "inner": 1, "seam": 1, "crest": 1, "border": 0.95, "around": 0.75, "fold": 0.3})
    ring = np.maximum(ring, 0.25 * face.near((34, -66, 84), (10, 14, 14)) * ~face.mouth)
    side = face.upper * 1.0 - face.lower * 1.0
    rolled = curl * face.weights({"crest": 1, "border": 0.35, "seam": 0.4})
    out = forward * ring * (0.55 + 0.45 * smoothstep(28, 6, x)) + rolled
    return np.stack([-narrower * x * ring, apart * ring * side * smoothstep(30, 10, x), out], 1)


def funnel(face: Face) -> np.ndarray:
    """The lips form a funnel, as in "ooh" said through a tube: open and forward."""
    return _sphincter(face, 0.40, 4.6, 5.5, 1.6)


def pucker(face: Face) -> np.ndarray:
    """The lips close to a kiss."""
    closer = face.weights({"crest": 0.8, "border": 0.8}) * (face.lower * 1.0 - face.upper * 1.0)
    return _sphincter(face, 0.50, 0, 6.5, 1.0) + push(closer, (0, 1, 0))


def mouth_aside(face: Face) -> np.ndarray:
    """The mouth goes to the subject's left, round the teeth; of the whole cage (N, 3), as it has no mirror symmetry."""
    weight = np.maximum(_lips(face), 0.45 * face.near((30, -66, 86), (16, 18, 18)))
    weight = face.cage.mirrored(weight, vectors=False)
    leading = smoothstep(5, 25, face.cage.mirrored(face.points)[:, 0])
    return weight[:, None] * np.stack([np.full_like(leading, 6.5), leading, -2.2 * leading], 1)


def _rolled(face: Face, side: np.ndarray, direction) -> np.ndarray:
    ring = face.weights({"inner": 0.6, "seam": 1, "crest": 1, "border": 0.75, "around": 0.3})
    return push(ring * side * (0.35 + 0.65 * smoothstep(27, 14, face.points[:, 0])), direction)


def roll_upper(face: Face) -> np.ndarray:
    """The upper lip rolls in over the teeth."""
    return face.sealed(_rolled(face, face.upper, (0, -1.8, -4.2)))


def roll_lower(face: Face) -> np.ndarray:
    """The lower lip rolls in over the teeth."""
    return face.sealed(_rolled(face, face.lower, (0, 2.0, -4.4)))


def shrug_upper(face: Face) -> np.ndarray:
    """The upper lip goes up and forward, the lower lip after it."""
    return face.sealed(push(_lips(face) * (face.upper + 0.6 * face.lower), (0, 3.2, 1.8)))


def shrug_lower(face: Face) -> np.ndarray:
    """The chin pushes the lower lip up and forward, and the upper lip before it."""
    lip = _lips(face) * (face.lower + 0.6 * face.upper) * (0.5 + 0.5 * smoothstep(26, 10, face.points[:, 0]))
    chin = np.maximum(face.near("M68", (22, 12, 20)) * ~face.mouth, 0.9 * (face.ring == "fold") * face.lower)
    return face.sealed(push(lip, (0, 4.0, 2.2)) + push(chin, (0, 4.0, 1.0)))


def tongue_passes(face: Face) -> np.ndarray:
    """The lips part in the middle for the tongue."""
    middle = _lips(face) * smoothstep(24, 8, face.points[:, 0])
    return push(middle * face.upper, (0, 1.5, 0.8)) + push(middle * face.lower, (0, -4.0, 1.0))
