"""A cheap guess of which unknowns of which frame sit on a bound, from a few steps of ADMM in single precision."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._boxproblem import BoxProblem, blocks
from blendcap.numerics._lanes import WIDE, fill, load, spread, store, where_less

STEPS = 12
MANY = 256  # frames that a run should have at least, to fill the lanes
PENALTY, POWER = 0.7, 0.6
RELAXATION = np.float32(1.9)
LESS = np.float32(1) - RELAXATION


@njit(error_model="numpy", cache=True)
def aligned_singles(count):
    """Zeros that begin at a cache line, so that no vector lies across two."""
    memory = np.zeros(count + 16, np.float32)
    first = (-memory.ctypes.data // 4) % 16
    return memory[first : first + count]


@njit(parallel=True, error_model="numpy", cache=True)
def guess_all(unbound, diagonal, matrix, single, states, steps, count):
    """Over-relaxed ADMM, thirty-two frames at a time. `unbound` is minus their regularised answers without bounds."""
    frames = len(unbound)
    size = WIDE * 8 * len(matrix)
    for b in prange(count):
        c, r, x, u = aligned_singles(size), aligned_singles(size), aligned_singles(size), aligned_singles(size)
        w, v = aligned_singles(size), aligned_singles(size)
        end = (b + 1) * frames // count
        for first in range(b * frames // count, end, WIDE):
            begin(unbound, diagonal, single, first, end, (c, r, x, u, w))
            for _ in range(steps // 2):
                step(matrix, single, (c, r, x, u), w, v)
                step(matrix, single, (c, r, x, u), v, w)
            finish(single, x, states, first, min(first + WIDE, end))


@njit(error_model="numpy", cache=True)
def begin(unbound, diagonal, single, first, end, vectors):
    """Bring thirty-two frames into the lanes; begin with the unbound answer, clipped."""
    most, lower, upper = single
    c, r, x, u, w = vectors
    m = unbound.shape[1]
    for k in range(WIDE):
        t = min(first + k, end - 1)
        f, d = unbound[t], diagonal[t if len(diagonal) > 1 else 0]
        for i in range(m):
            c[WIDE * i + k] = f[i]
        if len(diagonal) > 1:
            for i in range(m):
                r[WIDE * i + k] = most[i] - d[i]
    for i in range(m):
        o = WIDE * i
        if len(diagonal) == 1:
            store(r, o, fill(np.float32(most[i] - diagonal[0, i])))
        value = fill(np.float32(0)) - load(c, o)
        value = clip(value, spread(lower, i), spread(upper, i))
        store(x, o, value)
        store(u, o, fill(np.float32(0)))
        store(w, o, load(r, o) * value)


@njit(error_model="numpy", inline="always")
def clip(value, low, high):
    value = where_less(value, low, low, value)
    return where_less(high, value, high, value)


@njit(error_model="numpy", cache=True)
def step(matrix, single, vectors, w, v):
    """One step of all unknowns, eight at a time: from w to the v of the next step."""
    _, lower, upper = single
    passes, m, _ = matrix.shape
    flat = matrix.ravel()
    zero = fill(np.float32(0))
    for i in range(0, 8 * passes, 8):
        s0, s1, s2, s3, s4, s5, s6, s7 = zero, zero, zero, zero, zero, zero, zero, zero
        for j in range(m):
            p, o = load(w, WIDE * j), m * i + 8 * j
            s0, s1, s2, s3 = (
                s0 + spread(flat, o) * p, s1 + spread(flat, o + 1) * p,
                s2 + spread(flat, o + 2) * p, s3 + spread(flat, o + 3) * p,
            )  # fmt: skip
            s4, s5, s6, s7 = (
                s4 + spread(flat, o + 4) * p, s5 + spread(flat, o + 5) * p,
                s6 + spread(flat, o + 6) * p, s7 + spread(flat, o + 7) * p,
            )  # fmt: skip
        relax(vectors, lower, upper, i, s0, v)
        relax(vectors, lower, upper, i + 1, s1, v)
        relax(vectors, lower, upper, i + 2, s2, v)
        relax(vectors, lower, upper, i + 3, s3, v)
        relax(vectors, lower, upper, i + 4, s4, v)
        relax(vectors, lower, upper, i + 5, s5, v)
        relax(vectors, lower, upper, i + 6, s6, v)
        relax(vectors, lower, upper, i + 7, s7, v)


@njit(error_model="numpy", inline="always")
def relax(vectors, lower, upper, i, product, v):
    """Over-relax and clip one unknown."""
    c, r, x, u = vectors
    o = WIDE * i
    h = fill(RELAXATION) * (product - load(c, o)) + fill(LESS) * load(x, o) + load(u, o)
    z = clip(h, spread(lower, i), spread(upper, i))
    store(x, o, z)
    store(u, o, h - z)
    store(v, o, load(r, o) * (z + z - h))


@njit(error_model="numpy", cache=True)
def finish(single, x, states, first, last):
    """The states of the frames from first to last."""
    _, lower, upper = single
    for k in range(last - first):
        for i in range(states.shape[1]):
            z = x[WIDE * i + k]
            states[first + k, i] = np.int8(z > lower[i]) + np.int8(z >= upper[i])


class Guesser:
    """Guesses for the frames of one scaled problem.

    The penalty of an unknown is a power of its curvature once the others may follow, `1 / (G^-1)_ii`: that puts
    near-collinear unknowns on the scale of what tells them apart, and needs a third of the steps of a constant. It is
    no more than the curvature once the most similar one may follow: the two directions of one motion would take long
    to agree which of them is free. A frame's own diagonal is absorbed in its penalty: all frames share one inverse.
    """

    def __init__(self, problem: BoxProblem):
        gram, diagonal = problem.gram, problem.diagonal
        n, ridge = len(gram), 1e-10  # a singular matrix must not stop a guess
        least = gram + np.diag(diagonal.min(0) + ridge)
        scale = np.sqrt(np.diag(least))
        alike = np.abs(least / np.outer(scale, scale)) - np.eye(n)
        penalty = np.minimum(PENALTY / np.diag(np.linalg.inv(least)) ** POWER, scale**2 * (1 - alike.max(1) ** 2))
        most = diagonal.max(0) + ridge + penalty
        self.inverse = np.linalg.inv(gram + np.diag(most))
        width = (n + 7) & -8
        self.matrix = aligned_singles(width * n).reshape(width // 8, n, 8)  # what a pass of `step` reads lies together
        self.matrix[:] = np.pad(self.inverse, ((0, 0), (0, width - n))).reshape(n, width // 8, 8).swapaxes(0, 1)
        self.single = tuple(np.pad(v, (0, width - n)).astype(np.float32) for v in (most, problem.lower, problem.upper))

    def states(self, problem: BoxProblem) -> np.ndarray:
        """(T, N) int8 guessed states of all frames of the problem, or of some of them."""
        states = np.empty(problem.linear.shape, np.int8)
        count = blocks(len(states), MANY)
        guess_all(problem.linear @ self.inverse, problem.diagonal, self.matrix, self.single, states, STEPS, count)
        return states
