"""Example-based facial rigging in gradient space (Eq. 27 to 29; Li, Weise and Pauly 2010)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from blendcap.modeling.gradients import gradient_operator
from blendcap.numerics.boxls import solve_box
from blendcap.numerics.leastsq import Factor, factorize

ROUNDS = 5
BETA = (0.5, 0.1)  # of the regularization, from the first round to the last
GAMMA = (0.1, 0.01)  # of the pull to the given weights, in parts of the mean squared length of a shape
KAPPA, THETA = 0.1, 2.0
GAUGE = 1e-8  # of the diagonal, towards the shapes as they were: the examples' gradients say nothing of place
CHUNK = 1000  # triangles at a time


@dataclass(frozen=True, eq=False)
class Rigging:
    """Shapes and weights after the rounds.

    Parameters
    ----------
    deltas : (N, V, 3) float64
    weights : (J, N) float64
    energies : {term: (R,) float64}
        What the shapes and weights at the end of each round cost: `fit` (Eq. 27) and `regularization` (Eq. 28, with β),
        mm² of area; `weights` (Eq. 29), mm².
    max_kkt : float
        Largest optimality residual of the weights.
    residual : float
        Largest relative residual of the global solves.
    """

    deltas: np.ndarray
    weights: np.ndarray
    energies: dict[str, np.ndarray]
    max_kkt: float
    residual: float


@dataclass(frozen=True, eq=False)
class Surface:
    """The gradients of a face, factored once.

    Parameters
    ----------
    gradient : (3 F, V) sparse
    areas : (F,) float64
    weighted : (V, 3 F) sparse
        Its transpose times the areas.
    gauge : (V,) float64
        How firmly each vertex is held to where the prior puts it.
    factor : Factor
    """

    gradient: Any
    areas: np.ndarray
    weighted: Any
    gauge: np.ndarray
    factor: Factor


def make_surface(rest: np.ndarray, faces: np.ndarray) -> Surface:
    """Factor the surface of a neutral: vertices (V, 3), triangles (F, 3)."""
    gradient, areas = gradient_operator(rest, faces)
    weighted = (gradient.T @ sparse.diags(np.repeat(areas, 3))).tocsr()
    stiffness = sparse.csc_matrix(weighted @ gradient)
    gauge = GAUGE * np.maximum(stiffness.diagonal(), GAUGE)
    return Surface(gradient, areas, weighted, gauge, factorize(stiffness + sparse.diags(gauge)))


def rig_from_examples(surface: Surface, deltas, moved, weights, bounds) -> Rigging:
    """Alternate between shapes (a solve a triangle, then one for the surface) and box-constrained weights.

    Parameters
    ----------
    surface : Surface
    deltas : (N, V, 3) float64
        The prior shapes.
    moved : (J, V, 3) float64
        The examples less the rest, mm.
    weights : (J, N) float64
        The weights given for them.
    bounds : (N, 2) float64
    """
    prior, given = deltas, weights
    costs: list[tuple[float, float, float]] = []
    max_kkt, residual = 0.0, 0.0
    for beta, gamma in zip(np.linspace(*BETA, ROUNDS), np.linspace(*GAMMA, ROUNDS), strict=True):
        deltas = shapes_from_examples(surface, prior, moved, weights, beta)
        residual = max(residual, surface.factor.residual)
        weights, kkt, cost = _weights(deltas, moved, given, bounds, gamma)
        max_kkt = max(max_kkt, kkt)
        costs.append((*example_costs(surface, prior, deltas, moved, weights, beta), cost))
    names = ("fit", "regularization", "weights")
    return Rigging(deltas, weights, dict(zip(names, np.transpose(costs), strict=True)), max_kkt, residual)


def shapes_from_examples(
    surface: Surface, prior: np.ndarray, examples: np.ndarray, weights: np.ndarray, beta: float
) -> np.ndarray:
    """Shapes (N, V, 3) that fit the examples (J, V, 3) under fixed weights: each triangle, then one surface."""
    right = surface.gauge[:, None] * _columns(prior)
    for rows, (old, seen) in _chunks(surface.gradient, prior, examples):
        new = local_shapes(old, seen, weights, beta * own_weights(old))
        stacked = new.reshape(len(new), -1, 3, 3).transpose(0, 2, 1, 3).reshape(len(rows), -1)
        right += surface.weighted[:, rows] @ stacked
    return _fields(surface.factor.solve(right))


def example_costs(
    surface: Surface, prior: np.ndarray, deltas: np.ndarray, examples: np.ndarray, weights: np.ndarray, beta: float
) -> tuple[float, float]:
    """What Eq. 27 and β times Eq. 28 cost at shapes (N, V, 3) and weights (J, N), mm² of area."""
    fit, regular = 0.0, 0.0
    for rows, (old, new, seen) in _chunks(surface.gradient, prior, deltas, examples):
        area = surface.areas[rows[::3] // 3]
        fit += float(area @ ((np.matmul(weights, new) - seen) ** 2).sum((1, 2)))
        regular += beta * float(area @ (own_weights(old) * ((new - old) ** 2).sum(2)).sum(1))
    return fit, regular


def own_weights(gradients: np.ndarray) -> np.ndarray:
    """w of Eq. 28 for each triangle and shape, (F, N): shapes that deform a triangle may deviate there."""
    size = np.linalg.norm(gradients, axis=2)
    return ((1 + size) / (KAPPA + size)) ** THETA


def local_shapes(prior: np.ndarray, examples: np.ndarray, weights: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Shapes (F, N, 9) that minimise Eq. 27 plus β times Eq. 28 on each triangle.

    The system has N unknowns a number, but only J examples: Woodbury's identity leaves J by J.

    Parameters
    ----------
    prior : (F, N, 9) float64
        Gradients of the prior shapes.
    examples : (F, J, 9) float64
        Gradients of the examples less the rest's.
    weights : (J, N) float64
    stiffness : (F, N) float64
        β w.
    """
    loose = weights / stiffness[:, None, :]
    inner = loose @ weights.T
    inner[:, np.arange(len(weights)), np.arange(len(weights))] += 1
    return prior + loose.transpose(0, 2, 1) @ np.linalg.solve(inner, examples - weights @ prior)


