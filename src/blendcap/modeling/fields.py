"""Personal fields: what a person's shapes do differently, as smooth fields on the face, learned from examples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

SAMPLES = 1000  # vertices of the moving face that are looked at, evenly spread
WAVES = 16  # smooth functions that span a field
REACH = 0.35  # of the face's extent: how far a field stays alike
SPREAD = 150  # places whose covariance makes the functions

SHAPE_GAIN = 0.1  # standard deviation of the gain of a whole shape
SIDES_ALIKE = 0.8  # correlation of the gains of a left and a right shape
COMMON_GAIN = 0.05  # of the gain field that all shapes of a person share
OWN_GAIN = 0.05  # and of each shape's own
BEND = 0.15  # of a motion's length: its change in any direction, a field of each shape
ROUGH = 1.0  # mm: what examples have that no field explains, at each sample on its own
SMOOTH = 0.6  # mm: and what is smooth over the face: registration, correctives that the rig lacks


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
    energies : {term: float}
        `fit`, `gains` and `bends`: what the examples and the priors cost, squared standard deviations.
    residual : float
        Largest relative residual of the two linear solves.
    """

    gains: np.ndarray
    bends: np.ndarray
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


def smooth_functions(points: np.ndarray):
    """A function of places (V, 3) with values (V, K): the largest parts of a Gaussian covariance over the points."""
    nodes = points[spread_out(points, SPREAD)]
    reach = REACH * np.ptp(points, axis=0).max()

    def covariance(places: np.ndarray) -> np.ndarray:
        return np.exp(-((places[:, None] - nodes) ** 2).sum(2) / (2 * reach**2))

    values, vectors = np.linalg.eigh(covariance(nodes))
    kept = np.flatnonzero(values > 1e-6 * values[-1])[-WAVES:]
    scaled = vectors[:, kept] / np.sqrt(values[kept])
    return lambda places: covariance(places) @ scaled


def fit_fields(problem: FieldProblem, moved: np.ndarray, weights: np.ndarray) -> Fields:
    """The most probable fields for examples (S, J, 3), mm from rest, under their weights (J, N).

    First the gains, then what is left as bends; each is one linear system.
    """
    missing = moved - np.tensordot(problem.deltas, weights, axes=(1, 1)).transpose(0, 2, 1)
    functions = np.column_stack([np.ones(len(problem.waves)), problem.waves])
    gains, cost, first = _solve(problem, problem.deltas, functions, missing, weights, _gain_precision(problem))
    fields = Fields(gains[..., 0], np.zeros((len(gains), problem.waves.shape[1], 3)), {}, first)
    changed = fields.applied(problem.deltas, problem.waves)
    missing = moved - np.tensordot(changed, weights, axes=(1, 1)).transpose(0, 2, 1)
    length = np.linalg.norm(problem.deltas, axis=2, keepdims=True)
    precision = np.eye(weights.shape[1] * problem.waves.shape[1]) / BEND**2
    bends, more, second = _solve(problem, length, problem.waves, missing, weights, precision)
    fields = Fields(gains[..., 0], bends, {}, max(first, second))
    left = moved - np.tensordot(fields.applied(problem.deltas, problem.waves), weights, axes=(1, 1)).transpose(0, 2, 1)
    fit = float(np.vdot(left, problem.whitened(left)))
    return Fields(gains[..., 0], bends, {"fit": fit, "gains": cost, "bends": more}, max(first, second))


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


def _solve(problem: FieldProblem, motions, functions, missing, weights, precision):
    """Coefficients (N, K, 1 or 3) of `missing = sum over i, k of weight_i function_k motion_i`, most probable.

    Motions (S, N, 3) share one coefficient over the axes; lengths (S, N, 1) have one an axis.
    """
    samples, count, axes = motions.shape
    kinds, poses = functions.shape[1], len(weights)
    columns = (motions.transpose(0, 2, 1)[..., None] * functions[:, None, None, :]).reshape(samples, -1)
    columns = problem.whitened(columns).reshape(samples * axes, -1), columns.reshape(samples * axes, -1)
    system = np.repeat(np.repeat(weights.T @ weights, kinds, axis=0), kinds, axis=1)
    system *= columns[0].T @ columns[1]
    system += precision
    seen = columns[0].T @ missing.transpose(0, 2, 1).reshape(samples * axes, -1)  # axes in rows, or poses by axes
    seen = seen.reshape(count, kinds, 3 // axes, poses)
    right = np.einsum("nkcj,jn->nkc", seen, weights).reshape(count * kinds, -1)
    answer = cho_solve(cho_factor(system, lower=True), right)
    missed = np.abs(system @ answer - right).max() / max(float(np.abs(right).max()), 1e-300)
    cost = float(np.vdot(answer, precision @ answer))
    return answer.reshape(count, kinds, -1), cost, float(missed)
