"""The exact per-frame solver against closed forms, other solvers and itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blendcap import InputError
from blendcap.numerics.boxls import solve_box


def make(frames, n, seed=0, rank=None):
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(rank or n + 5, n))
    return basis.T @ basis, rng.normal(size=(frames, n)) * 3


def test_a_diagonal_problem_is_a_clip():
    linear = np.random.default_rng(1).normal(size=(200, 7))
    curvature = np.arange(1.0, 8)
    weights, certificate = solve_box(np.diag(curvature), linear)
    np.testing.assert_allclose(weights, np.clip(-linear / curvature, 0, 1), atol=1e-14)
    assert certificate.converged
    assert certificate.max_kkt < 1e-14


@pytest.mark.parametrize("frames", [1, 5, 130])
def test_agrees_with_scipy(frames):
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(2)
    basis, targets = rng.normal(size=(30, 12)), rng.normal(size=(frames, 30)) * 4
    low, high = -rng.random(12), rng.random(12)
    weights, _ = solve_box(basis.T @ basis, -targets @ basis, lower=low, upper=high)
    for a, y in zip(weights, targets, strict=True):
        np.testing.assert_allclose(a, lsq_linear(basis, y, (low, high), method="bvls", tol=1e-14).x, atol=1e-10)