def _chunks(gradient, *fields: np.ndarray) -> Iterator[tuple[np.ndarray, list[np.ndarray]]]:
    """Rows of the operator, and there the gradients (f, n, 9) of each of the fields (n, V, 3)."""
    columns = [_columns(field) for field in fields]
    for start in range(0, gradient.shape[0], 3 * CHUNK):
        rows = np.arange(start, min(start + 3 * CHUNK, gradient.shape[0]))
        part, count = gradient[rows], len(rows) // 3
        yield rows, [(part @ c).reshape(count, 3, -1, 3).transpose(0, 2, 1, 3).reshape(count, -1, 9) for c in columns]


def _weights(deltas, examples, given, bounds, gamma: float) -> tuple[np.ndarray, float, float]:
    """Eq. 29: the weights, their largest optimality residual, and what they cost."""
    flat, seen = deltas.reshape(len(deltas), -1), examples.reshape(len(examples), -1)
    gram = flat @ flat.T
    pull = gamma * np.trace(gram) / len(gram)
    weights, certificate = solve_box(gram + pull * np.eye(len(gram)), -(seen @ flat.T) - pull * given,
                                     lower=bounds[:, 0], upper=bounds[:, 1])  # fmt: skip
    cost = float(((weights @ flat - seen) ** 2).sum() + pull * ((weights - given) ** 2).sum())
    return weights, certificate.max_kkt, cost


def _columns(fields: np.ndarray) -> np.ndarray:
    return fields.transpose(1, 0, 2).reshape(fields.shape[1], -1)


def _fields(columns: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(columns.reshape(len(columns), -1, 3).transpose(1, 0, 2))
