"""The exact whole-sequence solver against the one dense problem that it is, and against its limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blendcap import InputError
from blendcap.numerics import _newton
from blendcap.numerics.boxls import solve_box
from blendcap.numerics.boxseq import solve_box_sequence


def make(frames, n, seed=0, extra=5):
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(n + extra, n))
    wave = np.sin(np.arange(frames)[:, None] / 7 + rng.random(n) * 6)
    return basis.T @ basis, -(0.5 + wave + 0.4 * rng.normal(size=(frames, n))) @ (basis.T @ basis)


def assert_same(a, b, atol=1e-11):
    np.testing.assert_allclose(a, b, rtol=0, atol=atol)


def stacked(gram, linear, coupling, diagonal, lower, upper):
    """The same problem as one frame of T * N unknowns."""
    frames, n = linear.shape
    big = np.zeros((frames, n, frames, n))
    for t in range(frames):
        big[t, :, t] += gram[t] + np.diag(diagonal[t])
        if t:
            link = np.diag(coupling[t])
            big[t, :, t] += link
            big[t - 1, :, t - 1] += link
            big[t, :, t - 1] -= link
            big[t - 1, :, t] -= link
    size = frames * n
    bounds = {"lower": np.tile(lower, frames), "upper": np.tile(upper, frames)}
    return solve_box(big.reshape(size, size), linear.reshape(1, size), **bounds)[0].reshape(frames, n)


@given(st.integers(0, 10**6), st.integers(1, 9), st.integers(1, 24), st.sampled_from([0.01, 1.0, 100.0]))
@settings(max_examples=40, deadline=None)
def test_is_the_stacked_problem(seed, n, frames, strength):
    rng = np.random.default_rng(seed)
    gram, linear = make(frames, n, seed)
    coupling, diagonal = strength * rng.random((frames, n)) * (rng.random(n) < 0.8), rng.random((frames, n))
    lower, upper = np.where(rng.random(n) < 0.3, -np.inf, -0.2), np.where(rng.random(n) < 0.3, np.inf, 1.0)
    weights, certificate = solve_box_sequence(
        gram, linear, coupling, diagonal=diagonal, lower=lower, upper=upper
    )  # fmt: skip
    assert certificate.converged
    assert_same(weights, stacked([gram] * frames, linear, coupling, diagonal, lower, upper), 1e-10)


def test_missing_markers_are_taken_out_of_the_gram_matrix():
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(9, 3, 6))
    gram = np.einsum("mki,mkj->ij", rows, rows) + 0.1 * np.eye(6)
    missing = rng.random((40, 9)) < 0.3
    targets = np.where(missing[..., None], 0.0, rng.normal(size=(40, 9, 3)))
    linear = -np.einsum("tmk,mkn->tn", targets, rows)
    coupling = rng.random((40, 6)) * 10
    weights, certificate = solve_box_sequence(gram, linear, coupling, rows=rows, missing=missing)
    grams = [gram - np.einsum("mki,mkj->ij", rows[gone], rows[gone]) for gone in missing]
    assert_same(weights, stacked(grams, linear, coupling, np.zeros((40, 6)), np.zeros(6), np.ones(6)), 1e-10)
    assert certificate.converged


def test_without_coupling_it_is_solve_box():
    gram, linear = make(150, 20, 2)
    assert_same(solve_box_sequence(gram, linear, np.zeros(20))[0], solve_box(gram, linear)[0])


def test_a_strong_coupling_holds_still():
    gram, linear = make(80, 6, 3)
    weights, certificate = solve_box_sequence(gram, linear, np.full(6, 1e9))
    still, _ = solve_box(gram, linear.mean(0, keepdims=True))
    assert_same(weights, np.repeat(still, 80, axis=0), 1e-4)
    assert certificate.converged


def test_one_gaussian_smoother_in_closed_form():
    frames, c = 200, 25.0
    linear = -np.random.default_rng(4).normal(size=(frames, 1))
    weights, _ = solve_box_sequence(np.eye(1), linear, np.array([c]), lower=-np.inf, upper=np.inf)
    difference = np.diff(np.eye(frames), axis=0)
    assert_same(weights, -np.linalg.solve(np.eye(frames) + c * difference.T @ difference, linear), 1e-12)


def test_time_reversed_is_the_answer_reversed():
    gram, linear = make(90, 12, 5)
    coupling = np.random.default_rng(6).random((90, 12)) * 30
    weights, _ = solve_box_sequence(gram, linear, coupling)
    turned = np.vstack([np.zeros((1, 12)), coupling[:0:-1]])
    assert_same(solve_box_sequence(gram, linear[::-1], turned)[0], weights[::-1])


def test_the_start_only_saves_steps():
    gram, linear = make(200, 15, 7)
    coupling = np.full(15, 20.0)
    weights, cold = solve_box_sequence(gram, linear, coupling)
    again, warm = solve_box_sequence(gram, linear, coupling, start=weights)
    assert_same(again, weights)
    assert warm.iterations == 1
    assert cold.iterations > 1
    assert_same(solve_box_sequence(gram, linear, coupling, start=np.ones((200, 15)))[0], weights)


def test_a_broken_frame_cuts_the_chain():
    gram, linear = make(60, 5, 8)
    linear[20] = np.nan
    coupling = np.full(5, 9.0)
    weights, certificate = solve_box_sequence(gram, linear, coupling)
    assert np.isnan(weights[20]).all()
    assert np.flatnonzero(np.isinf(certificate.residuals)).tolist() == [20]
    assert not certificate.converged
    assert_same(weights[:20], solve_box_sequence(gram, linear[:20], coupling)[0])
    assert_same(weights[21:], solve_box_sequence(gram, linear[21:], coupling)[0])


def test_the_residual_counts_the_couplings():
    gram, linear = make(30, 4, 9)
    coupling = np.full((30, 4), 3.0)
    weights, certificate = solve_box_sequence(gram, linear, coupling)
    assert certificate.max_kkt < 1e-12
    moved = np.diff(weights, axis=0) * 3.0
    slope = weights @ gram + linear
    assert np.abs(weights - np.clip(weights - slope, 0, 1)).max() > 1e-3  # without them it is no optimum
    slope[1:] += moved
    slope[:-1] -= moved
    assert_same(weights, np.clip(weights - slope, 0, 1), 1e-11)


def test_the_monotone_method_alone_finds_the_optimum(monkeypatch):
    gram, linear = make(60, 10, 10)
    weights, _ = solve_box_sequence(gram, linear, np.full(10, 5.0))
    monkeypatch.setattr(_newton, "MOST", 1)
    slow, certificate = solve_box_sequence(gram, linear, np.full(10, 5.0), start=np.zeros((60, 10)))
    assert_same(slow, weights, 1e-9)
    assert certificate.converged
    assert certificate.iterations > 1


def test_one_state_at_a_time_finds_the_optimum(monkeypatch):
    gram, linear = make(60, 10, 11)
    weights, _ = solve_box_sequence(gram, linear, np.full(10, 5.0))
    monkeypatch.setattr(_newton, "PATIENCE", 0)
    assert_same(solve_box_sequence(gram, linear, np.full(10, 5.0))[0], weights)


@pytest.mark.parametrize("frames", [0, 1])
def test_short_sequences(frames):
    gram, linear = make(frames, 4, 12)
    weights, certificate = solve_box_sequence(gram, linear, np.ones(4))
    assert_same(weights, solve_box(gram, linear)[0])
    assert certificate.converged


@pytest.mark.parametrize("coupling", [-np.ones(3), np.full(3, np.nan), np.ones(2), "strong"])
def test_bad_couplings_are_said(coupling):
    with pytest.raises(InputError, match="coupling"):
        solve_box_sequence(np.eye(3), np.ones((2, 3)), coupling)
