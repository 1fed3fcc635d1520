"""The sweeps against the sum over all paths, written out."""

from itertools import product

import numpy as np
import pytest

from blendcap.numerics.semimarkov import posterior_steps

FRAMES, LEVELS = 5, 3
LENGTHS = np.array([2, 3])


def random_chain(seed):
    rng = np.random.default_rng(seed)
    costs, segment_costs = rng.exponential(2, (FRAMES, LEVELS)), rng.exponential(3, (FRAMES, 2, LEVELS))
    for j, length in enumerate(LENGTHS):
        segment_costs[FRAMES - length :, j] = np.inf
    modes, moves = rng.random((2, 2)), rng.random((2, LEVELS, LEVELS))
    apart = (np.arange(LEVELS)[:, None] - np.arange(LEVELS)) ** 2.0
    return costs, (segment_costs, LENGTHS), modes, moves / moves.sum(2, keepdims=True), apart


def ways(t):
    """All ways from frame t to the last: lists of (frame, what is done), by a step of either mode or by a segment."""
    if t == FRAMES - 1:
        yield []
        return
    for kind in (0, 1):
        yield from ([(t, kind), *rest] for rest in ways(t + 1))
    for j, length in enumerate(LENGTHS):
        if t + length < FRAMES:
            yield from ([(t, 2 + j), *rest] for rest in ways(t + length))


def all_paths(costs, segments, modes, moves, apart):
    """Chance and squares by going through every path; a chain begins in the first mode, and so does each segment."""
    chance, squares, total = np.zeros(FRAMES), np.zeros(FRAMES), 0.0
    for way in ways(0):
        for places in product(range(LEVELS), repeat=len(way) + 1):
            p, mode = np.exp(-costs[0, places[0]]), 0
            for (t, kind), here, there in zip(way, places, places[1:], strict=False):
                if kind < 2:
                    p *= modes[mode, kind] * moves[kind, here, there] * np.exp(-costs[t + 1, there])
                    mode = kind
                else:
                    p *= (mode == 0) * (here == there) * np.exp(-segments[0][t, kind - 2, here])
                    mode = 0
            total += p
            for (t, kind), here, there in zip(way, places, places[1:], strict=False):
                if kind == 0:
                    squares[t + 1] += p * apart[here, there]
                else:
                    chance[t + 1 : t + 1 + (1 if kind == 1 else LENGTHS[kind - 2])] += p
    return chance / total, squares / total


@pytest.mark.parametrize("seed", range(4))
def test_the_sweeps_are_the_sum_over_all_paths(seed):
    chain = random_chain(seed)
    chance, squares = posterior_steps(*chain)
    expected = all_paths(*chain)
    assert np.allclose(chance, expected[0], atol=1e-12) and np.allclose(squares, expected[1], atol=1e-12)
    assert 0.05 < chance[1:].mean() < 0.95


def test_what_is_added_to_a_frames_costs_does_not_count():
    costs, (segment_costs, lengths), *rest = random_chain(1)
    added = np.array([3.0, -200.0, 50.0, 0.0, 400.0])
    shifted = segment_costs.copy()
    for t, j in np.ndindex(FRAMES, 2):
        shifted[t, j] += added[t + 1 : t + 1 + lengths[j]].sum()
    plain = posterior_steps(costs, (segment_costs, lengths), *rest)
    other = posterior_steps(costs + added[:, None], (shifted, lengths), *rest)
    assert all(np.allclose(a, b, atol=1e-9) for a, b in zip(plain, other, strict=True))


def test_thousands_of_frames_neither_vanish_nor_overflow():
    rng = np.random.default_rng(0)
    costs = rng.exponential(50, (5000, LEVELS))
    segment_costs = rng.exponential(100, (5000, 2, LEVELS))
    _, _, modes, moves, apart = random_chain(0)
    chance, squares = posterior_steps(costs, (segment_costs, LENGTHS), modes, moves, apart)
    assert np.isfinite(chance).all() and np.isfinite(squares).all() and chance.min() >= 0 and chance.max() <= 1
