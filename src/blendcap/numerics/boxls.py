"""Exact box-constrained least squares for many frames that share one Gram matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from blendcap.data.checks import array
from blendcap.data.solution import Certificate
from blendcap.numerics._boxproblem import BoxProblem, accuracy, blocks, box_problem, residuals
from blendcap.numerics._guess import NO_GUESS, Guesser
from blendcap.numerics._pivoting import LOWER
from blendcap.numerics._run import solve_runs
from blendcap.numerics._scaling import scaled_problem, scaled_shell, scaled_span, scaling, usable_frames

RUN = 2**15  # numbers of the frames that pass through all stages together: they fill the lanes and fit the cache
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

    Raises
    ------
    InputError
        If the matrix is not symmetric, has more than 320 unknowns or a negative curvature, bounds cross, or shapes do
        not fit together.
    """
    problem = box_problem(gram, linear, diagonal, lower, upper, rows, missing)
    start = None if start is None else array(start, problem.linear.shape, "start")
    weights, rounds, worst, idle = _solve(problem, start)
    enough = accuracy(problem, weights)
    wrong = ~(worst <= NEAR * enough)
    if idle.any() and wrong.any():  # an unknown that was left out is wanted there
        weights[wrong], more, worst[wrong], _ = _solve(problem.of_frames(wrong), weights[wrong])
        rounds[wrong] += more
    largest = float(worst.max(initial=0.0))
    mean = float(rounds.mean()) if len(rounds) else 0.0
    return weights, Certificate(largest, mean, largest <= enough, worst)


def _solve(problem: BoxProblem, start: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(T, N) weights; the rounds and the residual of each frame; (N,) which unknowns were left at zero."""
    frames, n = problem.linear.shape
    idle = np.zeros(n, bool) if start is not None else idle_unknowns(problem)
    change = scaling(problem, np.flatnonzero(~idle))
    shell = scaled_shell(problem, change)
    begin, guess = np.zeros((0, n), np.int8), NO_GUESS
    if start is not None:
        begin = start_states(problem, start)
    elif frames >= FEW:
        guess = Guesser(shell.gram, scaled_span(problem, change), shell.lower, shell.upper).arrays
    count = blocks(frames) if problem.missing.shape[1] or frames < FEW else max(1, frames * n // RUN)
    answers = np.empty((frames, n)), np.zeros(frames, np.int64), np.empty(frames)
    boxes = problem.arrays(), shell.arrays()
    solve_runs(*boxes, change.factors, change.scale, guess, begin, problem.curvature, answers, count)
    weights, rounds, worst = answers
    return weights, rounds, residuals(problem, weights) if problem.missing.shape[1] else worst, idle


def idle_unknowns(problem: BoxProblem) -> np.ndarray:
    """(N,) bool: the unknowns that stay at zero, their lower bound, in the guess of every frame of a sample.

    A first answer does without them: a take uses few of the shapes of a large rig. Its certificate tells the frames
    where they are wanted. It does not pay for small rigs, nor where a diagonal of each frame pulls at all shapes.
    """
    frames, n = problem.linear.shape
    if n < LARGE or frames < ENOUGH * SAMPLE or len(problem.diagonal) > 1:
        return np.zeros(n, bool)
    part = problem.of_frames(np.arange(0, frames, frames // SAMPLE))
    sample, _ = scaled_problem(part, np.arange(n))
    idle = (guesser(sample).states(sample)[usable_frames(part)] == LOWER).all(0) & (problem.lower == 0)
    return idle & (n / 12 < idle.sum() < n)  # a few are not worth it


def first_states(scaled: BoxProblem, problem: BoxProblem, start: np.ndarray | None) -> np.ndarray | None:
    """(T, N) int8 states to begin with, or None where few frames are better begun from the one before."""
    if start is not None:
        return start_states(problem, start)
    return guesser(scaled).states(scaled) if len(scaled.linear) >= FEW else None


def start_states(problem: BoxProblem, start: np.ndarray) -> np.ndarray:
    """(T, N) int8 states of the weights to start from."""
    return (start > problem.lower).astype(np.int8) + (start >= problem.upper).astype(np.int8)


def guesser(scaled: BoxProblem) -> Guesser:
    """Of the frames of a scaled problem."""
    return Guesser(scaled.gram, scaled.span, scaled.lower, scaled.upper)
