"""A painted cloth followed through motion wilder than a face's: what is foretold, what is carried on, what is lost."""

import numpy as np
import pytest

from blendcap.makeup.follower import FARTHEST
from blendcap.rendering import project
from cloth import CAMERA, blobs, filmed, strokes


def test_leaps_that_the_solve_foretells_are_followed():
    """By 32 pixels from one frame to the next, three times as far as a point is sought."""
    film = filmed(slide=[0, 1, 0, 0.6])
    off = film.off(film.follow())
    assert off.shape[1] > 150 and np.nanmax(off) < 0.15 and not np.isnan(off).any()


def test_windows_are_warped_as_the_solve_foretells():
    """An upright square of the cloth becomes a rhomb of 40 degrees, and no window looks as it did."""
    film = filmed(shear=[0, 0.6, 1, 0.2])
    tracks = film.follow()
    assert tracks.lost.mean() < 0.05
    assert np.nanmedian(film.off(tracks), axis=1).max() < 0.15 and np.nanmax(film.off(tracks)) < 0.6


def test_motion_that_no_shape_explains_is_carried_on_from_frame_to_frame():
    """By two pixels a frame, until the paint is farther away than a point is sought."""
    film = filmed(drift=2.0 * np.arange(9))
    assert film.drift[-1] > 1.5 * FARTHEST
    tracks = film.follow()
    off = film.off(tracks)
    assert (tracks.lost.mean(1) < 0.4).all() and np.nanmedian(off, axis=1).max() < 0.05


def test_it_is_kept_through_a_frame_in_which_all_is_lost():
    film = filmed(drift=[0, 3, 6, 9, 9, 9, 9])
    tracks = film.follow(dark=(4,))
    lost = tracks.lost.mean(1)
    assert lost[4] == 1 and (lost[5:] < lost[3] + 0.1).all()
    assert np.nanmedian(film.off(tracks)[5:]) < 0.05


def test_only_what_is_surely_seen_is_carried_on():
    """Along upright strokes noise moves a point up and down in every frame, but not farther and farther."""
    tracks = filmed(drift=np.zeros(25)).follow(strokes, noise=5.0)
    found = project(tracks.positions, CAMERA)[0]
    wandered = np.percentile(np.abs(found - found[0])[..., 1], 90, axis=1)
    assert not tracks.lost.any() and wandered[15:].max() < 1.2


@pytest.mark.parametrize(("leap", "lost"), [(6.0, False), (12.0, True)])
def test_what_is_found_too_far_from_where_it_is_sought_is_lost(leap, lost):
    """Wide blobs can be found again from far away, but so can other blobs."""
    film = filmed(drift=[0, leap])
    tracks = film.follow(lambda x, y: blobs(x, y, size=4.0, apart=48))
    assert (tracks.lost[1].mean() > 0.8) == lost and (tracks.lost[1].mean() < 0.3) == (not lost)
    found = project(tracks.positions, CAMERA)[0]
    assert np.nanmax(np.linalg.norm(found[1] - found[0], axis=1)) < FARTHEST


def test_tracks_on_upright_strokes_tell_what_goes_sideways_and_nothing_else():
    axes = filmed().follow(strokes).axes
    across, along = np.linalg.norm(axes, axis=2).T
    assert (across > 0.8).all() and (along < 0.1).all()
    np.testing.assert_allclose(np.abs(axes[:, 0] / across[:, None]) @ [1, 0, 0], 1, atol=0.03)
