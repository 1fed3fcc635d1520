"""How weakly units are told of paint that lies elsewhere, and what makes up for it."""

import numpy as np
import pytest

from blendcap.makeup.scales import BENDS, GAINS, fit_scales, scaled

TRUE = np.tile(np.concatenate([np.zeros(40), np.linspace(0, 1, 60), np.zeros(40)])[:, None], 3)
UNITS = ("AU4L", "AU4R", "AU18")


def test_what_was_told_too_weakly_comes_back():
    told = np.stack([(TRUE[:, 0] / 2.5) ** (1 / 1.6), (TRUE[:, 1] / 2.5) ** (1 / 1.6), TRUE[:, 2] / 1.5], axis=1)
    scales = fit_scales(told, TRUE, UNITS)
    np.testing.assert_allclose(scales, [[2.5, 1.6], [2.5, 1.6], [1.5, 1.0]], atol=1e-3)
    np.testing.assert_allclose(scaled(told, scales).clip(0, 1), TRUE, atol=1e-3)


def test_noise_at_rest_bends_the_scale_and_does_not_grow():
    rng = np.random.default_rng(0)
    told = np.where(TRUE > 0, 0.5 * TRUE, 0.15 * rng.random(TRUE.shape))
    scales = fit_scales(told, TRUE, UNITS)
    assert (scales[:, 0] > 2).all() and (scales[:, 1] > 1.1).all()
    rest = np.array([[0.1, 0.1, 0.1]])
    assert (scaled(rest, scales) < 0.17).all()  # twice as much, without the bend
    best = ((scaled(told, scales) - TRUE) ** 2).mean()
    for other in ([1.0, 1.0], [2.0, 1.0], [2.0, 2.0]):
        assert best < ((scaled(told, np.tile(other, (3, 1))) - TRUE) ** 2).mean()


def test_both_sides_have_one_scale_and_exchanged_sides_the_same():
    told = TRUE * [0.4, 0.6, 1.0]
    scales = fit_scales(told, TRUE, UNITS)
    np.testing.assert_array_equal(scales[0], scales[1])
    assert 1 / 0.6 < scales[0, 0] < 1 / 0.4
    np.testing.assert_allclose(fit_scales(told[:, [1, 0, 2]], TRUE, UNITS), scales, atol=1e-5)


@pytest.mark.parametrize("most", [0.0, 0.05])
def test_a_unit_that_is_never_shown_keeps_its_word(most):
    told = np.random.default_rng(0).random(TRUE.shape)
    np.testing.assert_array_equal(fit_scales(told, most * TRUE, UNITS), np.ones((3, 2)))
    np.testing.assert_array_equal(scaled(told, np.ones((3, 2))), told)


def test_less_than_nothing_is_rest_and_more_than_the_teacher_s_full_is_that():
    told = np.array([[-0.5, 0.0, 0.3, 1.0, 2.0]]).T
    np.testing.assert_allclose(scaled(told, np.array([[2.0, 1.5]]))[:, 0], [0, 0, 2 * 0.3**1.5, 2, 2])


@pytest.mark.parametrize("gain", [0.7, 3.5])
def test_gains_from_less_than_one_to_saturation_are_found(gain):
    true = min(gain, 1) * TRUE
    told = (true / gain) ** (1 / 1.3)
    np.testing.assert_allclose(fit_scales(told, true, UNITS), np.tile([gain, 1.3], (3, 1)), atol=1e-3)
    told = np.where(TRUE == 1, 1.0, told)  # more than full is full
    assert np.abs(scaled(told, fit_scales(told, true, UNITS)).clip(0, 1) - true).max() < 0.01


def test_of_several_lows_the_lowest_is_taken():
    rng = np.random.default_rng(3)
    told = np.clip(0.35 * TRUE + 0.1 * np.abs(rng.normal(size=TRUE.shape)), 0, 1)
    costs = [
        ((scaled(told, np.tile([gain, bend], (3, 1))).clip(0, 1) - TRUE) ** 2)[:, 2].sum()
        for gain in np.linspace(*GAINS, 36)
        for bend in np.linspace(*BENDS, 21)
    ]
    found = ((scaled(told, fit_scales(told, TRUE, UNITS)).clip(0, 1) - TRUE) ** 2)[:, 2].sum()
    assert found <= min(costs) + 1e-6


def test_of_whom_nothing_is_told_keeps_the_word():
    np.testing.assert_allclose(fit_scales(0 * TRUE, TRUE, UNITS), np.ones((3, 2)))
