"""Points of a painted cloth that can be followed: where they may lie, what of their windows counts, and how surely."""

import numpy as np
import pytest

from blendcap import Rig
from blendcap.makeup.matching import REACH
from blendcap.makeup.skin_points import FACING, SkinPoints, skin_points
from cloth import CAMERA, FINE, HALF, MIDDLE, STEP, blobs, cloth_rig, filmed, picture, strokes


def points_on(rig: Rig, paint=blobs) -> SkinPoints:
    return skin_points(picture(paint).astype(np.float32), rig, filmed().binding, CAMERA)


@pytest.mark.parametrize(("degrees", "followed"), [(0, True), (50, True), (72, False), (80, False)])
def test_skin_that_turns_away_is_not_followed(degrees, followed):
    """The right half of the cloth is bent back, but the picture has contrast all over."""
    tilt = np.deg2rad(degrees)
    points = points_on(cloth_rig(tilt))
    normals = np.where(points.rest[:, :1] > 0, [np.sin(tilt), 0, np.cos(tilt)], [0, 0, 1])
    sight = CAMERA.position - points.rest
    cosine = (normals * sight).sum(1) / np.linalg.norm(sight, axis=1)
    off_the_edge = np.abs(points.rest[:, 0]) > 2 * STEP  # where normals are between those of both halves
    assert (cosine[off_the_edge] > FACING - 0.01).all()
    assert (points.rest[:, 0] < -2 * STEP).sum() > 50
    assert ((points.rest[:, 0] > 2 * STEP * np.cos(tilt)) & off_the_edge).any() == followed


def test_of_a_window_only_skin_counts_that_moves_as_its_middle_does():
    """The upper half of the cloth and the lower are pulled apart, as lips are; beyond its border is nothing."""
    points = points_on(cloth_rig(torn=True))
    arms = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1][::-1].transpose(1, 2, 0)
    around = (points.pixels[:, None, None] + arms - MIDDLE) / FINE * [1, -1]
    side = np.sign(around[..., 1])
    belongs = (side == side[:, REACH, REACH][:, None, None]) & (np.abs(around) < HALF - STEP / 2).all(-1)
    told = np.abs(around[..., 1]) > STEP / 2  # the torn row of triangles itself belongs to neither half
    told &= told[:, REACH, REACH][:, None, None]
    np.testing.assert_array_equal((points.windows.counts > 0)[told], belongs[told])
    assert 0.02 < (~belongs[told]).mean() < 0.5
    np.testing.assert_allclose(points.windows.counts.sum((1, 2)), 1, rtol=1e-5)


def test_along_a_stroke_nothing_is_sure():
    axes = points_on(cloth_rig(), strokes).axes
    across, along = np.linalg.norm(axes, axis=2).T
    assert (across > 0.8).all() and (along < 0.1).all()
    assert (np.abs(axes[:, 0, 0]) > 0.98 * across).all()  # the strokes are upright


def test_half_the_contrast_of_paint_is_a_quarter_of_the_odds():
    """The odds of a direction, a² to 1 - a², are its contrast squared against that of plain skin; light is neither."""
    odds = []
    for paint in (blobs, lambda x, y: blobs(x, y, contrast=80)):
        points = points_on(cloth_rig(), paint)
        squared = (points.axes[:, 0] ** 2).sum(1)
        odds.append(dict(zip(map(tuple, points.pixels), squared / (1 - squared), strict=True)))
    both = sorted(set(odds[0]) & set(odds[1]))
    assert len(both) > 40
    assert np.median([odds[0][p] / odds[1][p] for p in both]) == pytest.approx(4, rel=0.1)


def test_half_the_light_changes_no_point():
    seen = picture().astype(np.float32)
    bright, dim = (skin_points(p, cloth_rig(), filmed().binding, CAMERA) for p in (seen, 0.5 * seen))
    np.testing.assert_array_equal(bright.pixels, dim.pixels)
    np.testing.assert_allclose(np.abs(bright.axes), np.abs(dim.axes), atol=1e-5)
