"""Anderson acceleration: exact on linear maps, harmless without memory."""

import numpy as np
import pytest

from blendcap.numerics.anderson import Anderson


def run(memory, steps, size=6, seed=0):
    """Distances to the fixed point of a linear contraction."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(size, size))
    matrix *= 0.95 / np.abs(np.linalg.eigvals(matrix)).max()
    shift, faster, x, away = rng.normal(size=size), Anderson(memory), np.zeros(size), []
    fixed = np.linalg.solve(np.eye(size) - matrix, shift)
    for _ in range(steps):
        image = matrix @ x + shift
        x = faster.step(image, image - x)
        away.append(np.abs(x - fixed).max())
    return np.array(away)


@pytest.mark.parametrize("seed", range(4))
def test_a_linear_map_of_six_unknowns_is_solved_in_seven_steps(seed):
    assert run(6, 8, seed=seed)[-1] < 1e-5
    assert run(0, 8, seed=seed)[-1] > 1e-2


def test_without_memory_it_is_the_plain_iteration():
    faster, image = Anderson(0), np.arange(3.0)
    for _ in range(3):
        np.testing.assert_array_equal(faster.step(image, np.ones(3)), image)


def test_a_residual_that_grows_empties_the_memory():
    faster = Anderson(5)
    faster.step(np.zeros(2), np.array([1.0, 0]))
    image = np.array([3.0, 4])
    np.testing.assert_array_equal(faster.step(image, np.array([5.0, 0])), image)


def test_the_shape_of_the_unknown_is_kept():
    faster = Anderson(2)
    faster.step(np.zeros((4, 3)), np.ones(5))
    assert faster.step(np.ones((4, 3)), 0.5 * np.ones(5)).shape == (4, 3)
    np.testing.assert_allclose(faster.step(np.ones((4, 3)), np.zeros(5)), 1)
