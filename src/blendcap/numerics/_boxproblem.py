"""The checked and scaled form of a batch of box-constrained problems, and the proof of an answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from blendcap.data.checks import ANY, array
from blendcap.data.errors import InputError

MAX_UNKNOWNS = 320
FLOOR = 1e-12  # of the largest diagonal element: the least curvature that an unknown is given
TOLERANCE = 1e-9  # largest optimality residual of an answer that counts as converged
CHUNK = 4096  # frames whose residuals are formed at once


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

    @property
    def usable(self) -> np.ndarray:
        """(T,) bool: the frames whose numbers are all finite."""
        return np.isfinite(self.linear).all(1) & np.isfinite(self.diagonal).all(1)

    @property
    def curvature(self) -> np.ndarray:
        """(N,) the diagonal of the Gram matrix and of what every frame adds to it, at least FLOOR of the largest."""
        with np.errstate(invalid="ignore"):
            least = np.fmin.reduce(self.diagonal, axis=0, initial=np.inf)
        curvature = np.diag(self.gram) + np.where(np.isfinite(least), least, 0.0)
        return np.maximum(curvature, FLOOR * max(curvature.max(), np.finfo(float).tiny / FLOOR))

    def gradient(self, weights: np.ndarray) -> np.ndarray:
        """Half the gradient, (T, N): `(G_t + diag d_t) a_t + l_t`."""
        result = weights @ self.gram + self.linear + self.diagonal * weights
        if self.missing.size:
            flat = self.rows.reshape(-1, len(self.gram))
            gone = np.repeat(self.missing, self.rows.shape[1], axis=1)
            result -= np.where(gone, weights @ flat.T, 0.0) @ flat
        return result

    def frames(self, span: slice) -> BoxProblem:
        """The same problem over some of its frames."""
        one = len(self.diagonal) == 1
        missing = self.missing[span] if self.missing.size else self.missing
        diagonal = self.diagonal if one else self.diagonal[span]
        return BoxProblem(self.gram, self.linear[span], diagonal, self.lower, self.upper, self.rows, missing)


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
    if rows is None:
        return BoxProblem(gram, linear, diagonal, lower, upper, np.zeros((0, 1, n)), np.zeros((0, 0), bool))
    rows = array(rows, (ANY, ANY, n), "rows", finite=True)
    missing = array(missing, (frames, len(rows)), "missing", dtype=bool)
    return BoxProblem(gram, linear, diagonal, lower, upper, rows, missing)


def residuals(problem: BoxProblem, weights: np.ndarray, coupling: np.ndarray | None = None) -> np.ndarray:
    """(T,) `max_i |a - clip(a - gradient / (2 diag H), lower, upper)|` of each frame; infinite where there is no answer.

    It is formed anew from the weights, so it does not trust the solver. `diag H` is the curvature of the whole
    problem along each unknown: `diag(gram) + diagonal`, and the couplings where there are any.
    """
    result = np.empty(len(weights))
    curvature = problem.curvature
    for first in range(0, len(weights), CHUNK):
        span = slice(first, first + CHUNK)
        part, a = problem.frames(span), weights[span]
        slope, stiff = part.gradient(a), np.maximum(curvature, np.diag(problem.gram) + part.diagonal)
        if coupling is not None:
            extra, pull = _chain(weights, coupling, first, first + len(a))
            slope, stiff = slope + pull, stiff + extra
        step = a - np.clip(a - slope / stiff, problem.lower, problem.upper)
        result[span] = np.abs(step).max(1)
    return np.where(np.isnan(result), np.inf, result)


def accuracy(weights: np.ndarray) -> float:
    """The residual up to which weights of this size count as optimal."""
    finite = np.abs(weights[np.isfinite(weights)])
    return TOLERANCE * max(1.0, float(finite.max(initial=0.0)))


def _chain(weights: np.ndarray, coupling: np.ndarray, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """What the couplings add to the curvature and to half the gradient of frames first..last."""
    before = coupling[first:last]
    after = np.zeros_like(before)
    after[: len(coupling) - 1 - first] = coupling[first + 1 : last + 1]
    a = weights[first:last]
    previous = weights[np.maximum(np.arange(first, last) - 1, 0)]
    following = weights[np.minimum(np.arange(first, last) + 1, len(weights) - 1)]
    pull = np.where(before > 0, before * (a - previous), 0) + np.where(after > 0, after * (a - following), 0)
    return before + after, pull


def _bound(values: ArrayLike, n: int, what: str) -> np.ndarray:
    try:
        result = np.broadcast_to(np.asarray(values, float), (n,)).copy()
    except (TypeError, ValueError):
        raise InputError(f"{what} must be a number or one for each of the {n} unknowns.") from None
    if np.isnan(result).any():
        raise InputError(f"{what} holds a NaN at unknown {int(np.argmax(np.isnan(result)))}; use an infinity for none.")
    return result
