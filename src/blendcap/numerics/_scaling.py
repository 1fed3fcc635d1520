"""The change to unknowns that give the shared matrix a unit diagonal, and back."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from blendcap.numerics._boxproblem import BoxProblem, blocks, frozen
from blendcap.numerics._cholesky import FAST


class Scaling(NamedTuple):
    """The kept unknowns, the others being zero, and the scaled ones `a * scale`: `scale^2` is their curvature."""

    kept: np.ndarray
    scale: np.ndarray
    curvature: np.ndarray
    shift: np.ndarray

    @property
    def factors(self) -> tuple[np.ndarray, ...]:
        """The kept unknowns, what their linear terms and diagonals are multiplied by, what is taken from the latter."""
        return self.kept, 1 / self.scale, 1 / self.curvature, self.shift


def scaling(problem: BoxProblem, kept: np.ndarray) -> Scaling:
    """The change of the kept unknowns of a problem."""
    gram, curvature = np.diag(problem.gram)[kept], problem.curvature[kept]
    return Scaling(kept, np.sqrt(curvature), curvature, (curvature - gram) / curvature)


def scaled_shell(problem: BoxProblem, change: Scaling) -> BoxProblem:
    """The scaled problem without its frames."""
    kept, scale, _, _ = change
    gram = problem.gram[np.ix_(kept, kept)] / np.outer(scale, scale)
    np.fill_diagonal(gram, 1.0)
    none = np.zeros((0, len(kept)))
    lower, upper = problem.lower[kept] * scale, problem.upper[kept] * scale
    return BoxProblem(gram, none, none, lower, upper, problem.rows[..., kept] / scale, problem.missing[:0])


def scaled_problem(problem: BoxProblem, kept: np.ndarray) -> tuple[BoxProblem, np.ndarray]:
    """The problem of the kept unknowns in the unknowns `a * scale`; and that scale.

    It has zeros in the frames that are not usable.
    """
    change = scaling(problem, kept)
    linear = np.empty((len(problem.linear), len(kept)))
    diagonal = np.empty((len(problem.diagonal), len(kept)))
    rescale_all(frozen(problem.linear), frozen(problem.diagonal), change.factors, linear, diagonal, blocks(len(linear)))
    shell = scaled_shell(problem, change)
    return replace(shell, linear=linear, diagonal=diagonal, missing=problem.missing), change.scale


def scaled_span(problem: BoxProblem, change: Scaling) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest diagonal of any frame, scaled."""
    kept, _, curvature, shift = change
    least, most = problem.span
    return least[kept] / curvature - shift, most[kept] / curvature - shift


def usable_frames(problem: BoxProblem) -> np.ndarray:
    """(T,) bool: the frames whose numbers are all finite."""
    usable = np.empty(len(problem.linear), bool)
    mark_usable(frozen(problem.linear), frozen(problem.diagonal), usable, blocks(len(usable)))
    return usable


@njit(parallel=True, error_model="numpy", cache=True)
def mark_usable(linear, diagonal, usable, count):
    """`usable` becomes whether all numbers of a frame are finite."""
    frames = len(linear)
    for b in prange(count):
        for t in range(b * frames // count, (b + 1) * frames // count):
            usable[t] = finite(linear[t]) and finite(diagonal[t if len(diagonal) > 1 else 0])


@njit(fastmath=FAST, error_model="numpy", cache=True)
def finite(row):
    """Whether all numbers of a row are finite."""
    total = 0.0
    for i in range(row.size):
        total += row[i] * 0.0
    return total == 0.0  # not where it is not a number


@njit(parallel=True, error_model="numpy", cache=True)
def rescale_all(linear, diagonal, factors, scaled, bent, count):
    """The scaled linear terms and diagonals of all frames."""
    frames = len(linear)
    for b in prange(count):
        first, last = b * frames // count, (b + 1) * frames // count
        d = bent[first:last] if len(bent) > 1 else bent
        rescale(linear, diagonal, factors, first, scaled[first:last], d)


@njit(error_model="numpy", cache=True)
def rescale(linear, diagonal, factors, first, scaled, bent):
    """The scaled linear terms and diagonals from the first frame on; returns which are usable. The others are zero."""
    kept, factor, bend, shift = factors
    usable, whole = np.empty(len(scaled), np.bool_), kept.size == linear.shape[1]
    for t in range(len(scaled)):
        row, own = linear[first + t], diagonal[first + t if len(diagonal) > 1 else 0]
        usable[t] = finite(row) and finite(own)
        if not usable[t]:
            scaled[t] = 0.0
        elif whole:  # without looking up places the loop is one of vectors
            times(row, factor, scaled[t])
        else:
            chosen_times(row, kept, factor, scaled[t])
        if len(bent) == 1 and t > 0:
            continue
        if not usable[t] and len(bent) > 1:
            bent[t] = 0.0
        elif whole:
            times(own, bend, bent[t])
            less(bent[t], shift)
        else:
            chosen_times(own, kept, bend, bent[t])
            less(bent[t], shift)
    return usable


@njit(error_model="numpy", inline="always")
def times(row, factor, out):
    for k in range(factor.size):
        out[k] = row[k] * factor[k]


@njit(error_model="numpy", inline="always")
def chosen_times(row, kept, factor, out):
    for k in range(factor.size):
        out[k] = row[kept[k]] * factor[k]


@njit(error_model="numpy", inline="always")
def less(out, shift):
    for k in range(shift.size):
        out[k] -= shift[k]


@njit(error_model="numpy", cache=True)
def unscale(x, usable, kept, scale, lower, upper, weights):
    """The weights of all unknowns within their bounds, from the scaled ones of those that were kept.

    They are zero for the others, and NaN in the frames that are not usable.
    """
    factor = 1 / scale
    for t in range(len(x)):
        row, scaled = weights[t], x[t]
        row[:] = 0.0 if usable[t] else np.nan
        if usable[t]:
            for k in range(kept.size):
                i = kept[k]
                row[i] = min(upper[i], max(lower[i], scaled[k] * factor[k]))
