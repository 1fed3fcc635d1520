"""Small dense Cholesky factors, tiled by hand: the innermost work of the exact solvers.

A work matrix is a flat array whose rows lie STRIDE doubles apart. That is a constant of the compiler, so LLVM sees
that four rows cannot overlap and vectorizes without a run-time test for every pair of rows. It is an odd number of
cache lines, so the rows spread over the whole cache.
"""

from __future__ import annotations

import numpy as np
from numba import njit

STRIDE = 328
# No "nnan" and no "ninf": a NaN must stay visible. The others let LLVM fuse and reorder sums, as vectors need.
FAST = {"contract", "reassoc", "nsz", "arcp"}
TINY = 1e-11  # a pivot of a matrix with unit diagonal is raised to this: a ridge that costs less than the tolerance


@njit(fastmath=FAST, error_model="numpy", cache=True)
def factor(a, n, width, sign):
    """Factor the leading n rows of `a` into U' diag(sign) U in place, four rows at a time; the diagonal stores 1/u_ii.

    `sign` is 1 everywhere for a positive definite matrix; -1 marks the negative definite part of a quasi-definite one
    (Vanderbei 1995, doi:10.1137/0805005), which has such a factor in every order. Columns n..width ride along: a
    right-hand side b kept there becomes y with `U x = y` for the solution x. n is a multiple of 4, width of 8, and a
    row starts at its 8-aligned column, so no scalar remainder loops run. What lands left of the diagonal is never
    read. Pivots below TINY (a singular matrix) are raised to it.
    """
    S = STRIDE
    for i in range(0, n, 4):
        s = i & -8
        o, m = i - s, width - s
        r = a[i * S + s : (i + 3) * S + width]
        for p in range(0, i, 4):  # subtract four finished rows from these four
            b = a[p * S + s : (p + 3) * S + width]
            s0, s1, s2, s3 = sign[p], sign[p + 1], sign[p + 2], sign[p + 3]
            c00, c01, c02, c03 = s0 * b[o], s1 * b[S + o], s2 * b[2 * S + o], s3 * b[3 * S + o]
            c10, c11, c12, c13 = s0 * b[o + 1], s1 * b[S + o + 1], s2 * b[2 * S + o + 1], s3 * b[3 * S + o + 1]
            c20, c21, c22, c23 = s0 * b[o + 2], s1 * b[S + o + 2], s2 * b[2 * S + o + 2], s3 * b[3 * S + o + 2]
            c30, c31, c32, c33 = s0 * b[o + 3], s1 * b[S + o + 3], s2 * b[2 * S + o + 3], s3 * b[3 * S + o + 3]
            for j in range(m):
                b0, b1, b2, b3 = b[j], b[S + j], b[2 * S + j], b[3 * S + j]
                r[j] -= c00 * b0 + c01 * b1 + c02 * b2 + c03 * b3
                r[S + j] -= c10 * b0 + c11 * b1 + c12 * b2 + c13 * b3
                r[2 * S + j] -= c20 * b0 + c21 * b1 + c22 * b2 + c23 * b3
                r[3 * S + j] -= c30 * b0 + c31 * b1 + c32 * b2 + c33 * b3
        s0, s1, s2, s3 = sign[i], sign[i + 1], sign[i + 2], sign[i + 3]  # the 4 x 4 corner, then the rows right of it
        d0 = 1 / np.sqrt(max(s0 * r[o], TINY))
        e0 = s0 * d0
        u01, u02, u03 = r[o + 1] * e0, r[o + 2] * e0, r[o + 3] * e0
        c1, c2, c3 = s0 * u01, s0 * u02, s0 * u03
        d1 = 1 / np.sqrt(max(s1 * (r[S + o + 1] - c1 * u01), TINY))
        e1 = s1 * d1
        u12, u13 = (r[S + o + 2] - c1 * u02) * e1, (r[S + o + 3] - c1 * u03) * e1
        c12, c13 = s1 * u12, s1 * u13
        d2 = 1 / np.sqrt(max(s2 * (r[2 * S + o + 2] - c2 * u02 - c12 * u12), TINY))
        e2 = s2 * d2
        u23 = (r[2 * S + o + 3] - c2 * u03 - c12 * u13) * e2
        c23 = s2 * u23
        d3 = 1 / np.sqrt(max(s3 * (r[3 * S + o + 3] - c3 * u03 - c13 * u13 - c23 * u23), TINY))
        e3 = s3 * d3
        for j in range(m):
            f0 = r[j] * e0
            f1 = (r[S + j] - c1 * f0) * e1
            f2 = (r[2 * S + j] - c2 * f0 - c12 * f1) * e2
            r[j] = f0
            r[S + j] = f1
            r[2 * S + j] = f2
            r[3 * S + j] = (r[3 * S + j] - c3 * f0 - c13 * f1 - c23 * f2) * e3
        r[o], r[S + o + 1], r[2 * S + o + 2], r[3 * S + o + 3] = d0, d1, d2, d3


