"""The shapes of brows, nose and cheeks. Each returns a displacement (H, 3) of the left half."""

from __future__ import annotations

import numpy as np

from blendcap.synthetic.mannequin.face import Face, push


def _skin_near(face: Face, center, spread) -> np.ndarray:
    """A Gaussian on the skin in front, without the rims of the lids."""
    return face.near(center, spread) * ~face.on_globe * (face.points[:, 2] > 0)


def brow_inner_up(face: Face) -> np.ndarray:
    """The inner ends of the brows rise."""
    inner = _skin_near(face, (11, 21, 96), (10, 10, 20))
    return push(inner, (0, 7.0, 0.5)) + push(_skin_near(face, (0, 32, 99), (16, 14, 20)), (0, 1.5, 0.3))


def brow_outer_up(face: Face) -> np.ndarray:
    """The outer half of the brow rises."""
    return push(_skin_near(face, (45, 23, 88), (15, 11, 24)), (0, 6.0, 0))


def brow_down(face: Face) -> np.ndarray:
    """The brow is lowered and drawn to the middle."""
    inner = push(_skin_near(face, (18, 19, 94), (15, 9, 20)), (-2.0, -5.5, 1.0))
    return inner + push(_skin_near(face, (38, 21, 90), (12, 8, 20)), (-0.5, -2.2, 0.5))


def nose_sneer(face: Face) -> np.ndarray:
    """The wing of the nose and the lip below it are raised, the side of the nose wrinkles."""
    lip = face.weights({"bag": 0.3, "inner": 0.9, "seam": 1, "crest": 1, "border": 0.95, "around": 0.55, "fold": 0.25})
    wing = face.near("W2", (8, 10, 10)) * ~(face.lower | (lip > 0.3))
    return face.sealed(
        push(wing, (1.0, 4.2, 0.5))
        + push(face.upper * lip * face.near("border.2", (10, 9, 12)), (0, 3.0, 0.5))
        + push(face.near("orbit.11", (7, 8, 9)) * ~face.on_globe, (-0.6, 2.2, 1.5))
    )


def cheek_squint(face: Face) -> np.ndarray:
    """The cheek rises against the lower lid."""
    lid = face.near("crease.9", (13, 5, 10)) * ~face.on_globe
    return face.sealed(push(face.near((38, -24, 82), (14, 9, 14)), (0, 4.2, 2.0)) + push(lid, (0, 1.8, 0.6)))


def cheek_puff(face: Face) -> np.ndarray:
    """Air fills the cheeks; the lips hold."""
    outside = ~np.isin(face.ring, ("inner", "bag"))
    lips = face.weights({"seam": 1, "crest": 1, "border": 0.95, "around": 0.55, "fold": 0.25})
    cheek = face.near((43, -61, 74), (20, 18, 26)) * outside
    narrowed = push(-0.06 * lips * face.points[:, 0], (1, 0, 0))
    return face.sealed(push(cheek, (11.0, 0, 8.0)) + push(0.6 * lips, (0, 0, 2.0)) + narrowed)
