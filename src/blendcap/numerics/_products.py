"""Products of a shared matrix with the vectors of eight frames at once."""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.numerics._lanes import PAIR, WIDTH, load, load_pair, spread, spread_pair, store


@njit(error_model="numpy", cache=True)
def aligned(count):
    """Zeros that begin at a cache line, so that no vector lies across two."""
    memory = np.zeros(count + 8)
    first = (-memory.ctypes.data // 8) % 8
    return memory[first : first + count]


@njit(error_model="numpy", cache=True)
def add_products(panels, used, x, g):
    """`g += gram x`, summed over the unknowns that are used; eight rows share each load of x."""
    flat, rows = panels.ravel(), panels.shape[1]
    for i in range(0, 8 * len(panels), 8):
        o = WIDTH * i
        s0, s1, s2, s3 = load(g, o), load(g, o + 8), load(g, o + 16), load(g, o + 24)
        s4, s5, s6, s7 = load(g, o + 32), load(g, o + 40), load(g, o + 48), load(g, o + 56)
        for j in used:
            v, r = load(x, WIDTH * j), rows * i + 8 * j
            s0, s1 = s0 + spread(flat, r) * v, s1 + spread(flat, r + 1) * v
            s2, s3 = s2 + spread(flat, r + 2) * v, s3 + spread(flat, r + 3) * v
            s4, s5 = s4 + spread(flat, r + 4) * v, s5 + spread(flat, r + 5) * v
            s6, s7 = s6 + spread(flat, r + 6) * v, s7 + spread(flat, r + 7) * v
        store(g, o, s0)
        store(g, o + 8, s1)
        store(g, o + 16, s2)
        store(g, o + 24, s3)
        store(g, o + 32, s4)
        store(g, o + 40, s5)
        store(g, o + 48, s6)
        store(g, o + 56, s7)


@njit(error_model="numpy", cache=True)
def add_products_pair(panels, used, x, g):
    """`add_products` of sixteen frames, which share each number of the matrix."""
    flat, rows = panels.ravel(), panels.shape[1]
    for i in range(0, 8 * len(panels), 8):
        o = PAIR * i
        s0, s1, s2, s3 = load_pair(g, o), load_pair(g, o + 16), load_pair(g, o + 32), load_pair(g, o + 48)
        s4, s5, s6, s7 = load_pair(g, o + 64), load_pair(g, o + 80), load_pair(g, o + 96), load_pair(g, o + 112)
        for j in used:
            v, r = load_pair(x, PAIR * j), rows * i + 8 * j
            s0, s1 = s0 + spread_pair(flat, r) * v, s1 + spread_pair(flat, r + 1) * v
            s2, s3 = s2 + spread_pair(flat, r + 2) * v, s3 + spread_pair(flat, r + 3) * v
            s4, s5 = s4 + spread_pair(flat, r + 4) * v, s5 + spread_pair(flat, r + 5) * v
            s6, s7 = s6 + spread_pair(flat, r + 6) * v, s7 + spread_pair(flat, r + 7) * v
        store(g, o, s0)
        store(g, o + 16, s1)
        store(g, o + 32, s2)
        store(g, o + 48, s3)
        store(g, o + 64, s4)
        store(g, o + 80, s5)
        store(g, o + 96, s6)
        store(g, o + 112, s7)


@njit(error_model="numpy", cache=True)
def panels(gram):
    """(W / 8, N, 8) the columns of a matrix by eights, so that what one pass of `add_products` reads lies together."""
    rows, width = gram.shape
    result = aligned(rows * width).reshape(width // 8, rows, 8)
    for i in range(width):
        for j in range(rows):
            result[i // 8, j, i % 8] = gram[j, i]
    return result
