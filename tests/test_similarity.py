"""Similarity alignment: recovered truth, invariance, a second route, and what cannot be answered."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from blendcap.data import InputError
from blendcap.numerics.similarity import align, align_robust, apply


def cloud(count=20, seed=0):
    return np.random.default_rng(seed).normal(0, 40, (count, 3))


def motion(seed=1):
    rng = np.random.default_rng(seed)
    return Rotation.random(random_state=seed).as_matrix(), rng.normal(0, 100, 3), rng.uniform(0.5, 2)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("fit", [align, align_robust])
def test_exact_pairs_give_the_motion_back(fit, seed):
    true = motion(seed)
    answer = fit(cloud(), apply(cloud(), *true))
    for got, wanted in zip(answer, true, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-10)


def test_weighted_optimum_agrees_with_a_general_minimizer():
    rng = np.random.default_rng(3)
    source, weights = cloud(8), rng.uniform(0.1, 3, 8)
    target = apply(source, *motion()) + rng.normal(0, 5, source.shape)

    def cost(x):
        moved = apply(source, Rotation.from_rotvec(x[:3]).as_matrix(), x[3:6], np.exp(x[6]))
        return (weights * ((moved - target) ** 2).sum(1)).sum()

    rotation, translation, scale = align(source, target, weights=weights)
    ours = np.r_[Rotation.from_matrix(rotation).as_rotvec(), translation, np.log(scale)]
    start = ours + rng.normal(0, 0.05, 7)
    best = minimize(cost, start, method="BFGS", options={"gtol": 1e-6})
    assert cost(ours) <= best.fun * (1 + 1e-9)
    np.testing.assert_allclose(ours, best.x, atol=1e-3)


def test_a_mirror_image_is_never_fitted_by_a_mirror():
    rotation, _, _ = align(cloud(), cloud() * [-1, 1, 1])
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_without_scale_the_scale_is_one():
    rotation, translation, _ = motion()
    answer = align(cloud(), apply(cloud(), rotation, translation), scale=False)
    assert answer[2] == 1
    np.testing.assert_allclose(answer[0], rotation, atol=1e-10)


def test_batches_with_holes_equal_single_fits():
    source = cloud(9)
    targets = np.stack([apply(source, *motion(s)) for s in range(4)])
    targets += np.random.default_rng(0).normal(0, 1, targets.shape)
    targets[1, 3] = targets[2, :4] = np.nan
    rotations, translations, scales = align(source, targets)
    for i, target in enumerate(targets):
        seen = np.isfinite(target[:, 0])
        single = align(source[seen], target[seen])
        np.testing.assert_allclose(rotations[i], single[0], atol=1e-12)
        np.testing.assert_allclose(translations[i], single[1], atol=1e-10)
        np.testing.assert_allclose(scales[i], single[2], atol=1e-12)


def test_robust_ignores_a_third_of_wrong_pairs():
    true = motion(4)
    target = apply(cloud(30), *true)
    target[:10] += np.random.default_rng(0).normal(0, 60, (10, 3)) + 40
    rotation, translation, scale = align_robust(cloud(30), target)
    np.testing.assert_allclose(rotation, true[0], atol=1e-3)
    np.testing.assert_allclose(translation, true[1], atol=0.1)
    assert scale == pytest.approx(true[2], rel=1e-3)
    plain = align(cloud(30), target)
    assert np.abs(plain[1] - true[1]).max() > 5  # or the test would prove nothing


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (cloud(2), "at least three"),
        (np.outer(np.arange(5), [1.0, 2, 3]), "on one line"),
        (np.where(np.arange(5)[:, None] < 3, np.nan, cloud(5)), "at least three"),
        (cloud(4)[:, :2], "equally long"),
    ],
)
def test_what_cannot_be_aligned_is_refused(source, words):
    with pytest.raises(InputError, match=words):
        align(source, np.resize(cloud(9), source.shape))
