"""How far markers and tracks err, and which samples are left out: recovered noise, closed forms, limits."""

import numpy as np
import pytest

from blendcap.solving.rows import MarkerRows, marker_rows
from blendcap.solving.trust import BLAMELESS, HARMLESS, marker_errors, overall, trust, without_strays

SHAPES, FRAMES, NOISE = 4, 3000, 0.7
FULL, ACROSS, ALONG = np.eye(3), np.diag([1.0, 1, 0]), np.diag([1.0, 0, 0])


def rows_of(axes: list[np.ndarray], displacements: np.ndarray) -> MarkerRows:
    """Rows of markers and tracks by their axes; their deltas are random."""
    deltas = np.random.default_rng(1).normal(size=(SHAPES, len(axes), 3))
    bounds = np.tile([0.0, 1.0], (SHAPES, 1))
    return marker_rows(deltas, np.empty((0, len(axes), 3)), displacements, bounds, -1.0, np.array(axes))


def test_the_noise_that_a_fit_leaves_is_recovered_of_markers_and_of_tracks():
    """What the fit swallows (its hat matrix tells) is put back: here a third of all coordinates."""
    noise = np.random.default_rng(0).normal(scale=NOISE, size=(FRAMES, 6, 3))
    rows = rows_of([FULL, FULL, ACROSS, ACROSS, ALONG, ALONG], noise)
    unknowns = np.linalg.solve(rows.gram, -rows.linear.T).T
    leverage = np.einsum("mki,ij,mkj->m", rows.rows, np.linalg.inv(rows.gram), rows.rows)
    assert leverage.sum() == pytest.approx(SHAPES)
    np.testing.assert_allclose(overall(rows, unknowns, leverage, np.ones(6)), NOISE, rtol=0.02)
    np.testing.assert_allclose(marker_errors(rows, unknowns, leverage), NOISE, rtol=0.05)


@pytest.mark.parametrize("swallowed", [0.0, 0.3, 0.6])
def test_an_error_in_each_coordinate_is_the_same_error_however_many_a_track_tells(swallowed):
    rows = rows_of([FULL, ACROSS, ALONG, np.diag([1.0, 0.5, 0]), np.diag([0.0, 0.3, 0])], np.full((4, 5, 3), NOISE))
    leverage, none = swallowed * rows.coordinates, np.zeros((4, SHAPES))
    expected = NOISE / np.sqrt(1 - swallowed)
    np.testing.assert_allclose(marker_errors(rows, none, leverage), expected, rtol=1e-12)
    np.testing.assert_allclose(overall(rows, none, leverage, np.ones(5)), expected, rtol=1e-12)


def test_who_is_never_seen_has_no_error_and_is_trusted():
    moved = np.full((4, 3, 3), NOISE)
    moved[:, 1] = np.nan
    errors = marker_errors(rows_of([FULL, FULL, ACROSS], moved), np.zeros((4, SHAPES)), np.zeros(3))
    np.testing.assert_allclose(errors, [NOISE, np.nan, NOISE], rtol=1e-12)
    np.testing.assert_array_equal(trust(errors), 1)


def test_who_errs_twice_as_far_as_is_forgiven_counts_a_quarter():
    errors = np.array([1.0, 1, 1, 1, 2, 4, 8])
    np.testing.assert_allclose(trust(errors), [1, 1, 1, 1, 1, 1 / 4, 1 / 16])
    np.testing.assert_array_equal(trust(0.1 * BLAMELESS * errors), 1)  # all are so good that none is blamed


def strayed(usual: float, times: float) -> bool:
    """Whether a track's sample that errs so many times the usual error, mm, is left out, and all others stay."""
    moved = np.zeros((20, 4, 3))
    moved[:, 2:, 0] = usual
    moved[7, 2, 0] = times * usual
    moved[9, 0] = 100 * usual  # a marker, which never is
    missing = without_strays(rows_of([FULL, FULL, ACROSS, ALONG], moved), np.zeros((20, SHAPES))).missing
    assert not missing.any() or np.argwhere(missing).tolist() == [[7, 2]]
    return bool(missing.any())


def test_a_sample_that_errs_five_times_as_far_as_usual_is_left_out_and_one_that_errs_twice_stays():
    assert not strayed(0.4, 2.0) and not strayed(0.4, 2.9)
    assert strayed(0.4, 3.1) and strayed(0.4, 5.0)
    assert not strayed(0.1 * HARMLESS, 9.0) and strayed(0.1 * HARMLESS, 11.0)
