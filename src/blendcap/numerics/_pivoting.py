"""Block principal pivoting: the exact optimum of one frame from a guess of which unknowns sit on a bound.

Every round solves for the free unknowns, the others on their bounds, and flips each state whose value is outside its
bounds or whose gradient has the wrong sign (Portugal, Judice and Vicente 1994, doi:10.2307/2153286). The first round
factors the free block. The next ones change few states, so they keep that factor and border it: an unknown that
joins or leaves the free ones adds a row to a small quasi-definite system (Gill, Murray, Saunders and Wright 1990,
the Schur-complement method).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.numerics._cholesky import FAST, STRIDE, add_rows, back_substitute, factor, forward_substitute

LOWER, FREE, UPPER = 0, 1, 2
PATIENCE = 3  # rounds without fewer wrong states before one state at a time is changed
SOLVED = 1e-10  # of the linear term: a gradient below it is zero
BORDER = 16  # changed states that a factor is kept for


@njit(error_model="numpy", cache=True)
def workspace(m):
    """Scratch arrays of one thread: a factor, a border and its factor, vectors, indices, states, signs."""
    most = m + 8
    matrices = (
        np.zeros(most * STRIDE),
        np.zeros((BORDER + 4) * STRIDE),
        np.zeros((BORDER + 4) * STRIDE),
        np.zeros((BORDER, BORDER)),
    )
    vectors = np.zeros(most), np.zeros(most), np.zeros(m), np.zeros((m + 8) & -8)
    indices = np.zeros(most, np.uint32), np.zeros(BORDER + 4, np.uint32), np.zeros(most, np.int64)
    return (
        matrices,
        vectors,
        indices,
        (np.zeros(m, np.int8), np.zeros(m, np.int8)),
        (np.ones(most), np.ones(BORDER + 4)),
    )


@njit(fastmath=FAST, error_model="numpy", cache=True)
def pivot(gram, diagonal, linear, lower, upper, state, x, g, work, most):
    """Solve one frame exactly; returns the rounds it took, or -1 if `most` were not enough or the matrix is singular.

    `gram` has a zero last row, and zero columns up to the length of g, which becomes half the gradient at x.
    """
    following = work[3][0]
    tolerance = 1e-13 * size(linear)
    memory = (np.int64(state.size + 1), np.int64(PATIENCE))
    kept = False
    for rounds in range(1, most + 1):
        fresh = not kept
        if kept:
            kept = solve_bordered(gram, diagonal, lower, upper, state, x, g, work)
        if not kept:
            solve_fresh(gram, diagonal, linear, lower, upper, state, x, g, work)
            kept = fresh = True
        wrong = judge(lower, upper, state, x, g, tolerance, following)
        if wrong == 0 and fresh:
            return rounds if flat(state, g, SOLVED * size(linear)) else -1
        if wrong == 0:
            evaluate(gram, diagonal, linear, x, g)
            if (
                flat(state, g, 0.1 * SOLVED * size(linear))
                and judge(lower, upper, state, x, g, tolerance, following) == 0
            ):
                return rounds
            kept = False
            continue
        memory = advance(state, following, wrong, memory)
    return -1


@njit(fastmath=FAST, error_model="numpy", inline="always")
def solve_fresh(gram, diagonal, linear, lower, upper, state, x, g, work):
    """x and g of the given states, by a factor of the free block that stays in `work` for `solve_bordered`."""
    (a, _, _, _), (y, _, x0, g0), (free, _, slot), (_, state0), (one, _) = work
    k = pack(state, FREE, free)
    for i in range(x.size):
        x[i] = 0.0 if state[i] == FREE else (lower[i] if state[i] == LOWER else upper[i])
        g[i] = linear[i] + diagonal[i] * x[i]
        slot[i] = -1
    g[x.size :] = 0.0
    for i in range(x.size):
        if x[i] != 0:
            row = gram[i]
            for j in range(g.size):
                g[j] += x[i] * row[j]
    n = (k + 3) & -4
    width = (n + 8) & -8
    gather(gram, diagonal, free, k, n, width, a)
    for i in range(k):
        a[i * STRIDE + n] = -g[free[i]]
    factor(a, n, width, one)
    back_substitute(a, n, a[n:], np.int64(STRIDE), y)
    add_rows(g, gram, free[:n], y)
    for i in range(k):
        x[free[i]] = y[i]
        g[free[i]] += diagonal[free[i]] * y[i]
    copy(state, state0)
    copy(x, x0)
    copy(g, g0)
    slot[x.size] = k
    slot[x.size + 1] = 0


@njit(fastmath=FAST, error_model="numpy", inline="always")
def solve_bordered(gram, diagonal, lower, upper, state, x, g, work):
    """x and g of the given states from the last fresh solve x0, g0; False where they differ from its by too much.

    With z the moves of the unknowns that joined the free ones F and the (negated) multipliers of those that left,
    the others move by `-K^-1 C z`, where K is the free block and C holds the columns of `gram` of those that joined
    and minus unit vectors for those that left. The Schur complement of K is the matrix of z.
    """
    (a, border, s, dots), (y, push, x0, g0), (free, changed, slot), (_, state0), (_, sign) = work
    m = x.size
    k, slots = slot[m], slot[m + 1]
    n = (k + 3) & -4
    p = 0
    for i in range(m):
        if state[i] != state0[i]:
            if p == BORDER or (state[i] != FREE and state0[i] != FREE):
                return False
            changed[p] = i
            p += 1
    for i in range(p):
        j = changed[i]
        if slot[j] < 0:
            if slots == BORDER:
                return False
            slot[j] = slots
            w = border[slots * STRIDE : slots * STRIDE + n]
            fill_border(gram, free, k, n, j, state0[j] == FREE, a, w)
            for e in range(slots + 1):
                u, total = border[e * STRIDE : e * STRIDE + n], 0.0
                for r in range(n):
                    total += u[r] * w[r]
                dots[e, slots] = dots[slots, e] = total
            slots += 1
    slot[m + 1] = slots
    q = (p + 3) & -4
    changed[p:q] = m
    complement(gram, diagonal, lower, upper, state, state0, x0, g0, changed, slot, p, q, dots, s, sign)
    factor(s, q, (q + 8) & -8, sign)
    back_substitute(s, q, s[q:], np.int64(STRIDE), y)
    copy(g0, g)
    copy(x0, x)
    push[:n] = 0.0
    for i in range(p):
        j = changed[i]
        b = border[slot[j] * STRIDE : slot[j] * STRIDE + n]
        for r in range(n):
            push[r] -= y[i] * b[r]
        if state0[j] == FREE:
            continue
        x[j] += y[i]
        row = gram[j]
        for c in range(g.size):
            g[c] += y[i] * row[c]
        g[j] += diagonal[j] * y[i]
    back_substitute(a, n, push, np.int64(1), y)
    add_rows(g, gram, free[:n], y)
    for i in range(k):
        x[free[i]] += y[i]
        g[free[i]] += diagonal[free[i]] * y[i]
    for i in range(p):
        j = changed[i]
        if state[j] != FREE:
            x[j] = lower[j] if state[j] == LOWER else upper[j]
    return True


@njit(fastmath=FAST, error_model="numpy", inline="always")
def fill_border(gram, free, k, n, j, leaves, a, w):
    """w = the column of unknown j in C, forward-substituted."""
    w[:] = 0.0
    first = 0
    if leaves:
        while free[first] != j:
            first += 1
        w[first] = -1.0
        first &= -4
    else:
        row = gram[j]
        for i in range(k):
            w[i] = row[free[i]]
    forward_substitute(a, n, w, first)


@njit(fastmath=FAST, error_model="numpy", inline="always")
def complement(gram, diagonal, lower, upper, state, state0, x0, g0, changed, slot, p, q, dots, s, sign):
    """Fill s with the Schur complement of the changed unknowns, and beside it with the right-hand side."""
    width = (q + 8) & -8
    for i in range(q):
        s[i * STRIDE + (i & -8) : i * STRIDE + width] = 0.0
        s[i * STRIDE + i] = 1.0
        sign[i] = 1.0
    for i in range(p):
        ii = changed[i]
        joined = state0[ii] != FREE
        sign[i] = 1.0 if joined else -1.0
        for j in range(i, p):
            jj = changed[j]
            total = -dots[slot[ii], slot[jj]]
            if joined and state0[jj] != FREE:
                total += gram[ii, jj]
            s[i * STRIDE + j] = total
        if joined:
            s[i * STRIDE + i] += diagonal[ii]
            s[i * STRIDE + q] = -g0[ii]
        else:
            s[i * STRIDE + q] = x0[ii] - (lower[ii] if state[ii] == LOWER else upper[ii])


@njit(fastmath=FAST, error_model="numpy", cache=True)
def gather(gram, diagonal, free, k, n, width, a):
    """Fill `a` with the free block of `gram + diag`, padded to n by unknowns of their own, and zeros beside it."""
    for i in range(n):
        row, s = gram[free[i]], i & -8
        r, columns, beside = a[i * STRIDE + s : i * STRIDE + n], free[s:n], a[i * STRIDE + n : i * STRIDE + width]
        for j in range(columns.size):
            r[j] = row[columns[j]]
        for j in range(beside.size):
            beside[j] = 0.0
        if i < k:
            a[i * STRIDE + i] += diagonal[free[i]]
        else:
            a[i * STRIDE + i] = 1.0


@njit(fastmath=FAST, error_model="numpy", cache=True)
def evaluate(gram, diagonal, linear, x, g):
    """g = half the gradient at x."""
    g[:] = 0.0
    for i in range(x.size):
        if x[i] != 0:
            for j in range(g.size):
                g[j] += x[i] * gram[i, j]
    for i in range(x.size):
        g[i] += linear[i] + diagonal[i] * x[i]


@njit(error_model="numpy", cache=True)
def copy(source, target):
    """target = source; a slice assignment would make Numba compile the text of its errors, which takes seconds."""
    for i in range(source.size):
        target[i] = source[i]


@njit(fastmath=FAST, error_model="numpy", cache=True)
def size(vector):
    """The largest absolute value, at least 1."""
    largest = 1.0
    for i in range(vector.size):
        largest = max(largest, abs(vector[i]))
    return largest


@njit(error_model="numpy", cache=True)
def pack(chosen, value, index):
    """List where `chosen` has the value, padded to a multiple of four with the index of a zero row; how many."""
    k = 0
    for i in range(chosen.size):
        index[k] = i
        k += chosen[i] == value
    for i in range(k, (k + 3) & -4):
        index[i] = chosen.size
    return k


@njit(fastmath=FAST, error_model="numpy", cache=True)
def judge(lower, upper, state, x, g, tolerance, following):
    """The states that x and g ask for; returns how many differ. Without branches: the states are unpredictable."""
    wrong = 0
    for i in range(state.size):
        now = state[i]
        leave = np.int8(x[i] > upper[i]) - np.int8(x[i] < lower[i])
        enter = np.int8((now == LOWER) & (g[i] < -tolerance)) - np.int8((now == UPPER) & (g[i] > tolerance))
        following[i] = now + (now == FREE) * leave + enter
        wrong += following[i] != now
    return wrong


@njit(error_model="numpy", cache=True)
def flat(state, g, tolerance):
    """Whether the gradient of the free unknowns is zero, as it is unless their block is singular."""
    largest = 0.0
    for i in range(state.size):
        largest = max(largest, abs(g[i]) if state[i] == FREE else 0.0)
    return largest <= tolerance


@njit(error_model="numpy", cache=True)
def advance(state, following, wrong, memory):
    """Take over the following states: all, or only the last that differs once PATIENCE rounds brought no progress.

    Changing all may cycle; changing the last cannot (Murty 1974, doi:10.1007/BF01580098). `memory` holds the fewest
    wrong states so far and the rounds of patience left.
    """
    fewest, patience = memory
    patience -= 1
    if wrong < fewest:
        fewest, patience = wrong, np.int64(PATIENCE)
    if patience > 0:
        copy(following, state)
    else:
        i = state.size - 1
        while following[i] == state[i]:
            i -= 1
        state[i] = following[i]
    return fewest, patience
