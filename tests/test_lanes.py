"""Many small problems in the lanes of vectors against the same ones done singly."""

import numpy as np
import pytest

from blendcap.numerics._cholesky import inverse
from blendcap.numerics._eight import eliminate, substitute_back
from blendcap.numerics._lanes import PAIR, WIDTH, bring, put
from blendcap.numerics._products import add_products_pair, aligned, panels


@pytest.mark.parametrize("columns", [3, 8, 21])
def test_rows_come_into_the_lanes_and_go_back(columns):
    values = np.random.default_rng(0).random((20, columns))
    rows = np.array([19, 3, 7, 0, 12, 5, 18, 4])
    steps, lanes = WIDTH * np.arange(WIDTH), np.zeros(WIDTH * columns)
    bring(values, columns * rows, steps, lanes)
    np.testing.assert_array_equal(lanes.reshape(columns, WIDTH), values[rows].T)
    back = np.zeros_like(values)
    put(lanes, steps, back, columns * rows)
    np.testing.assert_array_equal(back[rows], values[rows])
    assert not back[np.setdiff1d(np.arange(20), rows)].any()


@pytest.mark.parametrize("n", [1, 6, 40])
def test_each_lane_solves_its_own_part_of_a_matrix(n):
    rng, m = np.random.default_rng(1), 45
    basis = rng.normal(size=(90, m))
    gram, own = np.zeros((m + 1, 48)), rng.random((m + 1, WIDTH))
    gram[:m, :m], own[m] = basis.T @ basis / 90, 1.0
    chosen = np.array([np.sort(rng.permutation(m)[:n]) for _ in range(WIDTH)])
    long = (n + 3) & -4
    columns = np.full((long, WIDTH), m)
    columns[:n] = chosen.T
    free = 48 * columns, columns, WIDTH * columns + np.arange(WIDTH), np.zeros_like(columns)
    wanted, y = rng.normal(size=(n, WIDTH)), np.zeros((long, WIDTH))
    y[:n] = wanted
    y, factor = y.ravel(), np.zeros(64 * 12 * 13)
    eliminate(gram.ravel(), tuple(f.ravel() for f in free), long, own.ravel(), factor, y)
    substitute_back(factor, y, long)
    for k, part in enumerate(chosen):
        whole = gram[np.ix_(part, part)] + np.diag(own[part, k])
        np.testing.assert_allclose(whole @ y.reshape(long, WIDTH)[:n, k], wanted[:, k], rtol=0, atol=1e-13)


def test_products_sum_over_the_used_unknowns():
    rng = np.random.default_rng(2)
    gram, x, g = rng.random((9, 16)), aligned(PAIR * 9), aligned(PAIR * 16)
    x[:], g[:] = rng.random(x.size), 1.0
    used = np.array([0, 3, 8])
    add_products_pair(panels(gram), used, x, g)
    wanted = 1 + gram[used].T @ x.reshape(9, PAIR)[used]
    np.testing.assert_allclose(g.reshape(16, PAIR), wanted, rtol=0, atol=1e-14)


@pytest.mark.parametrize("n", [1, 7, 60])
def test_the_inverse_is_the_inverse(n):
    basis = np.random.default_rng(3).normal(size=(2 * n, n)) / np.sqrt(2 * n)
    gram = basis.T @ basis
    np.testing.assert_allclose(inverse(gram) @ gram, np.eye(n), rtol=0, atol=1e-11)
