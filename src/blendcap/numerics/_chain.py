"""Newton steps of a whole sequence: a block-tridiagonal system over the free unknowns of all frames."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._cholesky import FAST, STRIDE, factor, invert_factor, square_rows
from blendcap.numerics._pivoting import FREE, LOWER, UPPER, pack
from blendcap.numerics._seen import seen_gram, seen_start

FORGOTTEN = 1e-9  # relative change of an inverse that is not passed on to the next frame


@njit(error_model="numpy", cache=True)
def eliminate(box, coupling, states, changed, starts, inverses):
    """Invert the diagonal blocks of the system one frame after the other, each less what the frame before explains.

    The inverse of frame t, packed upper triangle by rows, lies at starts[t] in `inverses`. Only the frames whose
    states have changed are done, and those after them until the change is forgotten.
    """
    gram, _, diagonal, _, _, rows, missing = box
    frames, m = states.shape
    size = (m + 8) * STRIDE
    a, w, v, sign = np.zeros(size), np.zeros(size), np.zeros(size), np.ones(m + 8)
    free, back = np.zeros(m + 8, np.uint32), np.zeros(m + 8, np.uint32)
    place, seen = np.full(m + 1, m + 4, np.uint32), seen_start(gram, missing)
    carry, loaded = False, -1
    for t in range(frames):
        if not (changed[t] or carry):
            continue
        if t > 0 and loaded != t - 1:
            k = pack(states[t - 1], FREE, free)
            unpack(inverses[starts[t - 1] :], k, v)
            put_places(free, k, place)
        k = pack(states[t], FREE, free)
        n = (k + 3) & -4
        for i in range(k):
            back[i] = place[free[i]]
        h, d = seen_gram(seen, gram, rows, missing, t), diagonal[t if len(diagonal) > 1 else 0]
        after = coupling[t + 1 if t + 1 < frames else 0]  # row 0 couples nothing
        block(h, d, coupling[t], after, v, free, back, k, n, a)
        factor(a, n, (n + 8) & -8, sign)
        invert_factor(a, n, w)
        square_rows(w, n, v)
        difference = store(v, k, inverses[starts[t] :])
        carry = changed[t] or difference > FORGOTTEN
        loaded = t
        put_places(free, k, place)


@njit(fastmath=FAST, error_model="numpy", cache=True)
def block(h, d, before, after, v, free, back, k, n, a):
    """Fill a with the free block of one frame less what the inverse v of the frame before explains, padded to n."""
    for i in range(n):
        row, s = h[free[i]], i & -8
        r, columns = a[i * STRIDE + s : i * STRIDE + n], free[s:n]
        for j in range(columns.size):
            r[j] = row[columns[j]]
    for i in range(k, n):
        a[i * STRIDE + i] = 1.0
    none = d.size + 4
    for i in range(k):
        f = free[i]
        a[i * STRIDE + i] += d[f] + before[f] + after[f]
        if back[i] != none:
            r, columns, known = a[i * STRIDE + i : i * STRIDE + k], free[i:k], back[i:k]
            c, u = before[f], v[back[i] * STRIDE : (back[i] + 1) * STRIDE]
            for j in range(columns.size):
                r[j] -= c * before[columns[j]] * u[known[j]]


@njit(error_model="numpy", cache=True)
def put_places(free, k, place):
    """place[i] = the row of unknown i among the k free ones, or that of a row and column of zeros."""
    place[:] = place.size + 3
    for i in range(k):
        place[free[i]] = i


@njit(fastmath=FAST, error_model="numpy", cache=True)
def store(v, k, packed):
    """Pack the upper triangle of v; returns how much it differs from what was there, relative to its diagonal."""
    o, difference, largest = 0, 0.0, 0.0
    for i in range(k):
        u, p = v[i * STRIDE + i : i * STRIDE + k], packed[o : o + k - i]
        largest = max(largest, u[0])
        for j in range(u.size):
            difference = max(difference, abs(p[j] - u[j]))
            p[j] = u[j]
        o += k - i
    return difference / largest if largest > 0 else 0.0


@njit(error_model="numpy", cache=True)
def unpack(packed, k, v):
    o = 0
    for i in range(k):
        v[i * STRIDE + i : i * STRIDE + k] = packed[o : o + k - i]
        o += k - i


@njit(error_model="numpy", cache=True)
def substitute(coupling, states, starts, inverses, g, step):
    """step = the solution of the Newton system with the right-hand side -g; 0 at unknowns on a bound."""
    frames, m = states.shape
    free, y, z, out = np.zeros(m + 8, np.uint32), np.zeros(m), np.zeros(m), np.zeros(m)
    for t in range(frames):
        for i in range(m):
            step[t, i] = coupling[t, i] * out[i] - g[t, i]
        k = pack(states[t], FREE, free)
        apply(inverses[starts[t] :], free, k, step[t], y, z, out)
    step[frames - 1] = out
    for t in range(frames - 2, -1, -1):
        for i in range(m):
            step[t, i] += coupling[t + 1, i] * out[i]
        k = pack(states[t], FREE, free)
        apply(inverses[starts[t] :], free, k, step[t], y, z, out)
        step[t] = out


@njit(fastmath=FAST, error_model="numpy", cache=True)
def apply(packed, free, k, x, y, z, out):
    """out = the packed inverse times the free part of x, 0 elsewhere."""
    for i in range(k):
        y[i] = x[free[i]]
        z[i] = 0.0
    o = 0
    for i in range(k):
        p, u, to, c, total = packed[o : o + k - i], y[i:k], z[i:k], y[i], 0.0
        for j in range(u.size):
            total += p[j] * u[j]
        for j in range(u.size):
            to[j] += p[j] * c
        z[i] += total - p[0] * c
        o += k - i
    out[:] = 0.0
    for i in range(k):
        out[free[i]] = z[i]


@njit(parallel=True, error_model="numpy", cache=True)
def flip(bounds, states, x, g, tolerance, single, changed, count):
    """Put right the states that x and g contradict, and the unknowns that leave on their bounds.

    Returns how many were wrong; `single` changes only the last of every frame. `changed` marks the frames.
    """
    lower, upper = bounds
    frames, m = states.shape
    wrong = 0
    for b in prange(count):
        for t in range(b * frames // count, (b + 1) * frames // count):
            changed[t] = False
            for i in range(m - 1, -1, -1):
                now = states[t, i]
                low, high = now == FREE and x[t, i] < lower[i], now == FREE and x[t, i] > upper[i]
                enter = (now == LOWER and g[t, i] < -tolerance[t]) or (now == UPPER and g[t, i] > tolerance[t])
                if low or high or enter:
                    wrong += 1
                    if not (single and changed[t]):
                        states[t, i] = LOWER if low else (UPPER if high else FREE)
                        x[t, i] = lower[i] if low else (upper[i] if high else x[t, i])
                    changed[t] = True
    return wrong
