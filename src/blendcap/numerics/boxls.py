"""Exact box-constrained least squares for many frames that share one Gram matrix."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike

from blendcap.data.checks import array
from blendcap.data.solution import Certificate
from blendcap.numerics._boxproblem import BoxProblem, accuracy, blocks, box_problem, residuals
from blendcap.numerics._descent import descend
from blendcap.numerics._guess import MANY, guess_states
from blendcap.numerics._pivoting import FREE, LOWER, UPPER, pivot, workspace
from blendcap.numerics._seen import seen_gram, seen_start
from blendcap.numerics._together import settle

FEW = 64  # frames below which the guess costs more than it saves


def solve_box(
    gram: ArrayLike,
    linear: ArrayLike,
    *,
    diagonal: ArrayLike | None = None,
    lower: ArrayLike = 0.0,
    upper: ArrayLike = 1.0,
    start: ArrayLike | None = None,
    rows: ArrayLike | None = None,
    missing: ArrayLike | None = None,
) -> tuple[np.ndarray, Certificate]:
    """Minimise `a'(G_t + diag d_t)a + 2 l_t'a` over `lower <= a <= upper`, exactly, for every frame t.

    Parameters
    ----------
    gram : (N, N)
        The matrix G that all frames share: symmetric, positive semi-definite. Diagonal elements below 1e-12 of the
        largest are raised to it; so are, to 1e-11 of their own diagonal element, the pivots of a singular matrix.
    linear : (T, N)
    diagonal : (T, N), optional
        What each frame adds to the diagonal.
    lower, upper : float or (N,)
        Bounds; infinite ones leave an unknown free.
    start : (T, N), optional
        An answer of a similar problem, from which to start; without it the solver makes its own guess.
    rows : (M, K, N), optional
        The K rows of the least-squares matrix that each of M markers contributes to G.
    missing : (T, M) bool, optional
        Where a marker is missing its rows are taken out: `G_t = gram - sum of rows[m].T @ rows[m]`. (The caller
        leaves its part out of `linear`.)

    Returns
    -------
    weights : (T, N) float64
        NaN in the frames that hold a number that is not finite; the other frames do not notice.
    certificate : Certificate
        The optimality residual of every frame, formed from the weights alone.
    """
    problem = box_problem(gram, linear, diagonal, lower, upper, rows, missing)
    scaled, scale = scaled_problem(problem)
    states = first_states(scaled, scale, start)
    weights = np.full_like(problem.linear, np.nan)
    rounds = np.zeros(len(weights), np.int64)
    todo = problem.usable
    given = states is not None
    states = np.zeros((1, 1), np.int8) if states is None else states
    if given and not problem.missing.shape[1]:
        settle(scaled.arrays(), states, todo, weights, rounds, blocks(len(weights), MANY))
    if todo.any():
        _solve_all(scaled.arrays(), todo, states, given, weights, rounds, blocks(len(weights)))
    weights /= scale
    np.clip(weights, problem.lower, problem.upper, out=weights)
    worst = residuals(problem, weights)
    largest = float(worst.max(initial=0.0))
    mean = float(np.abs(rounds).mean()) if len(rounds) else 0.0
    return weights, Certificate(largest, mean, largest <= accuracy(weights), worst)


def scaled_problem(problem: BoxProblem) -> tuple[BoxProblem, np.ndarray]:
    """The problem in unknowns `a * scale` that give the shared matrix a unit diagonal, and that scale."""
    curvature = problem.curvature
    scale = np.sqrt(curvature)
    gram = problem.gram / np.outer(scale, scale)
    extra = (problem.diagonal - (curvature - np.diag(problem.gram))) / curvature
    np.fill_diagonal(gram, 1.0)
    rows, lower, upper = problem.rows / scale, problem.lower * scale, problem.upper * scale
    return BoxProblem(gram, problem.linear / scale, extra, lower, upper, rows, problem.missing), scale


def first_states(problem: BoxProblem, scale: np.ndarray, start: ArrayLike | None) -> np.ndarray | None:
    """(T, N) int8 states to begin with, or None where few frames are better begun from the one before."""
    frames, m = problem.linear.shape
    if start is not None:
        x = array(start, (frames, m), "start") * scale
        return (x > problem.lower).astype(np.int8) + (x >= problem.upper).astype(np.int8)
    if frames < FEW:
        return None
    calm = problem.without_gaps(problem.usable)
    return guess_states(calm.gram, calm.diagonal, calm.linear, calm.lower, calm.upper, blocks(frames, MANY))


@njit(parallel=True, error_model="numpy", cache=True)
def _solve_all(box, todo, states, given, weights, rounds, count):
    """The frames to do; each begins with its given states, or with those of the frame before."""
    frames = len(weights)
    for b in prange(count):
        _solve_run(box, todo, states, given, weights, rounds, b * frames // count, (b + 1) * frames // count)


@njit(error_model="numpy", cache=True)
def _solve_run(box, todo, states, given, weights, rounds, first, last):
    """The frames from first to last, one after the other."""
    gram, linear, diagonal, lower, upper, rows, missing = box
    m, most = lower.size, 100 + 2 * lower.size
    work, g = workspace(m), np.zeros(gram.shape[1])
    seen, state = seen_start(gram, missing), np.zeros(m, np.int8)
    for t in range(first, last):
        if not todo[t]:
            continue
        x, f, d = weights[t], linear[t], diagonal[t if len(diagonal) > 1 else 0]
        for i in range(m):
            if given:
                state[i] = states[t, i]
            if (state[i] == LOWER and lower[i] == -np.inf) or (state[i] == UPPER and upper[i] == np.inf):
                state[i] = FREE
        h = seen_gram(seen, gram, rows, missing, t)
        more = pivot(h, d, f, lower, upper, state, x, g, work, most)
        if more < 0:
            more = most + abs(descend(h, d, f, lower, upper, state, x, g, work, most))
        rounds[t] += more
