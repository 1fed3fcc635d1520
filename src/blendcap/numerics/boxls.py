"""Exact box-constrained least squares for many frames that share one Gram matrix."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike

from blendcap.data.checks import array
from blendcap.data.solution import Certificate
from blendcap.numerics._boxproblem import BoxProblem, accuracy, box_problem, residuals
from blendcap.numerics._cholesky import STRIDE
from blendcap.numerics._descent import descend
from blendcap.numerics._guess import guess_states
from blendcap.numerics._pivoting import FREE, LOWER, UPPER, pivot
from blendcap.numerics._seen import seen_gram, seen_start

BLOCKS = 64  # of frames, handed to the threads
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
        largest are raised to it; so are, to 1e-14 of their own diagonal element, the pivots of a singular matrix.
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
    weights = np.empty_like(problem.linear)
    rounds = np.empty(len(weights), np.int64)
    chained = states is None
    if states is None:
        states = np.zeros(weights.shape, np.int8)
    _solve_all(*arrays(scaled), problem.usable, states, chained, weights, rounds, min(BLOCKS, max(len(weights), 1)))
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
    missing = problem.missing if problem.missing.size else np.zeros((len(problem.linear), 0), bool)
    return BoxProblem(gram, problem.linear / scale, extra, lower, upper, rows, missing), scale


def arrays(problem: BoxProblem) -> tuple[np.ndarray, ...]:
    """The arrays of a scaled problem as the kernels take them: the Gram matrix padded by a zero row and columns."""
    m = len(problem.gram)
    gram = np.zeros((m + 1, (m + 8) & -8))
    gram[:m, :m] = problem.gram
    rows = np.zeros((*problem.rows.shape[:2], gram.shape[1]))
    rows[..., :m] = problem.rows
    return gram, problem.linear, problem.diagonal, problem.lower, problem.upper, rows, problem.missing


def first_states(problem: BoxProblem, scale: np.ndarray, start: ArrayLike | None) -> np.ndarray | None:
    """(T, N) int8 states to begin with, or None where few frames are better begun from the one before."""
    frames, m = problem.linear.shape
    if start is not None:
        x = array(start, (frames, m), "start") * scale
        return (x > problem.lower).astype(np.int8) + (x >= problem.upper).astype(np.int8)
    if frames < FEW:
        return None
    usable = problem.usable[:, None]
    linear = np.where(usable, problem.linear, 0.0)
    diagonal = problem.diagonal if len(problem.diagonal) == 1 else np.where(usable, problem.diagonal, 0.0)
    return guess_states(problem.gram, diagonal, linear, problem.lower, problem.upper, min(BLOCKS, frames))


@njit(parallel=True, error_model="numpy", cache=True)
def _solve_all(gram, linear, diagonal, lower, upper, rows, missing, usable, states, chained, weights, rounds, blocks):
    frames, m = linear.shape
    for b in prange(blocks):
        g, following = np.zeros(gram.shape[1]), np.zeros(m, np.int8)
        work = (np.zeros((m + 8) * STRIDE), np.zeros(m + 8), np.zeros(m + 8, np.uint32), following)
        seen = seen_start(gram, missing)
        first = b * frames // blocks
        for t in range(first, (b + 1) * frames // blocks):
            x, state, d = weights[t], states[t], diagonal[t if len(diagonal) > 1 else 0]
            if not usable[t]:
                x[:] = np.nan
                rounds[t] = 0
                continue
            if chained and t > first:
                state[:] = states[t - 1]
            for i in range(m):
                if (state[i] == LOWER and lower[i] == -np.inf) or (state[i] == UPPER and upper[i] == np.inf):
                    state[i] = FREE
            h = seen_gram(seen, gram, rows, missing, t)
            most = 100 + 2 * m
            count = pivot(h, d, linear[t], lower, upper, state, x, g, work, most)
            if count < 0:
                count = most + abs(descend(h, d, linear[t], lower, upper, state, x, g, work, most))
            rounds[t] = count
