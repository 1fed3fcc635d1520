"""A cheap guess of which unknowns of which frame sit on a bound, from a few steps of ADMM in single precision."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._cholesky import FAST, STRIDE

STEPS = 6
PENALTY = 2.5
RELAXATION = np.float32(1.8)


@njit(fastmath=FAST, error_model="numpy", cache=True)
def multiply(w, matrix, v, n, width):
    """v = w matrix for four frames at once, tiled like `factor`; no BLAS, whose own threads would meet prange's."""
    S = STRIDE
    v[:] = 0
    for p in range(0, n, 4):
        b = matrix[p * S : (p + 3) * S + width]
        c00, c01, c02, c03 = w[p], w[p + 1], w[p + 2], w[p + 3]
        c10, c11, c12, c13 = w[S + p], w[S + p + 1], w[S + p + 2], w[S + p + 3]
        c20, c21, c22, c23 = w[2 * S + p], w[2 * S + p + 1], w[2 * S + p + 2], w[2 * S + p + 3]
        c30, c31, c32, c33 = w[3 * S + p], w[3 * S + p + 1], w[3 * S + p + 2], w[3 * S + p + 3]
        for j in range(width):
            b0, b1, b2, b3 = b[j], b[S + j], b[2 * S + j], b[3 * S + j]
            v[j] += c00 * b0 + c01 * b1 + c02 * b2 + c03 * b3
            v[S + j] += c10 * b0 + c11 * b1 + c12 * b2 + c13 * b3
            v[2 * S + j] += c20 * b0 + c21 * b1 + c22 * b2 + c23 * b3
            v[3 * S + j] += c30 * b0 + c31 * b1 + c32 * b2 + c33 * b3


@njit(parallel=True, fastmath=FAST, error_model="numpy", cache=True)
def guess_all(unbound, matrix, single, states, blocks):
    """Over-relaxed ADMM, four frames at a time."""
    penalty, slack, lower, upper = single
    frames, m = unbound.shape
    one, relax = np.float32(1), RELAXATION
    width = (m + 15) & -16
    for b in prange(blocks):
        x, u, v = np.zeros(4 * STRIDE, np.float32), np.zeros(4 * STRIDE, np.float32), np.zeros(4 * STRIDE, np.float32)
        w, c, r = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
        end = (b + 1) * frames // blocks
        for first in range(b * frames // blocks, end, 4):
            for k in range(4):
                t = min(first + k, end - 1)
                for i in range(m):
                    j = k * STRIDE + i
                    c[j] = unbound[t, i]
                    r[j] = penalty[i] + slack[t if len(slack) > 1 else 0, i]
                    x[j] = min(upper[i], max(lower[i], -c[j]))
                    u[j] = 0
                    w[j] = r[j] * x[j]
            for _ in range(STEPS):
                multiply(w, matrix, v, (m + 3) & -4, width)
                for k in range(4):
                    o = k * STRIDE
                    cc, xx, uu, vv, ww, rr = (
                        c[o : o + m], x[o : o + m], u[o : o + m], v[o : o + m], w[o : o + m], r[o : o + m],
                    )  # fmt: skip
                    for i in range(m):
                        h = relax * (vv[i] - cc[i]) + (one - relax) * xx[i] + uu[i]
                        z = min(upper[i], max(lower[i], h))
                        xx[i] = z
                        uu[i] = h - z
                        ww[i] = rr[i] * (z + z - h)
            for k in range(min(4, end - first)):
                for i in range(m):
                    z = x[k * STRIDE + i]
                    states[first + k, i] = np.int8(z > lower[i]) + np.int8(z >= upper[i])


def guess_states(gram, diagonal, linear, lower, upper, blocks):
    """(T, N) int8 guessed states of all frames.

    The penalty of an unknown is a multiple of its curvature once the others may follow, `1 / (G^-1)_ii`: that puts
    near-collinear unknowns (the two directions of a motion) on the scale of what tells them apart, and needs a third
    of the steps of a constant. A frame's own diagonal is absorbed in its penalty: all frames share one inverse.
    """
    m = len(lower)
    top = diagonal.max(0)
    shared = gram + np.diag(top + 1e-10)  # a singular matrix must not stop a guess
    penalty = PENALTY / np.diag(np.linalg.inv(shared))
    inverse = np.linalg.inv(shared + np.diag(penalty))
    matrix = np.zeros((m + 8, STRIDE), np.float32)
    matrix[:m, :m] = inverse
    states = np.empty(linear.shape, np.int8)
    single = tuple(np.asarray(v, np.float32) for v in (penalty, top - diagonal, lower, upper))
    guess_all(linear @ inverse, matrix.ravel(), single, states, blocks)  # in double: linear is large and cancels
    return states
