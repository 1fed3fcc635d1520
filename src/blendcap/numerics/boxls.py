"""Exact box-constrained least squares for many frames that share one Gram matrix."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike

from blendcap.data.checks import array
from blendcap.data.solution import Certificate
from blendcap.numerics._boxproblem import BoxProblem, accuracy, blocks, box_problem, residuals
from blendcap.numerics._descent import descend
from blendcap.numerics._guess import MANY, Guesser
from blendcap.numerics._pivoting import FREE, LOWER, UPPER, pivot, workspace
from blendcap.numerics._scaling import scaled_problem, unscale, usable_frames
from blendcap.numerics._seen import seen_gram, seen_start
from blendcap.numerics._together import settle

LARGE = 96  # unknowns from which it pays to look for idle ones
SAMPLE, ENOUGH = 192, 8  # frames in which idle unknowns are sought; how many times as many it takes to pay
NEAR = 1e-3  # of the accuracy: a larger residual of an answer without the idle ones sends its frame back
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
    start = None if start is None else array(start, problem.linear.shape, "start")
    weights, rounds, idle = _solve(problem, start)
    worst = residuals(problem, weights)
    enough = accuracy(problem, weights)
    wrong = ~(worst <= NEAR * enough)
    if idle.any() and wrong.any():  # an unknown that was left out is wanted there
        part = problem.of_frames(wrong)
        weights[wrong], more, _ = _solve(part, weights[wrong])
        worst[wrong] = residuals(part, weights[wrong])
        rounds[wrong] += more
    largest = float(worst.max(initial=0.0))
    mean = float(rounds.mean()) if len(rounds) else 0.0
    return weights, Certificate(largest, mean, largest <= enough, worst)


def _solve(problem: BoxProblem, start: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T, N) weights, NaN in frames that are not usable; the rounds of each frame; (N,) the unknowns left at zero."""
    usable = usable_frames(problem)
    idle = np.zeros(len(problem.gram), bool) if start is not None else idle_unknowns(problem, usable)
    kept = np.flatnonzero(~idle)
    scaled, scale = scaled_problem(problem, usable, kept)
    states = first_states(scaled, scale, start)
    x, todo = np.empty_like(scaled.linear), usable.copy()
    rounds = np.zeros(len(x), np.int64)
    if states is not None and not problem.missing.shape[1]:
        settle(scaled.arrays(), states, todo, x, rounds, blocks(len(x), MANY))
    if todo.any():
        given = states is not None
        states = np.zeros((1, 1), np.int8) if states is None else states
        _solve_all(scaled.arrays(), todo, states, given, x, rounds, blocks(len(x)))
    weights = np.empty_like(problem.linear)
    unscale(x, usable, kept, scale, problem.lower, problem.upper, weights, blocks(len(x)))
    return weights, rounds, idle


def idle_unknowns(problem: BoxProblem, usable: np.ndarray) -> np.ndarray:
    """(N,) bool: the unknowns that stay at zero, their lower bound, in the guess of every frame of a sample.

    A first answer does without them: a take uses few of the shapes of a large rig. Its certificate tells the frames
    where they are wanted. It does not pay for small rigs, nor where a diagonal of each frame pulls at all shapes.
    """
    frames, n = problem.linear.shape
    chosen = np.arange(0, frames, max(1, frames // SAMPLE))[usable[:: max(1, frames // SAMPLE)]]
    if n < LARGE or frames < ENOUGH * SAMPLE or len(problem.diagonal) > 1 or not len(chosen):
        return np.zeros(n, bool)
    sample, _ = scaled_problem(problem.of_frames(chosen), np.ones(len(chosen), bool), np.arange(n))
    idle = (Guesser(sample).states(sample) == LOWER).all(0) & (problem.lower == 0)
    return idle & (n / 12 < idle.sum() < n)  # a few are not worth it


def first_states(problem: BoxProblem, scale: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
    """(T, N) int8 states to begin with, or None where few frames are better begun from the one before."""
    if start is not None:
        x = start * scale
        return (x > problem.lower).astype(np.int8) + (x >= problem.upper).astype(np.int8)
    return Guesser(problem).states(problem) if len(problem.linear) >= FEW else None


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
