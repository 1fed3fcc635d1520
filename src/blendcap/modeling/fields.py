"""Personal fields: what a person's shapes do differently, as smooth fields on the face, learned from examples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

SAMPLES = 1000  # vertices of the moving face that are looked at, evenly spread
WAVES = 16  # smooth functions that span a field
REACH = 0.35  # of the face's extent: how far a field stays alike
SPREAD = 150  # places whose covariance makes the functions

SHAPE_GAIN = 0.1  # standard deviation of the gain of a whole shape
SIDES_ALIKE = 0.8  # correlation of the gains of a left and a right shape
COMMON_GAIN = 0.05  # of the gain field that all shapes of a person share
OWN_GAIN = 0.05  # and of each shape's own
BEND = 0.075  # of a motion's length: its change in any direction, a field of each shape
SCALES = (0.125, 0.25, 0.5, 1.0)  # of these deviations: from someone very like the rig to someone quite unlike it
ROUGH = 1.0  # mm: what examples have that no field explains, at each sample on its own
SMOOTH = 0.6  # mm: and what is smooth over the face: registration, correctives that the rig lacks
WEIGHT_ERROR = 0.1  # standard deviation of the given weights


@dataclass(frozen=True, eq=False)
class FieldProblem:
    """Shapes and smooth functions at the samples, with the noise taken into account.

    Parameters
    ----------
    deltas : (S, N, 3) float64
        Shapes at the samples, mm.
    waves : (S, K) float64
        The smooth functions there; their covariance is `exp(-d² / 2 reach²)`.
    mirror : (N,) int64
    """

    deltas: np.ndarray
    waves: np.ndarray
    mirror: np.ndarray

    def whitened(self, rows: np.ndarray) -> np.ndarray:
        """The inverse covariance of the noise, times rows (S, ...)."""
        flat = rows.reshape(len(rows), -1)
        inner = self.waves.T @ self.waves + np.eye(self.waves.shape[1]) * (ROUGH / SMOOTH) ** 2
        smooth = self.waves @ np.linalg.solve(inner, self.waves.T @ flat)
        return ((flat - smooth) / ROUGH**2).reshape(rows.shape)

    def gram(self, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        """Inner products (N, M) of motions (S, N, 3) and (S, M, 3) under the noise."""
        return np.tensordot(one, self.whitened(two), axes=([0, 2], [0, 2]))


@dataclass(frozen=True, eq=False)
class Fields:
    """Answer of `fit_fields`.

    Parameters
    ----------
    gains : (N, 1 + K) float64
        Of each shape: its gain less 1 as a whole, and along the smooth functions.
    bends : (N, K, 3) float64
        Of each shape: change in any direction along the smooth functions, as a part of the motion's length.
    scale : float
        How unlike the rig the person is: of the scales, the one that makes the examples most probable.
    energies : {term: float}
        `fit`, `gains` and `bends`: what the examples and the priors cost, squared standard deviations.
    residual : float
        Largest relative residual of the two linear solves.
    """

    gains: np.ndarray
    bends: np.ndarray
    scale: float
    energies: dict[str, float]
    residual: float

    def applied(self, deltas: np.ndarray, waves: np.ndarray) -> np.ndarray:
        """Shapes (V, N, 3) changed, where the smooth functions are `waves` (V, K)."""
        gain = np.column_stack([np.ones(len(waves)), waves]) @ self.gains.T
        length = np.linalg.norm(deltas, axis=2, keepdims=True)
        return deltas * (1 + gain[..., None]) + length * np.tensordot(waves, self.bends, axes=(1, 1))


def spread_out(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of up to `count` points, each the farthest from those before it."""
    chosen = np.zeros(min(count, len(points)), dtype=np.int64)
    distance = ((points - points[0]) ** 2).sum(1)
    for k in range(1, len(chosen)):
        chosen[k] = distance.argmax()
        np.minimum(distance, ((points - points[chosen[k]]) ** 2).sum(1), out=distance)
    return chosen


def smooth_functions(points: np.ndarray, reach: float = REACH, count: int = WAVES):
    """A function of places (V, 3) with values (V, K): the largest parts of a Gaussian covariance over the points.

    There are `count` of them, and the covariance falls off within `reach`, a part of the points' extent.
    """
    nodes = points[spread_out(points, SPREAD)]
    reach = reach * np.ptp(points, axis=0).max()

    def covariance(places: np.ndarray) -> np.ndarray:
        return np.exp(-((places[:, None] - nodes) ** 2).sum(2) / (2 * reach**2))

    values, vectors = np.linalg.eigh(covariance(nodes))
    kept = np.flatnonzero(values > 1e-6 * values[-1])[-count:]
    scaled = vectors[:, kept] / np.sqrt(values[kept])
    return lambda places: covariance(places) @ scaled


