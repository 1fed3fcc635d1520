"""Blinks on the performer's own scale: what the gain rests on, and what it must not depend on."""

import numpy as np
import pytest

from blendcap.makeup.blinks import SHUT, STRONG, blink_heights, with_full_blinks

UNITS = ("AU45L", "AU4", "AU45R")
REST = np.zeros((60, 3))


def take(heights, sides=(1.0, 0.5, 1.0), seed=0) -> np.ndarray:
    """(T, 3) blinks of these heights, from rest to rest, over a little noise."""
    hump = np.sin(np.linspace(0, np.pi, 9)) ** 2
    track = np.concatenate([np.r_[np.zeros(20), height * hump, np.zeros(20)] for height in heights])
    told = np.outer(track, sides)
    return np.maximum(told + np.random.default_rng(seed).normal(scale=0.01, size=told.shape) * (told > 0), 0)


def gain_of(told: np.ndarray) -> float:
    scaled = with_full_blinks(told, UNITS)
    some = (told[:, 0] > 0.1) & (scaled[:, 0] < 1)
    ratios = scaled[some, 0] / told[some, 0]
    np.testing.assert_allclose(ratios, ratios[0])
    return float(ratios[0])


def test_the_strongest_blinks_shut_both_eyes_and_nothing_else_grows():
    told = take([0.65, 0.75, 0.7, 0.75], sides=(1.0, 1.0, 0.95))
    scaled = with_full_blinks(told, UNITS)
    heights = blink_heights(scaled[:, [0, 2]])
    assert np.quantile(heights, STRONG, method="inverted_cdf") == pytest.approx(SHUT) and heights.max() < 0.98
    np.testing.assert_array_equal(scaled[:, 1], told[:, 1])
    # One gain: the side that closes less still does.
    np.testing.assert_allclose(scaled[:, 2], gain_of(told) * told[:, 2], atol=1e-12)


def test_blinks_that_are_told_more_than_shut_come_down_to_shut_and_keep_their_differences():
    told = take([1.2, 1.22, 0.8, 1.21])
    scaled = with_full_blinks(told, UNITS)
    assert 0.7 < gain_of(told) < 0.85
    heights = blink_heights(scaled[:, [0, 2]])
    assert np.quantile(heights, STRONG, method="inverted_cdf") == pytest.approx(SHUT, abs=0.02)
    assert heights.min() / heights.max() == pytest.approx(0.8 / 1.22, abs=0.02)


@pytest.mark.parametrize(
    "told",
    [take([0.9, 0.95, 3.5]), take([0.95, 1.0, 1.9]), take([1.0] * 5 + [1.9] * 2)],
    ids=["a noisy frame", "a squeeze", "two squeezes"],
)
def test_closings_that_are_told_much_more_strongly_do_not_hold_blinks_open(told):
    heights = blink_heights(with_full_blinks(told, UNITS)[:, [0, 2]])
    assert len(heights) == told.shape[0] // 49 and heights.min() > 0.84


def test_a_lid_that_trembles_while_it_is_shut_closes_once():
    shut = 1.6 + 0.3 * np.sin(np.arange(60))[:, None] * np.ones(3)
    assert len(blink_heights(np.concatenate([REST, shut, REST])[:, [0, 2]])) == 1


def test_the_gain_does_not_depend_on_the_length_of_the_take():
    told = take([0.63, 0.7, 0.3, 0.65])
    gain, lengths = gain_of(told), []
    assert 1.3 < gain < 1.5
    for other in (
        np.concatenate([told] + [REST] * 100),
        np.concatenate([REST, told]),
        np.concatenate([told] * 7),
        told[::-1],
        told[:, ::-1],
    ):
        assert gain_of(other) == gain
        lengths.append(len(other))
    assert max(lengths) > 30 * len(told)


def test_exchanged_sides_give_exchanged_answers():
    told = take([0.65, 0.75, 0.7], sides=(1.0, 0.2, 0.9))
    np.testing.assert_array_equal(with_full_blinks(told[:, ::-1], UNITS), with_full_blinks(told, UNITS)[:, ::-1])


@pytest.mark.parametrize(
    "told",
    [
        take([0.7, 0.7]),
        take([0.55] * 9),  # lids that never close by half
        take([0.9] * 9, sides=(1.0, 0.0, 0.2)),  # winks
        np.concatenate([np.full((50, 3), 0.7)] * 3) + 0.02 * np.sin(np.arange(150))[:, None],  # half shut
        np.zeros((0, 3)),
    ],
    ids=["few", "shallow", "winks", "half shut", "empty"],
)
def test_without_blinks_that_tell_a_scale_nothing_changes(told):
    np.testing.assert_array_equal(with_full_blinks(told, UNITS), told)


def test_winks_do_not_change_the_gain_of_the_blinks():
    blinks, winks = take([0.7, 0.72, 0.68]), take([0.9] * 5, sides=(1.0, 0.0, 0.1))
    both = np.concatenate([blinks, winks])
    np.testing.assert_array_equal(with_full_blinks(both, UNITS)[: len(blinks)], with_full_blinks(blinks, UNITS))
    assert gain_of(both[: len(blinks)]) > 1.2


def test_one_lid_for_both_sides_and_no_lid_at_all():
    told = take([0.7] * 4)
    assert with_full_blinks(told[:, :1], ("AU43",)).max() == pytest.approx(SHUT, abs=0.04)
    np.testing.assert_array_equal(with_full_blinks(told[:, :2], ("AU4", "AU9L")), told[:, :2])
