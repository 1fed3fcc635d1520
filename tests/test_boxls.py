"""The exact per-frame solver against closed forms, other solvers and itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blendcap import InputError
from blendcap.numerics import _descent
from blendcap.numerics._boxproblem import box_problem, residuals
from blendcap.numerics._pivoting import workspace
from blendcap.numerics.boxls import idle_unknowns, solve_box


def make(frames, n, seed=0, extra=5):
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(n + extra, n))
    return basis.T @ basis, rng.normal(size=(frames, n)) * 3


def assert_same(a, b, atol=1e-11):
    np.testing.assert_allclose(a, b, rtol=0, atol=atol)


def test_a_diagonal_problem_is_a_clip():
    linear = np.random.default_rng(1).normal(size=(200, 7))
    curvature = np.arange(1.0, 8)
    weights, certificate = solve_box(np.diag(curvature), linear)
    assert_same(weights, np.clip(-linear / curvature, 0, 1), 1e-14)
    assert certificate.converged
    assert certificate.max_kkt < 1e-14


@pytest.mark.parametrize("coupled", [False, True])
def test_a_frame_is_judged_by_the_markers_that_it_sees(coupled):
    """The residual is scaled by the curvature that is there: with a lost marker's it would look smaller."""
    rng = np.random.default_rng(8)
    rows, missing = rng.normal(size=(9, 3, 6)) * np.arange(1, 10)[:, None, None], rng.random((40, 9)) < 0.6
    gram = np.einsum("mki,mkj->ij", rows, rows) + 0.1 * np.eye(6)
    linear, weights = 20 * rng.normal(size=(40, 6)), rng.random((40, 6))
    coupling = np.r_[np.zeros((1, 6)), rng.random((39, 6))] if coupled else np.zeros((40, 6))
    own = residuals(box_problem(gram, linear, None, 0, 1, rows, missing), weights, coupling if coupled else None)
    for t in range(40):
        seen = gram - np.einsum("mki,mkj->ij", rows[missing[t]], rows[missing[t]])
        slope, stiff = seen @ weights[t] + linear[t], np.diag(seen).copy()
        for side, links in ((t - 1, coupling[t]), (t + 1, coupling[t + 1] if t < 39 else np.zeros(6))):
            slope += links * (weights[t] - weights[min(side, 39)])
            stiff += links
        assert own[t] == pytest.approx(np.abs(weights[t] - np.clip(weights[t] - slope / stiff, 0, 1)).max(), abs=1e-12)


@pytest.mark.parametrize("frames", [1, 5, 130])
def test_agrees_with_scipy(frames):
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(2)
    basis, targets = rng.normal(size=(30, 12)), rng.normal(size=(frames, 30)) * 4
    low, high = -rng.random(12), rng.random(12)
    weights, _ = solve_box(basis.T @ basis, -targets @ basis, lower=low, upper=high)
    for a, y in zip(weights, targets, strict=True):
        assert_same(a, lsq_linear(basis, y, (low, high), method="bvls", tol=1e-14).x, 1e-10)


def test_agrees_with_daqp():
    daqp = pytest.importorskip("daqp")
    gram, linear = make(80, 40, 3)
    weights, _ = solve_box(gram, linear)
    none, zero, one = np.zeros((0, 40)), np.zeros(40), np.ones(40)
    for a, f in zip(weights, linear, strict=True):
        assert_same(a, daqp.solve(gram, f, none, one, zero, np.zeros(40, np.int32))[0], 1e-9)


@given(st.integers(0, 10**6), st.integers(1, 30), st.integers(1, 90), st.integers(-4, 4))
@settings(max_examples=60, deadline=None)
def test_every_random_problem_ends_at_its_optimum(seed, n, frames, extra):
    rng = np.random.default_rng(seed)
    gram, linear = make(frames, n, seed, max(extra, 1 - n))
    low = np.where(rng.random(n) < 0.2, -np.inf, -rng.random(n))
    low = np.where(np.isinf(low) & (extra < 0), -5.0, low)  # a singular Gram matrix has no answer without bounds
    diagonal = rng.random((frames, n)) if rng.random() < 0.5 else None
    weights, certificate = solve_box(gram, linear, diagonal=diagonal, lower=low)
    assert certificate.converged
    assert (weights >= low).all()
    assert (weights <= 1).all()
    slope = weights @ gram + linear + (0 if diagonal is None else diagonal * weights)
    step = weights - np.clip(weights - slope / np.diag(gram), low, 1)
    assert np.abs(step).max() < 1e-9


