"""A cheap guess of which unknowns of which frame sit on a bound, from a few steps of ADMM in single precision."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._boxproblem import BoxProblem, blocks
from blendcap.numerics._cholesky import inverse
from blendcap.numerics._lanes import (
    PAIR,
    WIDE,
    WIDTH,
    bring,
    fill,
    fill_pair,
    load,
    load_pair,
    spread,
    spread_pair,
    store,
    store_singles,
    where_less,
)
from blendcap.numerics._products import add_products_pair, aligned, panels

STEPS = 12
MANY = 256  # frames that a run should have at least, to fill the lanes
PENALTY, POWER = 0.7, 0.6
RELAXATION = 1.9


@njit(error_model="numpy", cache=True)
def aligned_singles(count):
    """Zeros that begin at a cache line, so that no vector lies across two."""
    memory = np.zeros(count + 16, np.float32)
    first = (-memory.ctypes.data // 4) % 16
    return memory[first : first + count]


@njit(parallel=True, error_model="numpy", cache=True)
def guess_all(linear, diagonal, guess, states, count):
    """Guess the states of all frames, run by run."""
    frames = len(linear)
    for b in prange(count):
        first, last = b * frames // count, (b + 1) * frames // count
        d = diagonal[first:last] if len(diagonal) > 1 else diagonal
        guess_run(linear[first:last], d, guess, states[first:last])


@njit(error_model="numpy", cache=True)
def guess_run(linear, diagonal, guess, states):
    """Over-relaxed ADMM, thirty-two frames at a time.

    With p the product of `matrix`, the relaxed inverse, with w, and c the relaxed answer without bounds, a step of it
    is `h <- h + p - c - relaxation z`, where z is h clipped, and `w <- r (2 z - h)`.
    """
    inverse, matrix, most, lower, upper = guess
    frames, m = linear.shape
    size = WIDE * 8 * len(matrix)
    c, r, h = aligned_singles(size), aligned_singles(size), aligned_singles(size)
    w, v = aligned_singles(size), aligned_singles(size)
    doubles = aligned(PAIR * 8 * len(matrix)), aligned(PAIR * 8 * len(matrix))
    index = np.zeros(PAIR, np.int64), PAIR * np.arange(WIDTH), np.arange(m)
    for first in range(0, frames, WIDE):
        for k in range(0, WIDE, PAIR):
            begin(linear, diagonal, inverse, most, first, k, (c, r), doubles, index)
        for i in range(m):
            o = WIDE * i
            z = clip(fill(np.float32(-1 / RELAXATION)) * load(c, o), spread(lower, i), spread(upper, i))
            store(h, o, z)
            store(w, o, load(r, o) * z)
        for _ in range(STEPS // 2):
            step(matrix, lower, upper, (c, r, h), w, v)
            step(matrix, lower, upper, (c, r, h), v, w)
        for k in range(min(WIDE, frames - first)):
            state = states[first + k]
            for i in range(m):
                z = h[WIDE * i + k]
                state[i] = np.int8(z > lower[i]) + np.int8(z >= upper[i])


@njit(error_model="numpy", cache=True)
def begin(linear, diagonal, inverse, most, first, k, vectors, doubles, index):
    """Sixteen frames: their regularised answers without bounds, in double precision, and penalties; kept as singles."""
    c, r = vectors
    q, u = doubles
    rows, steps, every = index
    frames, m = linear.shape
    for t in range(PAIR):
        rows[t] = m * min(first + k + t, frames - 1)
    bring(linear, rows, steps, q)
    u[:] = 0.0
    add_products_pair(inverse, every, q, u)
    bring(diagonal, rows, steps, q)
    for i in range(m):
        store_singles(c, WIDE * i + k, fill_pair(RELAXATION) * load_pair(u, PAIR * i))
        store_singles(r, WIDE * i + k, spread_pair(most, i) - load_pair(q, PAIR * i))


@njit(error_model="numpy", inline="always")
def clip(value, low, high):
    value = where_less(value, low, low, value)
    return where_less(high, value, high, value)


@njit(error_model="numpy", cache=True)
def step(matrix, lower, upper, vectors, w, v):
    """One step of all unknowns, eight at a time: from w to the v of the next step."""
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
    """The new h and v of one unknown."""
    c, r, h = vectors
    o = WIDE * i
    low, high, old = spread(lower, i), spread(upper, i), load(h, o)
    new = old + (product - load(c, o)) - fill(np.float32(RELAXATION)) * clip(old, low, high)
    z = clip(new, low, high)
    store(h, o, new)
    store(v, o, load(r, o) * (z + z - new))


NO_GUESS = np.zeros((0, 0, 8)), np.zeros((0, 0, 8), np.float32), np.zeros(0), *np.zeros((2, 0), np.float32)


class Guesser:
    """Guesses for the frames of one scaled problem, whose diagonals lie between `least` and `most`.

    The penalty of an unknown is a power of its curvature once the others may follow, `1 / (G^-1)_ii`: that puts
    near-collinear unknowns on the scale of what tells them apart, and needs a third of the steps of a constant. It is
    no more than the curvature once the most similar one may follow: the two directions of one motion would take long
    to agree which of them is free. A frame's own diagonal is absorbed in its penalty: all frames share one inverse.
    """

    def __init__(self, gram: np.ndarray, span: tuple[np.ndarray, np.ndarray], lower: np.ndarray, upper: np.ndarray):
        n, ridge = len(gram), 1e-10  # a singular matrix must not stop a guess
        least = gram + np.diag(span[0] + ridge)
        scale = np.sqrt(np.diag(least))
        alike = np.abs(least / np.outer(scale, scale)) - np.eye(n)
        penalty = np.minimum(PENALTY / np.diag(inverse(least)) ** POWER, scale**2 * (1 - alike.max(1) ** 2))
        most = span[1] + ridge + penalty
        whole = np.zeros((n, (n + 7) & -8))  # rows as long as whole passes of `step`
        whole[:, :n] = inverse(gram + np.diag(most))
        columns = panels(whole)
        singles = aligned_singles(columns.size).reshape(columns.shape)
        singles[:] = RELAXATION * columns
        bounds = [np.pad(bound, (0, whole.shape[1] - n)).astype(np.float32) for bound in (lower, upper)]
        self.arrays = columns, singles, most, *bounds

    def states(self, problem: BoxProblem) -> np.ndarray:
        """(T, N) int8 guessed states of all frames of the problem, or of some of them."""
        states = np.empty(problem.linear.shape, np.int8)
        guess_all(problem.linear, problem.diagonal, self.arrays, states, blocks(len(states), MANY))
        return states
