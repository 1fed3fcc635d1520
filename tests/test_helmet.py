"""Dummy shapes: they are the tangent of a rigid motion, and their weights turn back into it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blendcap.markers.helmet import (
    paper_columns,
    paper_motion,
    pivot,
    remove_motion,
    rigid_columns,
    rigid_motion,
)

POINTS = np.random.default_rng(0).normal([0, 20, 90], [40, 60, 20], (30, 3))


def moved(motion):
    center = pivot(POINTS)
    return Rotation.from_rotvec(motion[3:]).apply(POINTS - center) + center + motion[:3]


def test_paper_translations_are_equation_34():
    ten = np.array([[10, 0, 0], [-10, 0, 0], [0, 10, 0], [0, -10, 0], [0, 0, 10], [0, 0, -10]])
    np.testing.assert_array_equal(paper_columns(POINTS)[:6], np.repeat(ten[:, None], 30, axis=1))


@pytest.mark.parametrize("axis", range(3))
def test_paper_rotations_are_the_tangent_of_90_degrees(axis):
    columns = paper_columns(POINTS)
    step = np.zeros(6)
    step[3 + axis] = 1e-6
    tangent = (moved(step) - POINTS) / 1e-6
    np.testing.assert_allclose(columns[6 + 2 * axis], tangent, atol=1e-3)
    np.testing.assert_array_equal(columns[7 + 2 * axis], -columns[6 + 2 * axis])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("angle", [-0.5, -0.05, 0.3])
def test_the_weight_of_a_rotation_shape_is_the_sine_of_the_angle(axis, angle):
    motion = np.zeros(6)
    motion[3 + axis] = angle
    signed = rigid_columns(POINTS, rotation=1.0)[3 + axis]
    weight = (signed * (moved(motion) - POINTS)).sum() / (signed**2).sum()
    assert weight == pytest.approx(np.sin(angle))
    weights = np.zeros((1, 12))
    weights[0, 6 + 2 * axis + (weight < 0)] = abs(weight)
    np.testing.assert_allclose(paper_motion(weights)[0], motion, atol=1e-9)


def test_least_squares_weights_give_a_small_motion_back():
    motion = np.array([1.5, -2, 0.7, 0.02, -0.03, 0.01])
    columns = rigid_columns(POINTS).reshape(6, -1)
    weights = np.linalg.lstsq(columns.T, (moved(motion) - POINTS).ravel(), rcond=None)[0]
    np.testing.assert_allclose(rigid_motion(weights[None])[0], motion, atol=0.003)


def test_columns_do_not_depend_on_where_the_face_stands():
    np.testing.assert_allclose(rigid_columns(POINTS + 500), rigid_columns(POINTS), atol=1e-10)


def test_missing_markers_do_not_move_the_pivot_to_nan():
    holed = np.vstack([POINTS, [[np.nan] * 3]])
    np.testing.assert_array_equal(rigid_columns(holed)[:, :30], rigid_columns(POINTS))


def test_remove_motion_is_the_exact_inverse():
    motions = np.random.default_rng(1).normal(0, [5, 5, 5, 0.3, 0.3, 0.3], (6, 6))
    takes = np.stack([moved(m) for m in motions])
    np.testing.assert_allclose(remove_motion(takes, motions, pivot(POINTS)), np.stack([POINTS] * 6), atol=1e-10)


def test_rest_is_no_motion():
    assert (rigid_motion(np.zeros((2, 6))) == 0).all()
    assert (paper_motion(np.zeros((2, 12))) == 0).all()
