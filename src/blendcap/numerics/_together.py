"""Block principal pivoting of eight frames at once, one in each lane of the vectors; see `_pivoting` for the method.

Every round factors anew. Frames that are done leave, the others close ranks. The few that take very many rounds, and
those whose free block is singular, are left to the methods that do one frame at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.numerics._eight import eliminate, substitute_back
from blendcap.numerics._lanes import WIDTH, bring, fill, gather, load, put, some, spread, store, where_less
from blendcap.numerics._pivoting import FREE, SOLVED
from blendcap.numerics._products import add_products, aligned

MOST = 8  # rounds before a frame is left to them


@njit(error_model="numpy", cache=True)
def settle(box, columns, states, todo, answers, rounds):
    """Solve the frames to do from their states, eight after eight, in rounds: each does those that are still wrong.

    Those that do not end within MOST rounds stay to do. `columns` holds the panels of the Gram matrix.
    """
    gram, lower, upper, m = box[0], box[3], box[4], answers.shape[1]
    mine, eight = np.flatnonzero(todo), np.empty(WIDTH, np.int64)
    vectors, free, work = workspace_eight(m, gram.shape[1])
    index = np.zeros(WIDTH, np.int64), WIDTH * np.arange(WIDTH), np.zeros(WIDTH, np.int64)
    count, order, starts = mine.size, np.empty(mine.size, np.int64), np.empty(m + 2, np.int64)
    for r in range(1, MOST + 1):
        left = 0
        sort(mine[:count], states, order, starts)
        for group in range(0, count, WIDTH):
            for k in range(WIDTH):
                eight[k] = order[min(group + k, count - 1)]
            n = take_up(eight, box, states, vectors, free, index)
            solve(gram.ravel(), columns, lower, upper, vectors, free, n, work)
            judge_eight(lower, upper, vectors, work)
            put(vectors[3], index[1], answers, index[0])
            for k in range(min(WIDTH, count - group)):
                t = eight[k]
                rounds[t] = r
                if settled(k, vectors, work, states[t]):
                    todo[t] = False
                else:
                    mine[left] = t
                    left += 1
        count = left


@njit(error_model="numpy", cache=True)
def sort(mine, states, order, starts):
    """`order` becomes the frames in the order of how many of their unknowns are free: lanes wait for the slowest."""
    starts[:] = 0
    for t in mine:
        n = 1
        for i in range(states.shape[1]):
            n += states[t, i] == FREE
        starts[n] += 1
    for n in range(starts.size - 1):
        starts[n + 1] += starts[n]
    for t in mine:
        n = 0
        for i in range(states.shape[1]):
            n += states[t, i] == FREE
        order[starts[n]] = t
        starts[n] += 1


@njit(error_model="numpy", cache=True)
def workspace_eight(m, width):
    """Of one thread: vectors of eight frames; lists of their free unknowns; a factor, a right-hand side, verdicts."""
    size, most = WIDTH * width, (m + 3) // 4
    vectors = aligned(size), aligned(size), aligned(size), aligned(size), aligned(size), aligned(size)
    d = vectors[1]
    for k in range(WIDTH):
        d[WIDTH * m + k] = 1.0  # of the unknown that pads
    rows, columns, spots, none = np.zeros((4, WIDTH * (m + 4)), np.int64)
    work = aligned(64 * most * (most + 1)), aligned(WIDTH * (m + 4)), np.zeros(width, np.int64), aligned(2 * WIDTH)
    return vectors, (rows, columns, spots, none), work


@njit(error_model="numpy", cache=True)
def take_up(eight, box, states, vectors, free, index):
    """Bring eight frames into the lanes and list their free unknowns; returns the length of the longest list.

    The lists hold the offsets of rows of gram, of its columns, and of vectors; shorter ones are padded by an unknown
    that stands alone. The longest is padded to a multiple of four.
    """
    gram, linear, diagonal, _, _, _, _ = box
    q, d, s, _, _, _ = vectors
    rows, columns, spots, _ = free
    first, steps, counts = index
    m, most = linear.shape[1], 0
    for k in range(WIDTH):
        n, now = 0, states[eight[k]]
        for i in range(m):
            s[WIDTH * i + k] = now[i]
            columns[WIDTH * n + k] = i
            n += now[i] == FREE
        first[k], counts[k] = m * eight[k], n
        most = max(most, n)
    most = (most + 3) & -4
    for k in range(WIDTH):
        for i in range(counts[k], most):
            columns[WIDTH * i + k] = m
    for o in range(WIDTH * most):
        rows[o] = gram.shape[1] * columns[o]
        spots[o] = WIDTH * columns[o] + o % WIDTH
    bring(linear, first, steps, q)
    bring(diagonal, first, steps, d)
    return most


@njit(error_model="numpy", cache=True)
def solve(gram, panels, lower, upper, vectors, free, n, work):
    """x and g, half the gradient, of the states, the free unknowns at their optimum."""
    q, d, s, x, g, z = vectors
    a, y, used, _ = work
    _, _, spots, none = free
    m, count = lower.size, 0
    for i in range(m):
        o = WIDTH * i
        state = load(s, o)
        value = where_less(state, fill(0.5), spread(lower, i), fill(0.0))
        value = where_less(fill(1.5), state, spread(upper, i), value)
        store(x, o, value)
        store(z, o, fill(0.0))
        store(g, o, load(q, o) + load(d, o) * value)
        used[count] = i
        count += some(value)
    add_products(panels, used[:count], x, g)
    for o in range(0, WIDTH * n, WIDTH):
        store(y, o, fill(0.0) - gather(g, spots, o, none, 0))
    eliminate(gram, free, n, d, a, y)
    substitute_back(a, y, n)
    for o in range(WIDTH * n):
        z[spots[o]] = y[o]
    count = 0
    for i in range(m):
        o = WIDTH * i
        value = load(z, o)
        store(x, o, load(x, o) + value)
        store(g, o, load(g, o) + load(d, o) * value)
        used[count] = i
        count += some(value)
    add_products(panels, used[:count], z, g)


@njit(error_model="numpy", cache=True)
def settled(k, vectors, work, state):
    """Whether the answer of lane k is the optimum; else its state becomes what the answer asks for."""
    following, verdicts = vectors[5], work[3]
    if verdicts[k] == 0 and verdicts[WIDTH + k] == 0:
        return True
    for i in range(state.size):
        state[i] = np.int8(following[WIDTH * i + k])
    return False


@njit(error_model="numpy", cache=True)
def judge_eight(lower, upper, vectors, work):
    """The states that x and g ask for replace z; how many differ, and whether the gradient is not zero where free."""
    q, _, s, x, g, following = vectors
    zero, one, two = fill(0.0), fill(1.0), fill(2.0)
    size = one
    for i in range(lower.size):
        f = load(q, WIDTH * i)
        f = where_less(f, zero, zero - f, f)
        size = where_less(size, f, f, size)
    tolerance, solved = size * fill(1e-13), size * fill(SOLVED)
    differ, steep = zero, zero
    for i in range(lower.size):
        o = WIDTH * i
        state, slope, value = load(s, o), load(g, o), load(x, o)
        free = where_less(value, spread(lower, i), zero, where_less(spread(upper, i), value, two, one))
        low = where_less(slope, zero - tolerance, one, zero)
        high = where_less(tolerance, slope, one, two)
        new = where_less(state, fill(0.5), low, where_less(fill(1.5), state, high, free))
        store(following, o, new)
        differ = differ + (new - state) * (new - state)
        steep = steep + where_less((state - one) * (state - one), fill(0.5), slope * slope, zero)
    store(work[3], 0, differ)
    store(work[3], WIDTH, where_less(steep, solved * solved, zero, one))  # also where it is not a number
