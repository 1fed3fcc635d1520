"""The counting of the hybrid benchmark: what is told early or late, and what is not."""

import numpy as np
import pytest


@pytest.fixture
def counts(benchmark_module):
    return benchmark_module("hybrid_counts")


def test_near_reaches_so_many_frames_and_does_not_wrap_around(counts):
    flags = np.zeros((9, 2), dtype=bool)
    flags[[0, 8], [0, 1]] = True
    near = counts.near(flags, 2)
    np.testing.assert_array_equal(near[:, 0], np.arange(9) <= 2)
    np.testing.assert_array_equal(near[:, 1], np.arange(9) >= 6)
    np.testing.assert_array_equal(counts.near(flags, 0), flags)


def test_hits_are_precision_and_recall_with_and_without_tolerance(counts):
    true = np.repeat([False, True, False], [4, 3, 4])
    late = np.roll(true, 1)
    assert counts.hits(late, true) == "0.67, 0.67 (1.00, 1.00)"
    assert counts.hits(true, true) == "1.00, 1.00 (1.00, 1.00)"
    first, last = np.arange(11) == 0, np.arange(11) == 10
    assert counts.hits(first, last) == "0.00, 0.00 (0.00, 0.00)"


def test_closings_are_counted_whole(counts):
    true = np.zeros((40, 2), dtype=bool)
    true[5:9], true[20:30, 0] = True, True  # three: both eyes blink, the right one winks
    said = np.zeros_like(true)
    said[10:12, 0], said[8:20, 1], said[34:36] = True, True, True
    assert counts.blinks(true, true) == "1.00, 1.00"
    assert counts.blinks(said, true) == "0.50, 0.67"  # told twice where nothing was, and the wink is not told
    assert counts.blinks(np.zeros_like(true), true) == "0.00, 0.00"
