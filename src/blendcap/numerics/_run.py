"""All stages of the exact solver for one run of frames after the other, each while it is in the cache."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from blendcap.numerics._descent import descend
from blendcap.numerics._gradient import worst_run
from blendcap.numerics._guess import guess_run
from blendcap.numerics._pivoting import FREE, LOWER, UPPER, pivot, workspace
from blendcap.numerics._products import panels
from blendcap.numerics._scaling import rescale, unscale
from blendcap.numerics._seen import seen_gram, seen_start
from blendcap.numerics._together import settle


@njit(parallel=True, error_model="numpy", cache=True)
def solve_runs(box, small, factors, scale, guess, begin, curvature, answers, count):
    """Fill `answers`: the weights of all frames, the rounds that each took, and its residual.

    `small` is the problem of the kept unknowns, scaled. A frame begins with its states in `begin`, or else with a
    guess, or else, where there is no guess either, with the states of the frame before.
    """
    frames = len(box[1])
    columns, small_columns = panels(box[0]), panels(small[0])
    for b in prange(count):
        run = b * frames // count, (b + 1) * frames // count
        solve_run(box, small, factors, scale, guess, begin, curvature, answers, (columns, small_columns), run)


@njit(error_model="numpy", cache=True)
def solve_run(box, small, factors, scale, guess, begin, curvature, answers, columns, run):
    """One run of frames."""
    _, linear, diagonal, lower, upper, _, missing = box
    gram, _, _, low, high, rows, _ = small
    weights, rounds, worst = answers
    first, last = run
    frames, m = last - first, low.size
    f, d = np.empty((frames, m)), np.empty((frames if len(diagonal) > 1 else 1, m))
    usable = rescale(linear, diagonal, factors, first, f, d)
    x, todo, states = np.empty((frames, m)), usable.copy(), np.empty((frames, m), np.int8)
    given = True
    if len(begin):
        states[:] = begin[first:last]
    elif guess[2].size:
        guess_run(f, d, guess, states)
    else:
        given = False
    here = gram, f, d, low, high, rows, missing[first:last]
    if given and not missing.shape[1]:
        settle(here, columns[1], states, todo, x, rounds[first:last])
    settle_singly(here, todo, states, given, x, rounds[first:last])
    unscale(x, usable, factors[0], scale, lower, upper, weights[first:last])
    if not missing.shape[1]:
        worst_run(box, columns[0], curvature, weights, worst, first, last)


@njit(error_model="numpy", cache=True)
def settle_singly(box, todo, states, given, answers, rounds):
    """Solve the frames to do, one after the other, each from its given states, or from those of the frame before."""
    gram, linear, diagonal, lower, upper, rows, missing = box
    if not todo.any():
        return
    m, most = lower.size, 100 + 2 * lower.size
    work, g = workspace(m), np.zeros(gram.shape[1])
    seen, state = seen_start(gram, missing), np.zeros(m, np.int8)
    for t in range(len(linear)):
        if not todo[t]:
            continue
        x, f, d = answers[t], linear[t], diagonal[t if len(diagonal) > 1 else 0]
        for i in range(m):
            if given:
                state[i] = states[t, i]
            if (state[i] == LOWER and lower[i] == -np.inf) or (state[i] == UPPER and upper[i] == np.inf):
                state[i] = FREE
        h = seen_gram(seen, gram, rows, missing, t)
        more = pivot(h, d, f, lower, upper, state, x, g, work, most)
        if more < 0:
            more = most + abs(descend(h, d, f, lower, upper, state, x, g, work, most))
        rounds[t] += more
