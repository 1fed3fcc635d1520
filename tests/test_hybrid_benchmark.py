"""The counting in benchmarks/hybrid.py: what is told early or late, and what is not."""

from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = str(Path(__file__).resolve().parent.parent / "benchmarks")


@pytest.fixture
def hybrid(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import hybrid

    return hybrid


def test_near_reaches_so_many_frames_and_does_not_wrap_around(hybrid):
    flags = np.zeros((9, 2), dtype=bool)
    flags[[0, 8], [0, 1]] = True
    near = hybrid._near(flags, 2)
    np.testing.assert_array_equal(near[:, 0], np.arange(9) <= 2)
    np.testing.assert_array_equal(near[:, 1], np.arange(9) >= 6)
    np.testing.assert_array_equal(hybrid._near(flags, 0), flags)


def test_hits_are_precision_and_recall_with_and_without_tolerance(hybrid):
    true = np.repeat([False, True, False], [4, 3, 4])
    late = np.roll(true, 1)
    assert hybrid._hits(late, true) == "0.67, 0.67 (1.00, 1.00)"
    assert hybrid._hits(true, true) == "1.00, 1.00 (1.00, 1.00)"
    first, last = np.arange(11) == 0, np.arange(11) == 10
    assert hybrid._hits(first, last) == "0.00, 0.00 (0.00, 0.00)"