def fit_fields(
    problem: FieldProblem, moved: np.ndarray, weights: np.ndarray, error: float = 0.0, scales: Sequence[float] = SCALES
) -> Fields:
    """The most probable fields for examples (S, J, 3), mm from rest, under their weights (J, N).

    First the gains, then what is left as bends; each is one linear system. Where the weights have an `error` (standard
    deviation), gains are found for any weights near the given ones: a jaw that was opened a little more than asked for
    is no gain of the shapes that were shown together with it. The deviation of the gains is scaled as the examples make
    most probable, that of the bends with its square: who has the rig's gains has its directions all the more.
    """
    missing = _missing(moved, problem.deltas, weights)
    functions = np.column_stack([np.ones(len(problem.waves)), problem.waves])
    system = _System(problem, problem.deltas, functions, missing, weights, _gain_precision(problem))
    corrected = system.free_weights(weights, error) if error else None
    scale = max(scales, key=system.evidence)
    gains, cost, first = system.solve(scale)
    weights = weights if corrected is None else weights + corrected(gains)
    fields = Fields(gains[..., 0], np.zeros((len(gains), problem.waves.shape[1], 3)), scale, {}, first)
    missing = _missing(moved, fields.applied(problem.deltas, problem.waves), weights)
    length = np.linalg.norm(problem.deltas, axis=2, keepdims=True)
    precision = np.eye(weights.shape[1] * problem.waves.shape[1]) / BEND**2
    bends, more, second = _System(problem, length, problem.waves, missing, weights, precision).solve(scale**2)
    fields = replace(fields, bends=bends, residual=max(first, second))
    left = _missing(moved, fields.applied(problem.deltas, problem.waves), weights)
    fit = float(np.vdot(left, problem.whitened(left)))
    return replace(fields, energies={"fit": fit, "gains": cost, "bends": more})


def _missing(moved: np.ndarray, shapes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """What shapes (S, N, 3) under weights (J, N) leave of the examples (S, J, 3)."""
    return moved - np.tensordot(shapes, weights, axes=(1, 1)).transpose(0, 2, 1)


def _gain_precision(problem: FieldProblem) -> np.ndarray:
    """Inverse prior covariance of the gains, ordered by shape and then by function."""
    count, functions = len(problem.mirror), problem.waves.shape[1] + 1
    one = np.eye(count)
    partner = np.maximum(one, one[problem.mirror])
    whole = np.linalg.inv(SHAPE_GAIN**2 * ((1 - SIDES_ALIKE) * one + SIDES_ALIKE * partner))
    field = np.linalg.inv(COMMON_GAIN**2 + OWN_GAIN**2 * one)
    precision = np.zeros((count, functions, count, functions))
    precision[:, 0, :, 0] = whole
    for k in range(1, functions):
        precision[:, k, :, k] = field
    return precision.reshape(count * functions, -1)


class _System:
    """Coefficients (N, K, 1 or 3) of `missing = sum over i, k of weight_i function_k motion_i`, most probable.

    Motions (S, N, 3) share one coefficient over the axes; lengths (S, N, 1) have one an axis.
    """

    def __init__(self, problem: FieldProblem, motions, functions, missing, weights, precision):
        samples, self.count, axes = motions.shape
        self.kinds, self.precision = functions.shape[1], precision
        self.plain = motions.transpose(0, 2, 1).reshape(samples * axes, self.count)
        columns = (motions.transpose(0, 2, 1)[..., None] * functions[:, None, None, :]).reshape(samples, -1)
        self.columns = problem.whitened(columns).reshape(samples * axes, -1)
        self.white = problem.whitened(self.plain.reshape(samples, -1)).reshape(self.plain.shape)
        self.missing = missing.transpose(0, 2, 1).reshape(samples * axes, -1)  # axes in rows, or poses by axes
        self.matrix = np.repeat(np.repeat(weights.T @ weights, self.kinds, axis=0), self.kinds, axis=1)
        self.matrix *= self.columns.T @ columns.reshape(samples * axes, -1)
        seen = (self.columns.T @ self.missing).reshape(self.count, self.kinds, 3 // axes, len(weights))
        self.right = np.einsum("nkcj,jn->nkc", seen, weights).reshape(self.count * self.kinds, -1)

    def free_weights(self, weights: np.ndarray, error: float):
        """Let the weights (J, N) that are not 0 be off by `error`; what they are off by (J, N) is a function of gains.

        They are unknowns of one example only and are eliminated, example by example (Schur complement).
        """
        across, own, seen = self.columns.T @ self.plain, self.plain.T @ self.white, self.white.T @ self.missing
        parts = []
        for j, row in enumerate(weights):
            used = np.flatnonzero(row > 0)
            inverse = np.linalg.inv(np.eye(len(used)) / error**2 + own[np.ix_(used, used)])
            coupled = np.repeat(row, self.kinds)[:, None] * across[:, used]
            self.matrix -= coupled @ inverse @ coupled.T
            self.right -= (coupled @ (inverse @ seen[used, j]))[:, None]
            parts.append((j, used, inverse, coupled))

        def off(gains: np.ndarray) -> np.ndarray:
            result = np.zeros_like(weights)
            for j, used, inverse, coupled in parts:
                result[j, used] = inverse @ (seen[used, j] - coupled.T @ gains.ravel())
            return result

        return off

    def evidence(self, scale: float) -> float:
        """The logarithm of the examples' probability with the prior's deviations scaled, but for a constant."""
        lower = np.linalg.cholesky(self.matrix + self.precision / scale**2)
        explained = solve_triangular(lower, self.right, lower=True)
        volume = np.log(scale * np.diag(lower)).sum()
        return 0.5 * float(np.vdot(explained, explained)) - self.right.shape[1] * float(volume)

    def solve(self, scale: float) -> tuple[np.ndarray, float, float]:
        """The coefficients, what their prior costs, and the relative residual."""
        precision = self.precision / scale**2
        matrix = self.matrix + precision
        answer = cho_solve(cho_factor(matrix, lower=True), self.right)
        missed = np.abs(matrix @ answer - self.right).max() / max(float(np.abs(self.right).max()), 1e-300)
        cost = float(np.vdot(answer, precision @ answer))
        return answer.reshape(self.count, self.kinds, -1), cost, float(missed)