@njit(fastmath=FAST, error_model="numpy", cache=True)
def back_substitute(a, n, b, step, y):
    """Solve `U y = b` for the factor that `factor` left, with b at every `step`; four rows share each pass over y."""
    S = STRIDE
    for i in range(n - 4, -1, -4):
        r, v = a[i * S + i : (i + 3) * S + n], y[i + 4 : n]
        s0, s1, s2, s3 = b[i * step], b[(i + 1) * step], b[(i + 2) * step], b[(i + 3) * step]
        for j in range(v.size):
            s0 -= r[4 + j] * v[j]
            s1 -= r[S + 4 + j] * v[j]
            s2 -= r[2 * S + 4 + j] * v[j]
            s3 -= r[3 * S + 4 + j] * v[j]
        y3 = s3 * r[3 * S + 3]
        y2 = (s2 - r[2 * S + 3] * y3) * r[2 * S + 2]
        y1 = (s1 - r[S + 3] * y3 - r[S + 2] * y2) * r[S + 1]
        y[i] = (s0 - r[3] * y3 - r[2] * y2 - r[1] * y1) * r[0]
        y[i + 1], y[i + 2], y[i + 3] = y1, y2, y3


@njit(fastmath=FAST, error_model="numpy", cache=True)
def forward_substitute(a, n, w, first):
    """Solve `U' w = w` in place for a w that is 0 before `first`, a multiple of four; four rows share each pass."""
    S = STRIDE
    for i in range(first, n, 4):
        r = a[i * S + i : (i + 3) * S + n]
        w0 = w[i] * r[0]
        w1 = (w[i + 1] - r[1] * w0) * r[S + 1]
        w2 = (w[i + 2] - r[2] * w0 - r[S + 2] * w1) * r[2 * S + 2]
        w3 = (w[i + 3] - r[3] * w0 - r[S + 3] * w1 - r[2 * S + 3] * w2) * r[3 * S + 3]
        w[i], w[i + 1], w[i + 2], w[i + 3] = w0, w1, w2, w3
        v = w[i + 4 : n]
        for j in range(v.size):
            v[j] -= r[4 + j] * w0 + r[S + 4 + j] * w1 + r[2 * S + 4 + j] * w2 + r[3 * S + 4 + j] * w3


@njit(fastmath=FAST, error_model="numpy", cache=True)
def add_rows(g, gram, rows, y):
    """`g += sum_i y_i gram[rows_i]`, four rows at a time: the number of rows is a multiple of four."""
    for i in range(0, rows.size, 4):
        r0, r1, r2, r3 = gram[rows[i]], gram[rows[i + 1]], gram[rows[i + 2]], gram[rows[i + 3]]
        y0, y1, y2, y3 = y[i], y[i + 1], y[i + 2], y[i + 3]
        for j in range(g.size):
            g[j] += y0 * r0[j] + y1 * r1[j] + y2 * r2[j] + y3 * r3[j]


