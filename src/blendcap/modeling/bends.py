"""What a person's shapes do differently, told by points of the skin that were seen in many frames.

The kin of `blendcap.modeling.fields`, which learns from a few whole expressions under known weights: here are many
frames, but of each only some hundred points, some of them across a line of sight alone. A shape's motion changes in
any direction, by a part of its length that is smooth over the face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

SCALES = (0.05, 0.1, 0.2)  # standard deviations of a change, as a part of the motion's length, that are tried
TOLERANCE = 1e-5  # relative residual of the linear solve
MOST_STEPS = 1000


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Points of the skin of a rig with N shapes.

    Parameters
    ----------
    deltas : (P, N, 3) float64
        What each shape does to each, mm at weight 1.
    waves : (P, K) float64
        Smooth functions of place, from `blendcap.modeling.fields.smooth_functions`.
    axes : (P, 3, 3) float64
        Directions along which each tells its place, by how much each counts.
    worth : (P,) float64
        One over the variance of a coordinate of each in one frame, mm⁻², as if frames were independent.
    """

    deltas: np.ndarray
    waves: np.ndarray
    axes: np.ndarray
    worth: np.ndarray

    def changed(self, bends: np.ndarray) -> np.ndarray:
        """What bends (N, K, 3) add to the deltas: (P, N, 3), mm."""
        return bent(self.deltas, self.waves, bends)


@dataclass(frozen=True, eq=False)
class Moments:
    """All that a stretch of frames tells of the bends: a quadratic, point by point.

    Parameters
    ----------
    weights : (P, N, N) float64
        Sum of w w' over the frames that see the point, times its worth.
    missed : (P, N, 3) float64
        Sum of w times what the point did beyond the rig, along its axes, times its worth.
    energy : float
        What is missed, squared, times the worth: what it costs to change nothing.
    """

    weights: np.ndarray
    missed: np.ndarray
    energy: float

    def __add__(self, other: Moments) -> Moments:
        return Moments(self.weights + other.weights, self.missed + other.missed, self.energy + other.energy)


@dataclass(frozen=True, eq=False)
class Bends:
    """Answer of `fit_bends`.

    Parameters
    ----------
    coefficients : (N, K, 3) float64
        Of each shape along the smooth functions: change in any direction, as a part of the motion's length.
    scale : float
        Standard deviation that bends are believed to have: of those tried, the one that foretells left-out frames best.
    foretold : float
        Part of what left-out frames miss that the bends explain, 0 to 1; below 0 they would do harm.
    residual : float
        Relative residual of the linear solve.
    """

    coefficients: np.ndarray
    scale: float
    foretold: float
    residual: float


def bent(deltas: np.ndarray, waves: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """What bends (N, K, 3) add to shapes (V, N, 3) where the smooth functions are `waves` (V, K): (V, N, 3)."""
    return np.linalg.norm(deltas, axis=2, keepdims=True) * np.tensordot(waves, bends, axes=(1, 1))


def moments(points: SeenPoints, weights: np.ndarray, missed: np.ndarray, seen: np.ndarray) -> Moments:
    """What frames tell.

    Parameters
    ----------
    points : SeenPoints
    weights : (T, N)
    missed : (T, P, 3)
        How far each point was from where the rig under the weights puts it, along its axes, mm; any where unseen.
    seen : (T, P) bool
    """
    counted = seen * points.worth
    missed = np.where(seen[..., None], missed, 0.0)
    told = missed * points.worth[:, None]
    return Moments(
        np.stack([(weights * part[:, None]).T @ weights for part in counted.T]),
        np.einsum("tn,tpc->pnc", weights, told, optimize=True),
        float(np.vdot(missed, told)),
    )


def fit_bends(points: SeenPoints, folds: Sequence[Moments], scales: Sequence[float] = SCALES) -> Bends:
    """The most probable bends, with the scale that foretells each fold best from the others.

    Minimises `sum over frames, points of worth |missed - axes changed(bends) w|² + |bends|² / scale²`.

    Parameters
    ----------
    points : SeenPoints
    folds : sequence of Moments
        Of stretches of frames, two or more.
    scales : sequence of float
    """
    whole = _sum(folds)
    left = {scale: _left_out(points, folds, scale) for scale in scales}
    best = min(left, key=lambda scale: left[scale])
    coefficients, residual = _solved(points, whole, best)
    foretold = 1 - left[best] / whole.energy if whole.energy else 0.0
    return Bends(coefficients, best, foretold, residual)


def _left_out(points: SeenPoints, folds: Sequence[Moments], scale: float) -> float:
    """What folds miss, each with bends learned from the others."""
    cost = 0.0
    for k, fold in enumerate(folds):
        others = _sum([other for j, other in enumerate(folds) if j != k])
        cost += _cost(points, fold, _solved(points, others, scale)[0])
    return cost


def _sum(parts: Sequence[Moments]) -> Moments:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _solved(points: SeenPoints, told: Moments, scale: float) -> tuple[np.ndarray, float]:
    """The bends (N, K, 3) of the normal equations by conjugate gradients, and their relative residual."""
    shape = (points.deltas.shape[1], points.waves.shape[1], 3)
    right = _back(points, told.missed @ points.axes).ravel()
    if not right.any():
        return np.zeros(shape), 0.0

    def apply(flat: np.ndarray) -> np.ndarray:
        return _curved(points, told, flat.reshape(shape)).ravel() + flat / scale**2

    system = LinearOperator((right.size, right.size), matvec=apply, dtype=np.float64)  # pyright: ignore[reportCallIssue]
    answer, _ = cg(system, right, rtol=TOLERANCE, maxiter=MOST_STEPS)
    return answer.reshape(shape), float(np.linalg.norm(apply(answer) - right) / np.linalg.norm(right))


def _curved(points: SeenPoints, told: Moments, bends: np.ndarray) -> np.ndarray:
    """The data's part of the normal matrix, times bends (N, K, 3)."""
    metric = points.axes.transpose(0, 2, 1) @ points.axes
    return _back(points, told.weights @ points.changed(bends) @ metric)


def _back(points: SeenPoints, pull: np.ndarray) -> np.ndarray:
    """The transpose of `changed`: a pull (P, N, 3) on the points' deltas as one on the bends (N, K, 3)."""
    pull = np.linalg.norm(points.deltas, axis=2, keepdims=True) * pull
    return np.tensordot(points.waves, pull, axes=(0, 0)).transpose(1, 0, 2)


def _cost(points: SeenPoints, told: Moments, bends: np.ndarray) -> float:
    """What the frames of `told` miss with these bends, squared, times the worth."""
    pulled = np.vdot(_back(points, told.missed @ points.axes), bends)
    return told.energy - 2 * float(pulled) + float(np.vdot(_curved(points, told, bends), bends))
