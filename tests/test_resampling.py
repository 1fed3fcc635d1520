"""Values at the frames of another rate."""

import numpy as np

from blendcap.numerics.resampling import at_times


def test_a_line_stays_a_line_and_frames_stay_frames():
    line = np.arange(11.0)[:, None] * [1.0, -2.0]
    np.testing.assert_allclose(at_times(line, 10.0, np.array([0.0, 0.234, 1.0])), [[0, 0], [2.34, -4.68], [10, -20]])
    np.testing.assert_array_equal(at_times(line, 10.0, np.arange(11) / 10), line)
    np.testing.assert_array_equal(at_times(line, 10.0, np.array([-5.0, 5.0])), line[[0, -1]])


def test_a_gap_reaches_to_its_neighbours_and_not_beyond():
    values = np.array([0.0, np.nan, 2.0, 3.0])
    told = at_times(values, 1.0, np.array([0.0, 0.5, 1.5, 2.0, 2.5]))
    np.testing.assert_array_equal(np.isnan(told), [False, True, True, False, False])
