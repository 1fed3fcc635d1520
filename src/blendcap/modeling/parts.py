"""The pieces of a head: the skin, what hangs on it, and what moves as one solid body (eyeballs, teeth)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from blendcap.data import InputError
from blendcap.numerics.similarity import align

RIGID = 0.01  # of a piece's motion: what it may bend and still count as solid
SAME = 0.02  # of their motion: how far two pieces of one body may disagree


@dataclass(frozen=True, eq=False)
class Motion:
    """How a solid body moves in one shape.

    Parameters
    ----------
    shape : int
    vertices : (K,) int64
    rotation : (3, 3) float64
    translation : (3,) float64
        `rotation @ v + translation` is where the rest vertex v goes.
    """

    shape: int
    vertices: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


def pieces(faces: np.ndarray, count: int) -> list[np.ndarray]:
    """Vertices of each connected piece that has faces, the largest first."""
    corners = faces.ravel()
    graph = sparse.csr_matrix((np.ones(faces.size), (corners, np.roll(faces, -1, axis=1).ravel())), (count, count))
    number, label = connected_components(graph, directed=False)
    used = np.zeros(count, dtype=bool)
    used[corners] = True
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.searchsorted(label[order], np.arange(1, number)))
    return sorted((p for p in parts if used[p[0]]), key=len, reverse=True)


def solid_motions(rest: np.ndarray, deltas: np.ndarray, parts: list[np.ndarray]) -> list[Motion]:
    """Where pieces move without bending, shape by shape; pieces that move alike in a shape are one body there."""
    found: list[Motion] = []
    for i, delta in enumerate(deltas):
        bodies: list[Motion] = []
        for part in parts:
            moved = delta[part]
            if len(part) < 3 or not moved.any():
                continue
            motion = _rigid(rest[part], moved)
            if motion is not None:
                _join(bodies, Motion(i, part, *motion), rest, deltas)
        found.extend(bodies)
    return found


def carried(motion: Motion, rest: np.ndarray, new_rest: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Displacements (K, 3) of the body's vertices on another rest: the same turn about its own center.

    `weights` (V,), the area of each vertex, make the center.
    """
    at, share = motion.vertices, weights[motion.vertices] / weights[motion.vertices].sum()
    center, new_center = share @ rest[at], share @ new_rest[at]
    shift = motion.rotation @ center + motion.translation - center
    return (new_rest[at] - new_center) @ (motion.rotation - np.eye(3)).T + shift


def _rigid(rest: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Rotation and translation of points (K, 3) that are displaced by (K, 3), if that is what they do."""
    try:
        rotation, translation, _ = align(rest, rest + moved, scale=False)
    except InputError:  # a sliver: its points lie on a line
        return None
    bent = np.abs(rest @ rotation.T + translation - rest - moved).max()
    return (rotation, translation) if bent <= RIGID * np.abs(moved).max() else None


def _join(bodies: list[Motion], motion: Motion, rest: np.ndarray, deltas: np.ndarray) -> None:
    """Add the motion to the body that moves alike, or as a new one."""
    at = motion.vertices
    for k, body in enumerate(bodies):
        there = rest[at] @ body.rotation.T + body.translation - rest[at]
        if np.abs(there - deltas[motion.shape, at]).max() <= SAME * np.abs(there).max():
            bodies[k] = Motion(body.shape, np.concatenate([body.vertices, at]), body.rotation, body.translation)
            return
    bodies.append(motion)