@njit(fastmath=FAST, error_model="numpy", cache=True)
def invert_factor(a, n, w):
    """w = the inverse of the transposed factor in `a`: lower triangular, row by row with the stride of `a`."""
    S = STRIDE
    for i in range(0, n, 4):
        r = w[i * S : (i + 3) * S + i + 8]
        m = i + 4
        for k in range(4):
            r[k * S : k * S + m + 4] = 0.0
        for p in range(0, i, 4):
            b, u = w[p * S : (p + 3) * S + p + 8], a[p * S + i : (p + 3) * S + i + 4]
            c00, c01, c02, c03 = u[0], u[S], u[2 * S], u[3 * S]
            c10, c11, c12, c13 = u[1], u[S + 1], u[2 * S + 1], u[3 * S + 1]
            c20, c21, c22, c23 = u[2], u[S + 2], u[2 * S + 2], u[3 * S + 2]
            c30, c31, c32, c33 = u[3], u[S + 3], u[2 * S + 3], u[3 * S + 3]
            for j in range(p + 4):
                b0, b1, b2, b3 = b[j], b[S + j], b[2 * S + j], b[3 * S + j]
                r[j] -= c00 * b0 + c01 * b1 + c02 * b2 + c03 * b3
                r[S + j] -= c10 * b0 + c11 * b1 + c12 * b2 + c13 * b3
                r[2 * S + j] -= c20 * b0 + c21 * b1 + c22 * b2 + c23 * b3
                r[3 * S + j] -= c30 * b0 + c31 * b1 + c32 * b2 + c33 * b3
        u = a[i * S + i : (i + 3) * S + i + 4]
        d0, d1, d2, d3 = u[0], u[S + 1], u[2 * S + 2], u[3 * S + 3]
        u01, u02, u03, u12, u13, u23 = u[1], u[2], u[3], u[S + 2], u[S + 3], u[2 * S + 3]
        r[i] = r[S + i + 1] = r[2 * S + i + 2] = r[3 * S + i + 3] = 1.0
        for j in range(m):
            e0 = r[j] * d0
            e1 = (r[S + j] - u01 * e0) * d1
            e2 = (r[2 * S + j] - u02 * e0 - u12 * e1) * d2
            r[j] = e0
            r[S + j] = e1
            r[2 * S + j] = e2
            r[3 * S + j] = (r[3 * S + j] - u03 * e0 - u13 * e1 - u23 * e2) * d3


@njit(fastmath=FAST, error_model="numpy", cache=True)
def square_rows(w, n, v):
    """v = w'w for a lower triangular w; only the upper triangle of v is meant to be read."""
    S = STRIDE
    for i in range(0, n, 4):
        s = i & -8
        r = v[i * S + s : (i + 3) * S + n]
        for k in range(4):
            r[k * S : k * S + n - s] = 0.0
        for p in range(i, n, 4):
            b, u = w[p * S + s : (p + 3) * S + p + 8], w[p * S + i : (p + 3) * S + i + 4]
            c00, c01, c02, c03 = u[0], u[S], u[2 * S], u[3 * S]
            c10, c11, c12, c13 = u[1], u[S + 1], u[2 * S + 1], u[3 * S + 1]
            c20, c21, c22, c23 = u[2], u[S + 2], u[2 * S + 2], u[3 * S + 2]
            c30, c31, c32, c33 = u[3], u[S + 3], u[2 * S + 3], u[3 * S + 3]
            for j in range(p + 4 - s):
                b0, b1, b2, b3 = b[j], b[S + j], b[2 * S + j], b[3 * S + j]
                r[j] += c00 * b0 + c01 * b1 + c02 * b2 + c03 * b3
                r[S + j] += c10 * b0 + c11 * b1 + c12 * b2 + c13 * b3
                r[2 * S + j] += c20 * b0 + c21 * b1 + c22 * b2 + c23 * b3
                r[3 * S + j] += c30 * b0 + c31 * b1 + c32 * b2 + c33 * b3


@njit(error_model="numpy", cache=True)
def inverse(matrix):
    """The inverse of a positive definite matrix with a diagonal of about one."""
    m = len(matrix)
    n = (m + 3) & -4
    a, w, v = np.zeros((n + 8) * STRIDE), np.zeros((n + 8) * STRIDE), np.zeros((n + 8) * STRIDE)
    for i in range(n):
        a[i * STRIDE + i] = 1.0
    for i in range(m):
        for j in range(i, m):
            a[i * STRIDE + j] = matrix[i, j]
    factor(a, n, (n + 8) & -8, np.ones(n))
    invert_factor(a, n, w)
    square_rows(w, n, v)
    result = np.empty((m, m))
    for i in range(m):
        for j in range(i, m):
            result[i, j] = result[j, i] = v[i * STRIDE + j]
    return result
