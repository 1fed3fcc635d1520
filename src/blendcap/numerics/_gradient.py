"""The gradient of the whole objective, and how far an answer is from the optimum."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._cholesky import FAST
from blendcap.numerics._lanes import (
    PAIR,
    WIDTH,
    bring,
    fill_pair,
    load_pair,
    some,
    spread_pair,
    store,
    where_less,
)
from blendcap.numerics._products import add_products_pair, aligned, panels

UNSEEN = 1e-6  # part of its whole curvature: an unknown that a frame sees less of is not seen there


@njit(parallel=True, error_model="numpy", cache=True)
def gradients(box, coupling, x, g, todo, blocks):
    """g = half the gradient at x, in the frames to do. `coupling` has no rows where frames do not touch."""
    frames, m = x.shape
    width = box[0].shape[1]
    for b in prange(blocks):
        h = np.zeros(width)
        for t in range(b * frames // blocks, (b + 1) * frames // blocks):
            if todo[t]:
                slope(box, coupling, x, t, h)
                for i in range(m):
                    g[t, i] = h[i]


@njit(parallel=True, error_model="numpy", cache=True)
def worst_residuals(box, coupling, curvature, x, worst, blocks):
    """`max_i |x - clip(x - gradient / (2 diag H), lower, upper)|` of each frame, infinite where it is not a number."""
    frames, m = x.shape
    gram, _, diagonal, lower, upper, rows, missing = box
    for b in prange(blocks):
        h, lost = np.zeros(gram.shape[1]), np.zeros(gram.shape[1])
        for t in range(b * frames // blocks, (b + 1) * frames // blocks):
            slope(box, coupling, x, t, h)
            lost_curvature(rows, missing, t, lost)
            d = diagonal[t if len(diagonal) > 1 else 0]
            largest, total = 0.0, 0.0
            for i in range(m):
                full = max(curvature[i], gram[i, i] + d[i])
                stiff = max(full - lost[i], UNSEEN * full)
                if len(coupling):
                    stiff += coupling[t, i] + (coupling[t + 1, i] if t + 1 < frames else 0.0)
                a = x[t, i]
                step = a - min(upper[i], max(lower[i], a - h[i] / stiff))
                largest = max(largest, abs(step))
                total += h[i] + a  # maxima hide a NaN, sums do not
            worst[t] = largest if np.isfinite(total) else np.inf


@njit(fastmath=FAST, error_model="numpy", cache=True)
def lost_curvature(rows, missing, t, lost):
    """lost = what the markers that frame t lacks would add to the diagonal of its Gram matrix."""
    lost[:] = 0.0
    for k in range(missing.shape[1]):
        if missing[t, k]:
            for p in range(rows.shape[1]):
                row = rows[k, p]
                for j in range(lost.size):
                    lost[j] += row[j] * row[j]


@njit(parallel=True, error_model="numpy", cache=True)
def worst_apart(box, curvature, x, worst, blocks):
    """`worst_residuals` of frames that do not touch and see all markers, sixteen at once."""
    frames, columns = len(x), panels(box[0])
    for b in prange(blocks):
        worst_run(box, columns, curvature, x, worst, b * frames // blocks, (b + 1) * frames // blocks)


@njit(error_model="numpy", cache=True)
def worst_run(box, columns, curvature, x, worst, begin, end):
    """The residuals of the frames from begin to end. `columns` holds the panels of the Gram matrix."""
    size = PAIR * box[0].shape[1]
    vectors = aligned(size), aligned(size), aligned(size)
    index = np.zeros(PAIR, np.int64), PAIR * np.arange(WIDTH), np.zeros(size, np.int64)
    result = aligned(PAIR)
    for first in range(begin, end, PAIR):
        worst_pair(box, columns, curvature, x, first, end, vectors, index, result)
        for k in range(min(PAIR, end - first)):
            worst[first + k] = result[k] if np.isfinite(result[k]) else np.inf


@njit(error_model="numpy", cache=True)
def worst_pair(box, columns, curvature, x, begin, end, vectors, index, result):
    """The residuals of sixteen frames; not finite where a number of theirs is not."""
    gram, linear, diagonal, lower, upper, _, _ = box
    a, h, d = vectors
    first, steps, used = index
    m, n = x.shape[1], 0
    for k in range(PAIR):
        first[k] = m * min(begin + k, end - 1)
    bring(x, first, steps, a)
    bring(linear, first, steps, h)
    bring(diagonal, first, steps, d)
    for i in range(m):
        o = PAIR * i
        value = load_pair(a, o)
        store(h, o, load_pair(h, o) + load_pair(d, o) * value)
        used[n] = i
        n += some(value)
    add_products_pair(columns, used[:n], a, h)
    flat, row = gram.ravel(), gram.shape[1] + 1
    zero = fill_pair(0.0)
    largest, total = zero, zero
    for i in range(m):
        o = PAIR * i
        value, slope, bent = load_pair(a, o), load_pair(h, o), spread_pair(flat, i * row) + load_pair(d, o)
        least = spread_pair(curvature, i)
        moved = value - slope / where_less(bent, least, least, bent)
        low, high = spread_pair(lower, i), spread_pair(upper, i)
        moved = where_less(moved, low, low, moved)
        step = value - where_less(high, moved, high, moved)
        step = where_less(step, zero, zero - step, step)
        largest = where_less(largest, step, step, largest)
        total = total + slope + value
    store(result, 0, largest + (total - total))  # maxima hide a NaN, sums do not


@njit(fastmath=FAST, error_model="numpy", cache=True)
def slope(box, coupling, x, t, h):
    """h = half the gradient of frame t; its padding is scratch."""
    gram, linear, diagonal, _, _, rows, missing = box
    frames, m = x.shape
    a, f, d = x[t], linear[t], diagonal[t if len(diagonal) > 1 else 0]
    h[:] = 0.0
    for i in range(m):
        if a[i] != 0:
            row, c = gram[i], a[i]
            for j in range(h.size):
                h[j] += c * row[j]
    for k in range(missing.shape[1]):
        if missing[t, k]:
            for p in range(rows.shape[1]):
                row, c = rows[k, p], 0.0
                for j in range(m):
                    c += row[j] * a[j]
                for j in range(h.size):
                    h[j] -= c * row[j]
    for i in range(m):
        h[i] += f[i] + d[i] * a[i]
    if len(coupling) and t > 0:
        c, other = coupling[t], x[t - 1]
        for i in range(m):
            if c[i] > 0:  # a frame without an answer is NaN, and not coupled
                h[i] += c[i] * (a[i] - other[i])
    if len(coupling) and t + 1 < frames:
        c, other = coupling[t + 1], x[t + 1]
        for i in range(m):
            if c[i] > 0:
                h[i] += c[i] * (a[i] - other[i])


@njit(parallel=True, error_model="numpy", cache=True)
def spans(values, least, most):
    """The least and the largest finite value of every column, for each of as many runs of rows as `least` has."""
    rows, count = len(values), len(least)
    for b in prange(count):
        low, high = least[b], most[b]
        for t in range(b * rows // count, (b + 1) * rows // count):
            row = values[t]
            for i in range(row.size):
                known = row[i] - row[i] == 0
                low[i] = row[i] if known and row[i] < low[i] else low[i]
                high[i] = row[i] if known and row[i] > high[i] else high[i]
