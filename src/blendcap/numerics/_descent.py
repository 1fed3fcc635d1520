"""The safety net: a method for one frame that cannot cycle, because every step of it lowers the objective."""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.numerics._cholesky import FAST, STRIDE, back_substitute, factor
from blendcap.numerics._pivoting import FREE, LOWER, UPPER, evaluate, gather, pack, size


@njit(fastmath=FAST, error_model="numpy", cache=True)
def descend(gram, diagonal, linear, lower, upper, state, x, g, work, most):
    """Coordinate descent and Newton steps on the free unknowns, cut where the first bound is met.

    Returns the rounds it took, or -1 if `most` were not enough; x is feasible and no worse than at the start.
    """
    (a, _, _, _), (y, _, _, _), (free, _, _), _, (one, _) = work
    m = state.size
    tolerance = 1e-13 * size(linear)
    for i in range(m):
        x[i] = min(upper[i], max(lower[i], x[i]))
    for rounds in range(1, most + 1):
        evaluate(gram, diagonal, linear, x, g)
        move = sweep(gram, diagonal, lower, upper, x, g)
        if move <= tolerance:
            return rounds
        for i in range(m):
            low, high = x[i] <= lower[i] and g[i] >= 0, x[i] >= upper[i] and g[i] <= 0
            state[i] = LOWER if low else (UPPER if high else FREE)
        k = pack(state, FREE, free)
        n = (k + 3) & -4
        gather(gram, diagonal, free, k, n, (n + 8) & -8, a)
        for i in range(k):
            a[i * STRIDE + n] = -g[free[i]]
        factor(a, n, (n + 8) & -8, one)
        back_substitute(a, n, a[n:], np.int64(STRIDE), y)
        reach = 1.0
        for i in range(k):
            j = free[i]
            if y[i] > 0:
                reach = min(reach, (upper[j] - x[j]) / y[i])
            elif y[i] < 0:
                reach = min(reach, (lower[j] - x[j]) / y[i])
        for i in range(k):
            j = free[i]
            x[j] = min(upper[j], max(lower[j], x[j] + reach * y[i]))
    return -1


@njit(fastmath=FAST, error_model="numpy", inline="always")
def sweep(gram, diagonal, lower, upper, x, g):
    """Minimise over one unknown after the other; returns the largest move."""
    largest = 0.0
    for i in range(x.size):
        new = min(upper[i], max(lower[i], x[i] - g[i] / (gram[i, i] + diagonal[i])))
        move = new - x[i]
        if move != 0:
            x[i] = new
            largest = max(largest, abs(move))
            for j in range(g.size):
                g[j] += move * gram[i, j]
            g[i] += move * diagonal[i]
    return largest
