"""Cleaning: what it repairs, and above all what it must leave alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blendcap.data import InputError, MarkerTake
from blendcap.markers.cleaning import drop_spikes, drop_unlabeled, fill_gaps, neutral_frame, rename


def moving(frames=60, markers=3, rate=60.0, names=None):
    time = np.arange(frames)[:, None, None] / rate
    base = np.random.default_rng(0).normal(0, 40, (1, markers, 3))
    positions = base + 8 * np.sin(2 * np.pi * 1.5 * time + np.arange(markers)[:, None])
    return MarkerTake(positions, names or [f"m{i}" for i in range(markers)], rate)


def without(take, frames, marker=0):
    positions = take.positions.copy()
    positions[frames, marker] = np.nan
    return MarkerTake(positions, take.names, take.rate)


def test_rename_keeps_the_rest():
    assert rename(moving(), {"m1": "Chin"}).names == ("m0", "Chin", "m2")


@pytest.mark.parametrize(("table", "words"), [({"m9": "Chin"}, "'m9'"), ({"m0": "m1"}, "'m1' 2 times")])
def test_rename_refuses(table, words):
    with pytest.raises(InputError, match=words):
        rename(moving(), table)


def test_unlabeled_trajectories_go():
    names = ["Chin", "*12", "Unlabeled 1234", "unlabelled", "uname*3", "Chin*"]
    assert drop_unlabeled(moving(markers=6, names=names)).names == ("Chin", "Chin*")
    with pytest.raises(InputError, match="labeled"):
        drop_unlabeled(moving(markers=2, names=["*1", "*2"]))


def test_short_gaps_are_filled_close_to_the_truth_and_everything_else_is_untouched():
    take = moving()
    holed = without(without(take, slice(20, 26)), slice(40, 47), marker=1)
    filled = fill_gaps(holed, longest=0.1)
    assert np.abs(filled.positions[20:26, 0] - take.positions[20:26, 0]).max() < 0.5
    assert filled.missing[40:47, 1].all()  # seven frames are longer than 0.1 s
    seen = ~holed.missing
    np.testing.assert_array_equal(filled.positions[seen], take.positions[seen])


def test_straight_motion_is_filled_exactly():
    line = np.linspace(0, 59, 60)[:, None, None] * np.array([1.0, -2, 0.5])
    take = without(MarkerTake(line, ["a"], 60), [10, 11, 12, 30])
    np.testing.assert_allclose(fill_gaps(take).positions, line, atol=1e-12)


def test_nothing_is_extrapolated():
    holed = without(without(moving(), slice(0, 3)), slice(57, 60))
    assert fill_gaps(holed, longest=10).missing[[0, 1, 2, 57, 58, 59], 0].all()
    never = without(moving(), slice(None))
    assert fill_gaps(never).missing[:, 0].all()
    once = without(moving(), np.arange(60) != 30)
    assert fill_gaps(once, longest=10).missing[:, 0].sum() == 59


@pytest.mark.parametrize("longest", [np.inf, np.nan, -0.1])
def test_a_gap_has_a_length(longest):
    with pytest.raises(InputError, match="number of seconds"):
        fill_gaps(moving(), longest)


def test_a_gap_may_be_as_long_as_any_take():
    holed = without(moving(), slice(2, 58))
    assert not fill_gaps(holed, longest=1e308).missing.any()


@given(st.lists(st.booleans(), min_size=12, max_size=40), st.integers(0, 6), st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_a_bridge_stays_between_its_ends(missing, limit, seed):
    missing = np.array(missing)
    positions = np.random.default_rng(seed).normal(0, 5, (len(missing), 1, 3))
    take = MarkerTake(np.where(missing[:, None, None], np.nan, positions), ["a"], 60)
    filled = fill_gaps(take, longest=limit / 60)
    seen = np.flatnonzero(~missing)
    for t in np.flatnonzero(missing):
        before, after = seen[seen < t], seen[seen > t]
        short = len(before) and len(after) and after[0] - before[-1] - 1 <= limit
        assert filled.missing[t, 0] != short
        if short:
            ends = take.positions[[before[-1], after[0]], 0]
            assert (filled.positions[t, 0] >= ends.min(0) - 1e-9).all()
            assert (filled.positions[t, 0] <= ends.max(0) + 1e-9).all()


def test_a_jump_out_and_back_is_removed_and_nothing_else():
    positions = moving().positions.copy()
    positions[30, 1] += [0, 20, 0]
    answer = drop_spikes(MarkerTake(positions, ["a", "b", "c"], 60))
    assert np.argwhere(answer.missing).tolist() == [[30, 1]]


def test_a_blink_is_no_spike():
    time = np.arange(60) / 60
    lid = -10 * np.exp(-(((time - 0.5) / 0.05) ** 2))  # 10 mm down and up in 0.15 s
    take = MarkerTake(np.stack([0 * lid, lid, 0 * lid], 1)[:, None], ["lid"], 60)
    assert drop_spikes(take) is take
    step = np.where(time > 0.5, 30.0, 0.0)  # a label swap that stays is no spike either
    stays = MarkerTake(np.stack([step, step, step], 1)[:, None], ["a"], 60)
    assert not drop_spikes(stays).missing.any()


def test_neutral_is_the_median_of_the_first_complete_frames():
    rest = np.random.default_rng(0).normal(0, 40, (20, 3))
    positions = np.repeat(rest[None], 40, axis=0)
    positions[:3, :5] = np.nan  # incomplete: not counted
    positions[3, 0] += 100  # an outlier within the window
    positions[13:] += 7
    take = MarkerTake(positions, [f"m{i}" for i in range(20)], 60)
    np.testing.assert_array_equal(neutral_frame(take), rest)
    np.testing.assert_array_equal(neutral_frame(take, frame=20, count=1), rest + 7)


def test_neutral_leaves_out_what_was_never_seen_there():
    take = without(moving(markers=20), slice(0, 30))
    neutral = neutral_frame(take)
    assert np.isnan(neutral[0]).all()
    assert np.isfinite(neutral[1:]).all()


@pytest.mark.parametrize("frame", [-1, 60])
def test_neutral_frame_outside_the_take(frame):
    with pytest.raises(InputError, match="0 to 59"):
        neutral_frame(moving(), frame=frame)


def test_no_neutral_in_an_unseen_take():
    with pytest.raises(InputError, match="no neutral"):
        neutral_frame(MarkerTake(np.full((4, 2, 3), np.nan), ["a", "b"], 60))
