"""Catmull-Clark as a linear map: closed forms on a cube and a strip, sharp rings, the fit, the chart, the ears."""

import numpy as np
import pytest

from blendcap.synthetic.mannequin.atlas import FLOOR
from blendcap.synthetic.mannequin.cage import head_cage, ring
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.mannequin.subdivision import refined, subdivide

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
SIDES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
NONE = np.array([], dtype=int)
OPPOSITE = np.array([4, 5, 6, 7, 0, 1, 2, 3])  # mirrored in x


def cube(levels=1, sharpness=None, corners=NONE, chains=()):
    return subdivide(8, SIDES, sharpness or {}, corners, OPPOSITE, chains, levels)


def test_a_cube_gives_the_points_of_catmull_and_clark():
    surface = cube()
    points = surface.matrix @ CUBE
    assert points.shape == (8 + 12 + 6, 3)
    assert np.abs(points[:8]) == pytest.approx(np.full((8, 3), 5 / 9))  # (F + 2 R) / 3 at valence 3
    assert np.sort(np.abs(points[8:20]), axis=1) == pytest.approx(np.tile([0, 0.75, 0.75], (12, 1)))
    assert np.sort(np.abs(points[20:]), axis=1) == pytest.approx(np.tile([0, 0, 1], (6, 1)))


def test_the_map_keeps_constants_and_mirror_images():
    for surface in (cube(3), shared().surface):
        assert np.asarray(surface.matrix.sum(1)).ravel() == pytest.approx(np.ones(surface.matrix.shape[0]))
    points = cube(3).matrix @ CUBE
    assert points[cube(3).twins] == pytest.approx(points * [-1, 1, 1])


def test_a_sharp_ring_is_a_spline_of_its_own_points():
    """The ring 0-1-3-2 of the cube: one level of a cubic B-spline, whatever the other points do."""
    ends = {(0, 1): 10.0, (1, 3): 10.0, (2, 3): 10.0, (0, 2): 10.0}
    loop = np.array([0, 1, 3, 2, 0])
    surface = cube(1, ends, chains=[loop])
    assert surface.chains[0][::2].tolist() == loop.tolist()
    points = CUBE[loop[:-1]]
    fine = surface.matrix[surface.chains[0][:-1]] @ CUBE
    spline = np.empty((8, 3))
    spline[::2] = 0.125 * np.roll(points, 1, axis=0) + 0.75 * points + 0.125 * np.roll(points, -1, axis=0)
    spline[1::2] = 0.5 * (points + np.roll(points, -1, axis=0))
    assert fine == pytest.approx(spline)


def test_corners_stay_where_they_are():
    surface = cube(2, corners=np.array([3]))
    assert (surface.matrix @ CUBE)[3] == pytest.approx(CUBE[3])


def test_lid_and_lip_rings_depend_on_themselves_alone():
    cage, surface = head_cage(), shared().surface
    for number, names in ((0, ring("seam", 5)), (2, ring("margin", 7))):
        own = cage.index(names)
        own = np.concatenate(
            [own, cage.twin[own], cage.index(ring("margin" if number else "seam", 12 if number else 9))]
        )
        rows = surface.matrix[surface.chains[number]]
        assert set(rows.indices[rows.data > 1e-12]) <= set(own)


def test_the_surface_passes_the_authored_points():
    cage, surface = head_cage(), shared().surface
    targets = cage.mirrored(cage.half)
    off = np.linalg.norm(surface.through(targets)[: cage.size] - targets, axis=1)
    assert off.mean() < 0.4  # mm
    assert off.max() < 3.0
    plain = np.linalg.norm((surface.matrix @ targets)[: cage.size] - targets, axis=1)
    assert off.mean() < plain.mean() / 5  # without the fit it is a melted face


def test_fitting_is_linear():
    rng, surface = np.random.default_rng(0), shared().surface
    one, other = rng.normal(size=(2, head_cage().size, 3))
    both = surface.through(2 * one - other)
    assert both == pytest.approx(2 * surface.through(one) - surface.through(other))


def test_children_share_their_parents_corner_values():
    corners = np.arange(8.0).reshape(1, 4, 2)
    fine = refined(corners, 1)
    assert fine.shape == (4, 4, 2)
    assert fine[:, 0] == pytest.approx(corners[0])
    assert fine[:, 2] == pytest.approx(np.tile(corners.mean(1), (4, 1)))


def test_the_chart_of_the_face_does_not_fold():
    """Skin in front of the ears, without the rims of eyes and mouth, where a cylinder stands on edge."""
    head = shared()
    corners = head.atlas.uv[head.atlas.quads[: len(head.surface.quads)]]
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    charted = (corners[:, :, 1] > FLOOR).all(1)
    assert (area[charted] <= 0).mean() < 0.01
    cheeks = np.isin(head.surface.quads, np.concatenate([head.regions[k] for k in ("cheeks", "forehead", "jaw")])).all(
        1
    )
    assert (area[cheeks] > 0).all()


def test_the_ears_are_sculpted_and_nothing_else():
    head = shared()
    moved = np.linalg.norm(head.auricles, axis=1) > 1e-9
    assert set(np.flatnonzero(moved)) <= set(head.regions["ears"])
    ear = head.rest[head.regions["ears"]]
    ear = ear[ear[:, 0] > 0]
    assert 55 < np.ptp(ear[:, 1]) < 72  # mm, Farkas: 59 to 67
    assert 26 < np.ptp(ear[:, 2]) < 48
