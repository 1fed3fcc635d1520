"""Block principal pivoting: the exact optimum of one frame from a guess of which unknowns sit on a bound."""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.numerics._cholesky import FAST, STRIDE, add_rows, back_substitute, factor

LOWER, FREE, UPPER = 0, 1, 2
PATIENCE = 10  # rounds without fewer wrong states before one state at a time is changed


@njit(fastmath=FAST, error_model="numpy", cache=True)
def gather(gram, diagonal, g, free, k, n, width, a):
    """Fill `a` with the free block of `gram + diag`, padded to n by unknowns that answer 0, and with -g beside it."""
    for i in range(n):
        row, s = gram[free[i]], i & -8
        r, cols = a[i * STRIDE + s : i * STRIDE + width], free[s:n]
        for j in range(cols.size):
            r[j] = row[cols[j]]
        for j in range(n - s, width - s):
            r[j] = 0.0
        if i < k:
            r[i - s] += diagonal[free[i]]
            r[n - s] = -g[free[i]]
        else:
            r[i - s] = 1.0


@njit(fastmath=FAST, error_model="numpy", cache=True)
def settle(gram, diagonal, linear, lower, upper, state, free, x, g):
    """Put the bound unknowns on their bounds; g becomes half the gradient there; returns how many are free.

    `free` lists the free unknowns, padded to a multiple of four with the zero row of `gram`.
    """
    m = linear.size
    k = 0
    for i in range(m):
        free[k] = i
        k += state[i] == FREE
        x[i] = 0.0 if state[i] == FREE else (lower[i] if state[i] == LOWER else upper[i])
        g[i] = linear[i] + diagonal[i] * x[i]
    g[m:] = 0.0
    for i in range(m):
        if x[i] != 0:
            for j in range(g.size):
                g[j] += x[i] * gram[i, j]
    free[k : (k + 3) & -4] = m
    return k


@njit(fastmath=FAST, error_model="numpy", cache=True)
def judge(lower, upper, state, x, g, tolerance, following):
    """The states that x and g ask for; returns how many differ. Without branches: the states are unpredictable."""
    wrong = 0
    for i in range(state.size):
        now = state[i]
        leave = np.int8(x[i] > upper[i]) - np.int8(x[i] < lower[i])
        enter = np.int8((now == LOWER) & (g[i] < -tolerance)) - np.int8((now == UPPER) & (g[i] > tolerance))
        following[i] = now + (now == FREE) * leave + enter
        wrong += following[i] != now
    return wrong


@njit(fastmath=FAST, error_model="numpy", cache=True)
def pivot(gram, diagonal, linear, lower, upper, state, x, g, work, most):
    """Solve one frame exactly; returns the rounds it took, or -1 if `most` were not enough.

    Every round solves for the free unknowns and flips each state whose value is outside its bounds or whose gradient
    has the wrong sign (Portugal, Judice and Vicente 1994, doi:10.2307/2153286). That may cycle; so once PATIENCE
    rounds bring no fewer wrong states only the last one is flipped, which cannot (Murty 1974,
    doi:10.1007/BF01580098), until it does.
    """
    a, y, free, following = work
    tolerance = 1e-13 * max(1.0, np.abs(linear).max())
    fewest, patience = state.size + 1, PATIENCE
    for rounds in range(1, most + 1):
        k = settle(gram, diagonal, linear, lower, upper, state, free, x, g)
        n = (k + 3) & -4
        gather(gram, diagonal, g, free, k, n, (n + 8) & -8, a)
        factor(a, n, (n + 8) & -8)
        back_substitute(a, n, y)
        add_rows(g, gram, free[:n], y)
        for i in range(k):
            x[free[i]] = y[i]
            g[free[i]] += diagonal[free[i]] * y[i]
        wrong = judge(lower, upper, state, x, g, tolerance, following)
        if wrong == 0:
            return rounds
        patience -= 1
        if wrong < fewest:
            fewest, patience = wrong, PATIENCE
        if patience > 0:
            state[:] = following
        else:
            i = state.size - 1
            while following[i] == state[i]:
                i -= 1
            state[i] = following[i]
    return -1