def test_the_residual_is_that_of_the_returned_weights():
    gram, linear = make(70, 9, 5)
    weights, certificate = solve_box(gram, linear)
    step = weights - np.clip(weights - (weights @ gram + linear) / np.diag(gram), 0, 1)
    assert_same(certificate.residuals, np.abs(step).max(1), 1e-15)
    assert certificate.residuals.shape == (70,)


def test_order_and_scale_do_not_matter():
    gram, linear = make(100, 20, 6)
    weights, _ = solve_box(gram, linear)
    order = np.random.default_rng(7).permutation(20)
    assert_same(solve_box(gram[np.ix_(order, order)], linear[:, order])[0], weights[:, order])
    for factor in (1e-4, 1e4):
        assert_same(solve_box(gram * factor, linear * factor)[0], weights)
        assert_same(solve_box(gram * factor**2, linear * factor, upper=1 / factor)[0] * factor, weights)
    backwards = np.arange(100)[::-1]
    assert_same(solve_box(gram, linear[backwards])[0], weights[backwards])
    assert_same(solve_box(gram, linear[:3])[0], weights[:3])


def test_without_bounds_it_is_a_linear_solve():
    gram, linear = make(70, 15, 8)
    weights, certificate = solve_box(gram, linear, lower=-np.inf, upper=np.inf)
    assert_same(weights, -np.linalg.solve(gram, linear.T).T, 1e-9)
    assert certificate.converged


@pytest.mark.parametrize("frames", [3, 100])
def test_a_singular_gram_matrix_has_an_optimum(frames):
    gram, linear = make(frames, 12, 9, extra=-6)
    linear = linear @ gram  # in its range
    gram = np.block([[gram, -gram], [-gram, gram]])
    weights, certificate = solve_box(gram, np.hstack([linear, -linear]))
    assert np.isfinite(weights).all()
    assert certificate.converged


def test_an_unknown_without_curvature_goes_where_its_gradient_points():
    gram, linear = np.diag([1.0, 0.0, 0.0]), np.array([[-0.5, 1.0, -1.0]])
    weights, certificate = solve_box(gram, linear)
    assert_same(weights, [[0.5, 0, 1]], 1e-12)
    assert certificate.converged


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_broken_frame_stays_alone(bad):
    gram, linear = make(100, 8, 10)
    clean, _ = solve_box(gram, linear)
    linear[17, 3] = bad
    weights, certificate = solve_box(gram, linear)
    assert np.isnan(weights[17]).all()
    assert np.isinf(certificate.residuals[17])
    assert not certificate.converged
    others = np.arange(100) != 17
    assert_same(weights[others], clean[others], 1e-13)
    assert np.isfinite(certificate.residuals[others]).all()


def test_missing_markers_are_taken_out_of_the_gram_matrix():
    rng = np.random.default_rng(11)
    rows = rng.normal(size=(12, 3, 10))
    gram = np.einsum("mki,mkj->ij", rows, rows) + 0.1 * np.eye(10)
    missing = rng.random((300, 12)) < 0.2
    missing[100:150] = missing[100]
    targets = np.where(missing[..., None], 0.0, rng.normal(size=(300, 12, 3)))
    linear = -np.einsum("tmk,mkn->tn", targets, rows)
    weights, certificate = solve_box(gram, linear, rows=rows, missing=missing)
    assert certificate.converged
    for t in range(0, 300, 7):
        gone = rows[missing[t]].reshape(-1, 10)
        assert_same(weights[t], solve_box(gram - gone.T @ gone, linear[t : t + 1])[0][0], 1e-10)


def test_a_diagonal_of_each_frame_is_added():
    gram, linear = make(70, 9, 12)
    diagonal = np.random.default_rng(13).random((70, 9)) * 50
    weights, _ = solve_box(gram, linear, diagonal=diagonal)
    for t in range(0, 70, 9):
        assert_same(weights[t], solve_box(gram + np.diag(diagonal[t]), linear[t : t + 1])[0][0])


