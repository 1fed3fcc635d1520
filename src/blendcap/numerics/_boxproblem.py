"""The checked and scaled form of a batch of box-constrained problems, and the proof of an answer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from blendcap.data.checks import ANY, array
from blendcap.data.errors import InputError
from blendcap.numerics._gradient import spans, worst_apart, worst_residuals

MAX_UNKNOWNS = 320
FLOOR = 1e-12  # of the largest diagonal element: the least curvature that an unknown is given
TOLERANCE = 1e-9  # largest optimality residual of an answer that counts as converged
BLOCKS = 64


@dataclass(frozen=True, eq=False)
class BoxProblem:
    """Minimise `a'(G_t + diag d_t)a + 2 l_t'a` for every frame t over `lower <= a <= upper`, in the caller's units.

    `G_t` is `gram` less `rows[m].T @ rows[m]` of every marker m that is missing in frame t. `diagonal` has one row for
    all frames or a row for each. `rows` and `missing` are empty where no marker is ever missing.
    """

    gram: np.ndarray
    linear: np.ndarray
    diagonal: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rows: np.ndarray
    missing: np.ndarray

    @cached_property
    def span(self) -> tuple[np.ndarray, np.ndarray]:
        """(N,) the least and the largest of what the frames add to the diagonal."""
        count = blocks(len(self.diagonal))
        least, most = np.full((count, len(self.gram)), np.inf), np.full((count, len(self.gram)), -np.inf)
        spans(frozen(self.diagonal), least, most)
        least, most = least.min(0), most.max(0)
        return np.where(least <= most, least, 0.0), np.where(least <= most, most, 0.0)

    @cached_property
    def curvature(self) -> np.ndarray:
        """(N,) the diagonal of the Gram matrix and of what every frame adds to it, at least FLOOR of the largest."""
        curvature = np.diag(self.gram) + self.span[0]
        return np.maximum(curvature, FLOOR * max(curvature.max(), np.finfo(float).tiny / FLOOR))

    def of_frames(self, chosen: np.ndarray) -> BoxProblem:
        """The problem of the chosen frames."""
        diagonal = self.diagonal if len(self.diagonal) == 1 else self.diagonal[chosen]
        return replace(self, linear=self.linear[chosen], diagonal=diagonal, missing=self.missing[chosen])

    def arrays(self) -> tuple[np.ndarray, ...]:
        """The fields as the kernels take them: the Gram matrix padded by a row and some columns of zeros.

        What the caller may own is read-only in every case, so that one compiled kernel serves all.
        """
        m = len(self.gram)
        gram = np.zeros((m + 1, (m + 8) & -8))
        gram[:m, :m] = self.gram
        rows = np.zeros((*self.rows.shape[:2], gram.shape[1]))
        rows[..., :m] = self.rows
        return gram, frozen(self.linear), frozen(self.diagonal), self.lower, self.upper, rows, frozen(self.missing)


def box_problem(gram, linear, diagonal, lower, upper, rows, missing) -> BoxProblem:
    """Check the arguments of the public solvers; see `solve_box` for their meaning."""
    gram = array(gram, (ANY, ANY), "gram", finite=True)
    n = len(gram)
    if gram.shape[1] != n or not 0 < n <= MAX_UNKNOWNS:
        raise InputError(f"gram must be square with 1 to {MAX_UNKNOWNS} unknowns, but has the shape {gram.shape}.")
    if np.abs(gram - gram.T).max() > 1e-9 * np.abs(gram).max():
        raise InputError("gram must be symmetric; pass (gram + gram.T) / 2 if that is what you mean.")
    linear = array(linear, (ANY, n), "linear")
    frames = len(linear)
    diagonal = np.zeros((1, n)) if diagonal is None else array(diagonal, (frames, n), "diagonal")
    lower, upper = (_bound(b, n, w) for b, w in ((lower, "lower"), (upper, "upper")))
    if not (lower < upper).all():
        i = int(np.argmin(lower < upper))
        raise InputError(f"lower must be below upper, but unknown {i} has {lower[i]:g} and {upper[i]:g}.")
    if (rows is None) != (missing is None):
        raise InputError("rows and missing belong together; give both or neither.")
    rows = np.zeros((0, 1, n)) if rows is None else array(rows, (ANY, ANY, n), "rows", finite=True)
    missing = (
        np.zeros((frames, 0), bool) if missing is None else array(missing, (frames, len(rows)), "missing", dtype=bool)
    )
    problem = BoxProblem(gram, linear, diagonal, lower, upper, rows, missing)
    least = np.diag(gram) + problem.span[0]
    if (least < -FLOOR * np.abs(np.diag(gram)).max()).any():
        i = int(least.argmin())
        raise InputError(f"gram and diagonal add up to {least[i]:g} for unknown {i}: below 0 there is no one optimum.")
    return problem


def residuals(problem: BoxProblem, weights: np.ndarray, coupling: np.ndarray | None = None) -> np.ndarray:
    """(T,) `max_i |a - clip(a - gradient / (2 diag H), lower, upper)|` of each frame.

    It is infinite where there is no answer, and formed anew from the weights, so it does not trust the solver.
    `diag H` is the curvature of the frame's problem along each unknown: the diagonal of the Gram matrix of the markers
    that it sees, `diagonal` and the couplings; at least a millionth of what it would be with all markers.
    """
    worst = np.empty(len(weights))
    if coupling is None and not problem.missing.shape[1]:
        worst_apart(problem.arrays(), problem.curvature, weights, worst, blocks(len(weights)))
        return worst
    links = np.zeros((0, weights.shape[1])) if coupling is None else coupling
    worst_residuals(problem.arrays(), links, problem.curvature, weights, worst, blocks(len(weights)))
    return worst


def blocks(frames: int, least: int = 1) -> int:
    """How many runs of at least so many frames the threads share; it does not depend on their number."""
    return max(1, min(BLOCKS, frames // least))


def accuracy(problem: BoxProblem, weights: np.ndarray) -> float:
    """The residual up to which weights of this size count as optimal."""
    size = max(np.abs(problem.lower).max(), np.abs(problem.upper).max())
    if size > 1:  # the bounds do not tell
        size = np.abs(weights[np.isfinite(weights)]).max(initial=0.0)
    return TOLERANCE * max(1.0, float(size))


def _bound(values: ArrayLike, n: int, what: str) -> np.ndarray:
    try:
        result = np.broadcast_to(np.asarray(values, float), (n,)).copy()
    except (TypeError, ValueError):
        raise InputError(f"{what} must be a number or one for each of the {n} unknowns.") from None
    if np.isnan(result).any():
        raise InputError(f"{what} holds a NaN at unknown {int(np.argmax(np.isnan(result)))}; use an infinity for none.")
    return result


def frozen(values: np.ndarray) -> np.ndarray:
    """A view that cannot be written to: kernels are compiled once, for what a caller may own."""
    view = values.view()
    view.flags.writeable = False
    return view
