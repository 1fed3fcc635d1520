"""Bends of shapes told by points in many frames: the dense normal equations, recovered truth, and what noise tells."""

import numpy as np
import pytest

from blendcap.modeling.bends import SeenPoints, bent, fit_bends, moments

POINTS, SHAPES, WAVES, FRAMES = 12, 3, 2, 40


def problem(seed: int = 0, noise: float = 0.0, size: float = 0.2):
    """Points, weights, what they miss under true bends, which are seen, and the bends."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(POINTS, 3, 3)) / 2
    axes[::2, 2] = 0  # tracks
    points = SeenPoints(
        rng.normal(size=(POINTS, SHAPES, 3)), rng.normal(size=(POINTS, WAVES)), axes, rng.uniform(0.5, 2, POINTS)
    )
    weights, bends = rng.uniform(size=(FRAMES, SHAPES)), size * rng.normal(size=(SHAPES, WAVES, 3))
    moved = np.einsum("tn,pnc->tpc", weights, points.changed(bends))
    missed = np.einsum("pij,tpj->tpi", axes, moved) + noise * rng.normal(size=moved.shape)
    seen = rng.random((FRAMES, POINTS)) < 0.8
    return points, weights, missed, seen, bends


def dense(points: SeenPoints, weights, missed, seen, scale: float) -> np.ndarray:
    """The same ridge as one tall matrix, a column a coefficient."""
    length = np.linalg.norm(points.deltas, axis=2)
    columns = np.einsum("tn,pn,pk,pij->tpinkj", weights, length, points.waves, points.axes)
    root = np.sqrt(points.worth)[:, None]
    rows = (columns * root[:, :, None, None, None])[seen].reshape(-1, SHAPES * WAVES * 3)
    told = (missed * root)[seen].ravel()
    ridge = np.eye(rows.shape[1]) / scale
    answer = np.linalg.lstsq(np.vstack([rows, ridge]), np.r_[told, np.zeros(len(ridge))], rcond=None)[0]
    return answer.reshape(SHAPES, WAVES, 3)


@pytest.mark.parametrize("scale", [0.05, 0.5])
def test_the_bends_are_those_of_the_dense_least_squares(scale):
    points, weights, missed, seen, _ = problem(noise=0.1)
    folds = [moments(points, weights[k::2], missed[k::2], seen[k::2]) for k in (0, 1)]
    found = fit_bends(points, folds, (scale,))
    np.testing.assert_allclose(found.coefficients, dense(points, weights, missed, seen, scale), atol=2e-5)
    assert found.residual < 1e-4 and found.scale == scale


def test_the_residual_tells_how_far_the_solve_is_from_its_end(monkeypatch):
    """Checked against the gradient of the tall least squares, by differences."""
    points, weights, missed, seen, _ = problem(noise=0.1)
    folds = [moments(points, weights[k::2], missed[k::2], seen[k::2]) for k in (0, 1)]
    monkeypatch.setattr("blendcap.modeling.bends.MOST_STEPS", 2)
    found = fit_bends(points, folds, (0.5,))

    def cost(flat: np.ndarray) -> float:
        moved = np.einsum("tn,pnc->tpc", weights, points.changed(flat.reshape(SHAPES, WAVES, 3)))
        left = ((missed - np.einsum("pij,tpj->tpi", points.axes, moved)) ** 2).sum(2)
        return 0.5 * float((left * seen * points.worth).sum() + (flat**2).sum() / 0.5**2)

    def gradient(flat: np.ndarray) -> np.ndarray:
        return np.array([cost(flat + step) - cost(flat - step) for step in 1e-3 * np.eye(len(flat))]) / 2e-3

    at, before = gradient(found.coefficients.ravel()), gradient(np.zeros(found.coefficients.size))
    assert found.residual == pytest.approx(np.linalg.norm(at) / np.linalg.norm(before), rel=1e-4)
    assert found.residual > 1e-3


def test_what_is_foretold_is_what_left_out_frames_show():
    points, weights, missed, seen, _ = problem(noise=0.1)
    halves = [slice(0, FRAMES // 2), slice(FRAMES // 2, None)]
    found = fit_bends(points, [moments(points, weights[h], missed[h], seen[h]) for h in halves], (0.3,))
    left = whole = 0.0
    for own, other in (halves, halves[::-1]):
        bends = dense(points, weights[other], missed[other], seen[other], 0.3)
        moved = np.einsum("pij,tpj->tpi", points.axes, np.einsum("tn,pnc->tpc", weights[own], points.changed(bends)))
        for part, rest in ((missed[own] - moved, False), (missed[own], True)):
            cost = ((part**2).sum(2) * seen[own] * points.worth).sum()
            left, whole = left + cost * (not rest), whole + cost * rest
    assert found.foretold == pytest.approx(1 - left / whole, abs=1e-4)


def test_true_bends_come_back_and_what_is_unseen_does_not_matter():
    points, weights, missed, seen, bends = problem()
    wild = np.where(seen[..., None], missed, np.nan)
    folds = [moments(points, weights[k::2], wild[k::2], seen[k::2]) for k in (0, 1)]
    found = fit_bends(points, folds, (100.0,))
    np.testing.assert_allclose(found.coefficients, bends, atol=1e-3)
    assert found.foretold > 0.9999


def test_noise_foretells_nothing_and_gets_the_smallest_scale():
    points, weights, missed, seen, _ = problem(noise=0.5, size=0.0)
    found = fit_bends(points, [moments(points, weights[k::2], missed[k::2], seen[k::2]) for k in (0, 1)], (0.1, 1.0))
    assert found.scale == 0.1 and found.foretold < 0.02


def test_the_scale_is_that_of_the_person():
    for size, expected in ((0.02, 0.02), (0.5, 0.5)):
        points, weights, missed, seen, _ = problem(noise=0.5, size=size, seed=3)
        folds = [moments(points, weights[k::2], missed[k::2], seen[k::2]) for k in (0, 1)]
        assert fit_bends(points, folds, (0.02, 0.5)).scale == expected


def test_a_change_is_a_part_of_the_motion_and_turns_with_the_coefficients():
    rng = np.random.default_rng(0)
    deltas, waves, bends = rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 4)), rng.normal(size=(2, 4, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    np.testing.assert_allclose(bent(3 * deltas, waves, bends @ turn), 3 * bent(deltas, waves, bends) @ turn)
    deltas[2] = 0
    assert not bent(deltas, waves, bends)[2].any()
