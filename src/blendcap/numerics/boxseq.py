"""Exact box-constrained least squares over a whole sequence whose neighboring frames are coupled."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike

from blendcap.data.checks import array
from blendcap.data.errors import InputError
from blendcap.data.solution import Certificate
from blendcap.numerics import _chain as chain
from blendcap.numerics._boxproblem import BoxProblem, accuracy, box_problem, residuals
from blendcap.numerics._pivoting import FREE, LOWER, UPPER
from blendcap.numerics.boxls import BLOCKS, arrays, first_states, scaled_problem

MOST = 60  # active-set steps before the monotone method takes over
PATIENCE = 8  # steps without fewer wrong states before it does
DESCENTS = 200
ARMIJO = 1e-4

log = logging.getLogger(__name__)


def solve_box_sequence(
    gram: ArrayLike,
    linear: ArrayLike,
    coupling: ArrayLike,
    *,
    diagonal: ArrayLike | None = None,
    lower: ArrayLike = 0.0,
    upper: ArrayLike = 1.0,
    start: ArrayLike | None = None,
    rows: ArrayLike | None = None,
    missing: ArrayLike | None = None,
) -> tuple[np.ndarray, Certificate]:
    """Minimise `solve_box`'s objective summed over the frames plus `sum_ti c_ti (a_ti - a_(t-1)i)^2`, exactly.

    Parameters
    ----------
    gram, linear, diagonal, lower, upper, start, rows, missing
        As in `solve_box`.
    coupling : (N,) or (T, N)
        c, not negative; row t couples frame t with frame t - 1, so row 0 is not used.

    Returns
    -------
    weights : (T, N) float64
        NaN in the frames that hold a number that is not finite; the chain is cut there.
    certificate : Certificate
        The optimality residual of every frame, formed from the weights alone; `iterations` counts Newton steps.
    """
    problem = box_problem(gram, linear, diagonal, lower, upper, rows, missing)
    usable = problem.usable
    links = _links(coupling, usable, problem.linear.shape)
    scaled, scale = scaled_problem(problem)
    calm = _without_gaps(scaled, usable)
    weights, steps = _solve(calm, links / scale**2, first_states(calm, scale, start))
    weights /= scale
    np.clip(weights, problem.lower, problem.upper, out=weights)
    weights[~usable] = np.nan
    worst = residuals(problem, weights, links)
    largest = float(worst.max(initial=0.0))
    return weights, Certificate(largest, steps, largest <= accuracy(weights), worst)


def _links(coupling: ArrayLike, usable: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(T, N) couplings, 0 in row 0 and on both sides of a frame without an answer."""
    try:
        links = np.broadcast_to(np.asarray(coupling, float), shape).copy()
    except (TypeError, ValueError):
        raise InputError(f"coupling must have the shape {shape} or ({shape[1]},).") from None
    links[:1] = 0.0
    links[~usable] = 0.0
    links[1:][~usable[:-1]] = 0.0
    if not (np.isfinite(links).all() and (links >= 0).all()):
        t, i = np.argwhere(~(np.isfinite(links) & (links >= 0)))[0]
        raise InputError(f"coupling must be finite and not negative, but is {links[t, i]:g} at frame {t}, unknown {i}.")
    return links


def _without_gaps(problem: BoxProblem, usable: np.ndarray) -> BoxProblem:
    """The problem with zeros in the frames that hold numbers that are not finite."""
    if usable.all():
        return problem
    linear = np.where(usable[:, None], problem.linear, 0.0)
    diagonal = problem.diagonal
    if len(diagonal) > 1:
        diagonal = np.where(usable[:, None], diagonal, 0.0)
    return BoxProblem(problem.gram, linear, diagonal, problem.lower, problem.upper, problem.rows, problem.missing)


def _solve(problem: BoxProblem, coupling: np.ndarray, states: np.ndarray | None) -> tuple[np.ndarray, float]:
    """The weights of the scaled problem and the Newton steps they took."""
    gram, linear, diagonal, lower, upper, rows, missing = arrays(problem)
    frames = len(linear)
    if states is None:
        states = np.full(linear.shape, FREE, np.int8)
    states[np.isinf(lower) & (states == LOWER)] = FREE
    states[np.isinf(upper) & (states == UPPER)] = FREE
    blocks = max(min(BLOCKS, frames), 1)
    tolerance = 1e-12 * np.maximum(1.0, np.abs(linear).max(1))
    x = np.where(states == LOWER, lower, np.where(states == UPPER, upper, 0.0))
    x[states == FREE] = 0.0
    g, step = np.empty_like(x), np.empty_like(x)

    def slope(at, out):
        chain.gradients(gram, linear, diagonal, rows, missing, coupling, at, out, blocks)

    def newton():
        count = (states == FREE).sum(1)
        starts = np.concatenate([[0], np.cumsum(count * (count + 1) // 2)])
        inverses = np.empty(starts[-1])
        chain.eliminate(gram, diagonal, rows, missing, coupling, states, starts, inverses)
        chain.substitute(coupling, states, starts, inverses, g, step)

    fewest, patience = states.size + 1, PATIENCE
    for steps in range(1, MOST + 1):
        slope(x, g)
        newton()
        x += step
        slope(x, g)
        wrong = chain.flip(lower, upper, states, x, g, tolerance, blocks)
        log.debug("step %d: %d wrong states", steps, wrong)
        if wrong == 0:
            return x, steps
        patience -= 1
        if wrong < fewest:
            fewest, patience = wrong, PATIENCE
        if patience == 0:
            break
    np.clip(x, lower, upper, out=x)
    for more in range(1, DESCENTS + 1):
        slope(x, g)
        states[:] = FREE
        states[(x <= lower) & (g >= 0)] = LOWER
        states[(x >= upper) & (g <= 0)] = UPPER
        newton()
        value, length = (x * (g + linear)).sum(), 1.0
        while True:
            trial = np.clip(x + length * step, lower, upper)
            fall = (g * (trial - x)).sum()
            slope(trial, step_g := np.empty_like(g))
            if (trial * (step_g + linear)).sum() <= value + 2 * ARMIJO * fall or length < 1e-10:
                break
            length /= 2
        moved = np.abs(trial - x).max()
        x = trial
        if moved <= 1e-13:
            break
    return x, steps + more
