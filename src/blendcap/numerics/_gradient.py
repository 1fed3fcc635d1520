"""The gradient of the whole objective, and how far an answer is from the optimum."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._cholesky import FAST
from blendcap.numerics._lanes import WIDTH, bring, fill, lane_index, load, some, spread, store, where_less
from blendcap.numerics._products import add_products, aligned, panels


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
    gram, _, diagonal, lower, upper, _, _ = box
    for b in prange(blocks):
        h = np.zeros(gram.shape[1])
        for t in range(b * frames // blocks, (b + 1) * frames // blocks):
            slope(box, coupling, x, t, h)
            d = diagonal[t if len(diagonal) > 1 else 0]
            largest, total = 0.0, 0.0
            for i in range(m):
                stiff = max(curvature[i], gram[i, i] + d[i])
                if len(coupling):
                    stiff += coupling[t, i] + (coupling[t + 1, i] if t + 1 < frames else 0.0)
                a = x[t, i]
                step = a - min(upper[i], max(lower[i], a - h[i] / stiff))
                largest = max(largest, abs(step))
                total += h[i] + a  # maxima hide a NaN, sums do not
            worst[t] = largest if np.isfinite(total) else np.inf


@njit(parallel=True, error_model="numpy", cache=True)
def worst_apart(box, curvature, x, worst, blocks):
    """`worst_residuals` of frames that do not touch and see all markers, eight at once."""
    frames, columns = len(x), panels(box[0])
    for b in prange(blocks):
        worst_run(box, columns, curvature, x, worst, b * frames // blocks, (b + 1) * frames // blocks)


@njit(error_model="numpy", cache=True)
def worst_run(box, columns, curvature, x, worst, begin, end):
    """The residuals of the frames from begin to end. `columns` holds the panels of the Gram matrix."""
    width = box[0].shape[1]
    vectors = aligned(WIDTH * width), aligned(WIDTH * width), aligned(WIDTH * width), np.zeros(width, np.int64)
    index = np.zeros(WIDTH, np.int64), lane_index(width)
    result = aligned(WIDTH)
    for first in range(begin, end, WIDTH):
        worst_eight(box, columns, curvature, x, first, end, vectors, index, result)
        for k in range(min(WIDTH, end - first)):
            worst[first + k] = result[k] if np.isfinite(result[k]) else np.inf


@njit(error_model="numpy", cache=True)
def worst_eight(box, columns, curvature, x, begin, end, vectors, index, result):
    """The residuals of eight frames; not finite where a number of theirs is not."""
    gram, linear, diagonal, lower, upper, _, _ = box
    a, h, d, used = vectors
    first, each = index
    m = x.shape[1]
    for k in range(WIDTH):
        first[k] = m * min(begin + k, end - 1)
    bring(x, first, each, a)
    bring(linear, first, each, h)
    bring(diagonal, first, each, d)
    for i in range(m):
        o = WIDTH * i
        store(h, o, load(h, o) + load(d, o) * load(a, o))
    n = 0
    for i in range(m):
        used[n] = i
        n += some(load(a, WIDTH * i))
    add_products(columns, used[:n], a, h)
    flat, row = gram.ravel(), gram.shape[1] + 1
    zero = fill(0.0)
    largest, total = zero, zero
    for i in range(m):
        value, slope, bent = load(a, WIDTH * i), load(h, WIDTH * i), spread(flat, i * row) + load(d, WIDTH * i)
        least = spread(curvature, i)
        moved = value - slope / where_less(bent, least, least, bent)
        low, high = spread(lower, i), spread(upper, i)
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
