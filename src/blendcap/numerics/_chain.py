"""Newton steps of a whole sequence: a block-tridiagonal system over the free unknowns of all frames."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._cholesky import FAST, STRIDE, factor, invert_factor, square_rows
from blendcap.numerics._pivoting import FREE, LOWER, UPPER
from blendcap.numerics._seen import seen_gram, seen_start


@njit(parallel=True, error_model="numpy", cache=True)
def gradients(gram, linear, diagonal, rows, missing, coupling, x, g, blocks):
    """g = half the gradient of the whole objective at x."""
    frames, m = x.shape
    for b in prange(blocks):
        h, shift = np.zeros(gram.shape[1]), np.zeros(rows.shape[1])
        for t in range(b * frames // blocks, (b + 1) * frames // blocks):
            _product(gram, rows, missing, t, x[t], h, shift)
            d = diagonal[t if len(diagonal) > 1 else 0]
            for i in range(m):
                s = h[i] + linear[t, i] + d[i] * x[t, i]
                if t > 0:
                    s += coupling[t, i] * (x[t, i] - x[t - 1, i])
                if t + 1 < frames:
                    s += coupling[t + 1, i] * (x[t, i] - x[t + 1, i])
                g[t, i] = s


@njit(fastmath=FAST, error_model="numpy", cache=True)
def _product(gram, rows, missing, t, x, h, shift):
    """h = G_t x."""
    h[:] = 0.0
    for i in range(x.size):
        if x[i] != 0:
            for j in range(h.size):
                h[j] += x[i] * gram[i, j]
    for k in range(missing.shape[1]):
        if missing[t, k]:
            for p in range(rows.shape[1]):
                r, s = rows[k, p], 0.0
                for j in range(x.size):
                    s += r[j] * x[j]
                for j in range(h.size):
                    h[j] -= s * r[j]


@njit(error_model="numpy", cache=True)
def eliminate(gram, diagonal, rows, missing, coupling, states, starts, inverses):
    """Invert the diagonal blocks of the system one frame after the other, each less what the frame before explains.

    The inverse of frame t, packed lower triangle, lies at starts[t] in `inverses`.
    """
    frames, m = states.shape
    a, w, v = np.zeros((m + 8) * STRIDE), np.zeros((m + 8) * STRIDE), np.zeros((m + 8) * STRIDE)
    free, back = np.zeros(m + 8, np.uint32), np.zeros(m + 8, np.int64)
    place = np.full(m + 1, -1)
    seen = seen_start(gram, missing)
    for t in range(frames):
        k = _list_free(states[t], free)
        n = (k + 3) & -4
        h, d = seen_gram(seen, gram, rows, missing, t), diagonal[t if len(diagonal) > 1 else 0]
        for i in range(k):
            back[i] = place[free[i]] if t > 0 else -1
        for i in range(n):
            r, s = a[i * STRIDE : i * STRIDE + n], i & -8
            row = h[free[i]]
            for j in range(s, n):
                r[j] = row[free[j]]
            if i >= k:
                r[i] = 1.0
                continue
            r[i] += d[free[i]] + coupling[t, free[i]]
            if t + 1 < frames:
                r[i] += coupling[t + 1, free[i]]
            if back[i] >= 0:
                c, p = coupling[t, free[i]], back[i] * STRIDE
                for j in range(i, k):
                    if back[j] >= 0:
                        r[j] -= c * coupling[t, free[j]] * v[back[j] * STRIDE + back[i]]
        factor(a, n, (n + 8) & -8)
        invert_factor(a, n, w)
        square_rows(w, n, v)
        o = starts[t]
        for i in range(k):
            inverses[o : o + i + 1] = v[i * STRIDE : i * STRIDE + i + 1]
            o += i + 1
        place[:] = -1
        for i in range(k):
            place[free[i]] = i


@njit(error_model="numpy", cache=True)
def substitute(coupling, states, starts, inverses, g, step):
    """step = the solution of the Newton system with the right-hand side -g; 0 at unknowns on a bound."""
    frames, m = states.shape
    free, y, z = np.zeros(m + 8, np.uint32), np.zeros(m + 8), np.zeros(m + 8)
    for t in range(frames):
        for i in range(m):
            step[t, i] = -g[t, i] if states[t, i] == FREE else 0.0
        if t > 0:
            for i in range(m):
                if states[t, i] == FREE:
                    step[t, i] += coupling[t, i] * z[i]
        _apply(inverses[starts[t] :], states[t], step[t], free, y, z)
    step[frames - 1] = z[:m]
    for t in range(frames - 2, -1, -1):
        for i in range(m):
            if states[t, i] == FREE:
                step[t, i] += coupling[t + 1, i] * step[t + 1, i]
        _apply(inverses[starts[t] :], states[t], step[t], free, y, z)
        step[t] = z[:m]


@njit(fastmath=FAST, error_model="numpy", cache=True)
def _apply(inverse, state, x, free, y, z):
    """z = the packed inverse times the free part of x, 0 elsewhere."""
    k = _list_free(state, free)
    z[:] = 0.0
    for i in range(k):
        y[i] = x[free[i]]
    o = 0
    out = np.zeros(k)
    for i in range(k):
        r, s, yi = inverse[o : o + i], 0.0, y[i]
        for j in range(i):
            s += r[j] * y[j]
            out[j] += r[j] * yi
        out[i] += s + inverse[o + i] * yi
        o += i + 1
    for i in range(k):
        z[free[i]] = out[i]


@njit(error_model="numpy", cache=True)
def _list_free(state, free):
    k = 0
    for i in range(state.size):
        free[k] = i
        k += state[i] == FREE
    free[k : (k + 3) & -4] = state.size
    return k


@njit(parallel=True, error_model="numpy", cache=True)
def flip(lower, upper, states, x, g, tolerance, blocks):
    """Put right the states that x and g contradict, and the unknowns that leave on their bounds; returns how many."""
    frames, m = states.shape
    wrong = 0
    for b in prange(blocks):
        for t in range(b * frames // blocks, (b + 1) * frames // blocks):
            for i in range(m):
                now = states[t, i]
                if now == FREE:
                    if x[t, i] < lower[i]:
                        states[t, i], x[t, i] = LOWER, lower[i]
                    elif x[t, i] > upper[i]:
                        states[t, i], x[t, i] = UPPER, upper[i]
                elif (now == LOWER and g[t, i] < -tolerance[t]) or (now == UPPER and g[t, i] > tolerance[t]):
                    states[t, i] = FREE
                wrong += states[t, i] != now
    return wrong