@pytest.mark.parametrize("begin", [0.0, 0.5, 1.0])
def test_the_answer_does_not_depend_on_the_start(begin):
    gram, linear = make(80, 30, 14)
    weights, cold = solve_box(gram, linear)
    assert_same(solve_box(gram, linear, start=np.full((80, 30), begin))[0], weights)
    warm = solve_box(gram, linear, start=weights)[1]
    assert warm.iterations == 1.0
    assert cold.iterations >= 1.0


def test_the_answer_does_not_depend_on_the_threads():
    import numba

    gram, linear = make(500, 30, 15)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = solve_box(gram, linear)[0]
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(solve_box(gram, linear)[0], one)


def test_many_unknowns_of_a_badly_conditioned_basis():
    rng = np.random.default_rng(16)
    basis = rng.normal(size=(60, 300)) * np.geomspace(1, 1e-3, 300)
    gram = basis.T @ basis + 1e-3 * np.eye(300)
    weights, certificate = solve_box(gram, -rng.random((70, 60)) @ basis)
    assert certificate.max_kkt < 1e-9
    assert ((weights > 0) & (weights < 1)).any()


def test_the_safety_net_alone_finds_the_optimum():
    gram, linear = make(20, 25, 17)
    weights, _ = solve_box(gram, linear)
    scale = np.sqrt(np.diag(gram))
    padded = np.zeros((26, 32))
    padded[:25, :25] = gram / np.outer(scale, scale)
    for a, f in zip(weights, linear, strict=True):
        x = np.zeros(25)
        bounds, state = (np.zeros(25), scale), np.zeros(25, np.int8)
        rounds = _descent.descend(
            padded, np.zeros(25), f / scale, *bounds, state, x, np.zeros(32), workspace(25), 500
        )  # fmt: skip
        assert rounds > 0
        assert_same(x / scale, a, 1e-10)


def test_unknowns_that_stay_at_zero_are_left_out_and_come_back_where_they_are_wanted():
    gram, linear = make(1600, 100, 18)
    linear[:, 12:] += 900
    linear[777, 20] = linear[1201, [13, 15]] = -400
    linear[1300, 3] = np.nan
    idle = idle_unknowns(box_problem(gram, linear, None, 0, 1, None, None))
    assert idle[12:].all()
    assert not idle.all()
    weights, certificate = solve_box(gram, linear)
    assert (weights[777, 20] > 0) & (weights[1201, 13] > 0)
    assert (weights[:, 12:] == 0).sum() > 88 * 1590
    assert np.isnan(weights[1300]).all()
    assert np.nanmax(np.where(np.isinf(certificate.residuals), 0, certificate.residuals)) < 1e-12
    assert_same(weights[700:1300], solve_box(gram, linear[700:1300])[0])
    shifted, _ = solve_box(gram, linear - 0.5 * gram.sum(0), lower=0.5, upper=1.5)
    assert_same(shifted - 0.5, weights)


def test_no_frames_is_no_work():
    weights, certificate = solve_box(np.eye(3), np.zeros((0, 3)))
    assert weights.shape == (0, 3)
    assert certificate.converged


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gram": np.ones((3, 2))}, "square"),
        ({"gram": np.array([[1.0, 2, 0], [0, 1, 0], [0, 0, 1]])}, "symmetric"),
        ({"gram": np.full((3, 3), np.nan)}, "NaN"),
        ({"gram": np.eye(400), "linear": np.ones((2, 400))}, "320"),
        ({"linear": np.ones((2, 4))}, "linear"),
        ({"diagonal": np.ones((1, 3))}, "diagonal"),
        ({"diagonal": np.full((2, 3), -3.0)}, "below 0"),
        ({"lower": 1.0}, "below upper"),
        ({"upper": [1, 2]}, "upper"),
        ({"lower": np.nan}, "NaN"),
        ({"rows": np.ones((2, 3, 3))}, "belong together"),
        ({"rows": np.ones((2, 3, 3)), "missing": np.zeros((2, 1), bool)}, "missing"),
        ({"start": np.ones((1, 3))}, "start"),
    ],
)
def test_bad_input_is_said(change, words):
    arguments = {"gram": np.eye(3), "linear": np.ones((2, 3))} | change
    with pytest.raises(InputError, match=words):
        solve_box(arguments.pop("gram"), arguments.pop("linear"), **arguments)
