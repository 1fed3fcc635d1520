"""The change to unknowns that give the shared matrix a unit diagonal, and back."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._boxproblem import BoxProblem, blocks
from blendcap.numerics._cholesky import FAST


def usable_frames(problem: BoxProblem) -> np.ndarray:
    """(T,) bool: the frames whose numbers are all finite."""
    usable = np.ones(len(problem.linear), bool)
    for values in (problem.linear, problem.diagonal):
        mark_finite(values, usable, blocks(len(usable)))
    return usable


def scaled_problem(problem: BoxProblem, usable: np.ndarray, kept: np.ndarray) -> tuple[BoxProblem, np.ndarray]:
    """The problem of the kept unknowns, the others being zero, in the unknowns `a * scale`; and that scale.

    It has zeros in the frames that are not usable.
    """
    gram, curvature = problem.gram[np.ix_(kept, kept)], problem.curvature[kept]
    scale = np.sqrt(curvature)
    shift = (curvature - np.diag(gram)) / curvature
    linear = np.empty((len(problem.linear), len(kept)))
    diagonal = np.empty((len(problem.diagonal), len(kept)))
    count = blocks(len(linear))
    rescale(problem.linear, usable, kept, 1 / scale, np.zeros_like(shift), linear, count)
    rescale(
        problem.diagonal, usable[: len(diagonal)] | (len(diagonal) == 1), kept, 1 / curvature, shift, diagonal, count
    )
    gram = gram / np.outer(scale, scale)
    np.fill_diagonal(gram, 1.0)
    lower, upper = problem.lower[kept] * scale, problem.upper[kept] * scale
    return BoxProblem(gram, linear, diagonal, lower, upper, problem.rows[..., kept] / scale, problem.missing), scale


@njit(parallel=True, fastmath=FAST, error_model="numpy", cache=True)
def mark_finite(values, finite, count):
    """`finite` becomes False where a row holds a number that is not finite; a single row stands for all."""
    rows = len(values)
    for b in prange(count):
        for t in range(b * rows // count, (b + 1) * rows // count):
            total, row = 0.0, values[t]
            for i in range(row.size):
                total += row[i] * 0.0
            if total != 0.0:  # also where it is not a number
                if rows > 1:
                    finite[t] = False
                else:
                    finite[:] = False


@njit(parallel=True, error_model="numpy", cache=True)
def rescale(values, usable, kept, factor, shift, out, count):
    """`out = values * factor - shift` of the kept columns, zero in the rows that are not usable."""
    rows = len(values)
    for b in prange(count):
        for t in range(b * rows // count, (b + 1) * rows // count):
            row, scaled = values[t], out[t]
            for k in range(kept.size):
                scaled[k] = row[kept[k]] * factor[k] - shift[k] if usable[t] else 0.0


@njit(parallel=True, error_model="numpy", cache=True)
def unscale(x, usable, kept, scale, lower, upper, weights, count):
    """The weights of all unknowns within their bounds, from the scaled ones of those that were kept.

    They are zero for the others, and NaN in the frames that are not usable.
    """
    frames = len(x)
    factor = 1 / scale
    for b in prange(count):
        for t in range(b * frames // count, (b + 1) * frames // count):
            row, scaled = weights[t], x[t]
            row[:] = 0.0 if usable[t] else np.nan
            if usable[t]:
                for k in range(kept.size):
                    i = kept[k]
                    row[i] = min(upper[i], max(lower[i], scaled[k] * factor[k]))
