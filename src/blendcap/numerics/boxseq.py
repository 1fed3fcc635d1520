"""Exact box-constrained least squares over a whole sequence whose neighboring frames are coupled."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike

from blendcap.data.checks import array
from blendcap.data.errors import InputError
from blendcap.data.solution import Certificate
from blendcap.numerics._boxproblem import accuracy, box_problem, residuals
from blendcap.numerics._newton import Sequence
from blendcap.numerics._scaling import scaled_problem, usable_frames
from blendcap.numerics.boxls import first_states

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

    A primal-dual active-set method (Hintermüller, Ito and Kunisch 2002, doi:10.1137/S1052623401383558): each step
    solves for the free unknowns of all frames at once, then puts right the states that the answer contradicts.

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
    usable = usable_frames(problem)
    start = None if start is None else array(start, problem.linear.shape, "start")
    links = _links(coupling, usable, problem.linear.shape)
    scaled, scale = scaled_problem(problem, np.arange(len(problem.gram)))
    weights, steps = Sequence(scaled, links / scale**2, first_states(scaled, problem, start)).solve()
    log.debug("%d frames in %d Newton steps", len(weights), steps)
    weights /= scale
    np.clip(weights, problem.lower, problem.upper, out=weights)
    weights[~usable] = np.nan
    worst = residuals(problem, weights, links)
    largest = float(worst.max(initial=0.0))
    return weights, Certificate(largest, steps, largest <= accuracy(problem, weights), worst)


def _links(coupling: ArrayLike, usable: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(T, N) couplings, 0 in row 0 and on both sides of a frame without an answer."""
    try:
        links = np.broadcast_to(np.asarray(coupling, float), shape).copy()
    except (TypeError, ValueError):
        raise InputError(f"coupling must be numbers of the shape {shape} or ({shape[1]},).") from None
    links[:1] = 0.0
    links[~usable] = 0.0
    links[1:][~usable[:-1]] = 0.0
    if not (np.isfinite(links).all() and (links >= 0).all()):
        t, i = np.argwhere(~(np.isfinite(links) & (links >= 0)))[0]
        raise InputError(f"coupling must be finite and not negative, but is {links[t, i]:g} at frame {t}, unknown {i}.")
    return links
