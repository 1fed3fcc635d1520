"""Motion of the helmet against the head, as shapes that the solve can use beside the rig's own.

Both ways linearize a small rigid motion of the markers about their centroid. Weights of the columns turn back into
millimeters and radians with `paper_motion` and `rigid_motion`.
"""

from __future__ import annotations

import numpy as np

_TRANSLATION = 10.0  # mm, Eq. 34


def paper_columns(positions: np.ndarray, center: np.ndarray | None = None) -> np.ndarray:
    """The thesis' twelve dummy shapes, each with a weight of 0 to 1 (section 4.1.6, Eqs. 34-37).

    Order: +x, -x, +y, -y, +z, -z by 10 mm, then the same for rotations. A rotation shape is what 90 degrees add to the
    neutral, linearized: `axis × position`, which makes its weight the sine of the angle, as the thesis has it. (The
    straight line to the rotated shape, Eq. 36 by the letter, would also shrink the face toward the axis; the matrix of
    Eq. 37, by the letter, would also stretch it along the axis.)

    Parameters
    ----------
    positions : (M, 3) float64
        Neutral markers, mm.
    center : (3,), optional
        What is turned about, mm; `pivot` if not given.

    Returns
    -------
    (12, M, 3) float64
        Displacements at weight 1, mm.
    """
    signed = rigid_columns(positions, translation=_TRANSLATION, rotation=1.0, center=center)
    return np.stack([signed, -signed], axis=1).reshape(12, -1, 3)


def rigid_columns(
    positions: np.ndarray, translation: float = _TRANSLATION, rotation: float = 0.1, center: np.ndarray | None = None
) -> np.ndarray:
    """Six signed unknowns, each with a weight of -1 to 1: translations along and rotations about x, y and z.

    Half as many as the paper's, with no pair that can cancel itself out.

    Parameters
    ----------
    positions : (M, 3) float64
        Neutral markers, mm.
    translation : float
        What weight 1 moves by, mm.
    rotation : float
        What weight 1 turns by, rad.
    center : (3,), optional
        What is turned about, mm; `pivot` if not given.

    Returns
    -------
    (6, M, 3) float64
        Displacements at weight 1, mm.
    """
    arms = np.asarray(positions) - (pivot(positions) if center is None else center)
    axes = np.eye(3)
    moves = np.broadcast_to(translation * axes[:, None], (3, *arms.shape))
    turns = rotation * np.cross(axes[:, None], arms[None])
    return np.concatenate([moves, turns])


def pivot(positions: np.ndarray) -> np.ndarray:
    """The point (3,) that the columns turn about: the centroid of the neutral markers, mm."""
    return np.nanmean(np.asarray(positions), axis=0)


def paper_motion(weights: np.ndarray) -> np.ndarray:
    """Motion (T, 6) of the pivot, mm, and rotation vector, rad, from the weights (T, 12) of `paper_columns`."""
    weights = np.asarray(weights)
    return rigid_motion(weights[:, 0::2] - weights[:, 1::2], translation=_TRANSLATION, rotation=1.0)


def rigid_motion(weights: np.ndarray, translation: float = _TRANSLATION, rotation: float = 0.1) -> np.ndarray:
    """Motion (T, 6) of the pivot, mm, and rotation vector, rad, from the weights (T, 6) of `rigid_columns`.

    The linear part of a rotation by θ about n is `sin θ n × p` (Rodrigues), so the rotation's length is the arcsine.
    """
    weights = np.asarray(weights)
    tangent = rotation * weights[:, 3:]
    sine = np.linalg.norm(tangent, axis=1, keepdims=True)
    stretch = np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-300)
    return np.hstack([translation * weights[:, :3], np.where(sine > 0, stretch, 1.0) * tangent])


def remove_motion(positions: np.ndarray, motion: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Markers (T, M, 3) with the helmet's motion (T, 6) about `center` (3,) undone, with the exact rotation, mm."""
    from scipy.spatial.transform import Rotation

    motion = np.asarray(motion)
    turns = Rotation.from_rotvec(motion[:, 3:]).as_matrix()
    return (np.asarray(positions) - center - motion[:, None, :3]) @ turns + center
