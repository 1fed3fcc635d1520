"""What the markers tell apart, on columns small enough to see through."""

from dataclasses import replace

import numpy as np
import pytest

from blendcap.data import Mesh, Rig
from blendcap.data.names import ARKIT52, mirror_map, opposite_map
from blendcap.solving.rows import marker_rows
from blendcap.solving.trust import ASTRAY, trust
from blendcap.solving.visibility import (
    UNSEEN,
    Kinship,
    held_shapes,
    joint_errors,
    lasting_noise,
    together,
    weight_errors,
)

PAIRS = np.array([1, 0, 3, 2, 5, 4])


def rows_of(columns, seen=1.0):
    """Rows of shapes (N, M, 3) for a take of ten frames; each marker is seen in the part `seen` of them."""
    moved = np.zeros((10, columns.shape[1], 3))
    moved[int(10 * seen) :] = np.nan
    return marker_rows(columns, np.empty((0, *columns.shape[1:])), moved, np.tile([0.0, 1.0], (len(columns), 1)), -1.0)


def kin(opposite=None, lids=(), eyeballs=()):
    kin, places = Kinship.of_pairs(PAIRS), np.arange(6)
    kin = replace(kin, lids=np.isin(places, lids), eyeballs=np.isin(places, eyeballs))
    return kin if opposite is None else replace(kin, opposite=opposite)


def apart():
    """Three pairs of shapes, each with a marker of its own on either side."""
    columns = np.zeros((6, 6, 3))
    columns[np.arange(6), np.arange(6), 1] = 3.0
    return columns


def test_what_has_a_marker_of_its_own_is_seen():
    rows = rows_of(apart())
    assert not held_shapes(rows, 0.3, kin()).any()
    single = np.eye(6) * 0.35**2 + 1e-12
    single[np.arange(6), PAIRS] = 0.97 * 0.35**2
    inverse = np.linalg.inv(9 / 0.09 * np.eye(6) + np.linalg.inv(single))
    expected = 1 / np.sqrt(1 / np.diag(inverse) - 1 / 0.35**2)
    assert np.allclose(joint_errors(rows, 0.3, kin(), np.zeros(6), np.ones(6, bool)), expected, rtol=1e-6)


def test_two_sides_that_are_hardly_seen_tell_together_what_they_do():
    """A half of a millimetre on either side: each alone would be held, the two are one unknown that is seen."""
    errors = together(np.array([0.4, 0.3, np.inf, 0.2, np.inf, np.inf]), PAIRS)
    assert np.allclose(errors, [0.24, 0.24, 0.2, 0.2, np.inf, np.inf])
    assert together(np.array([0.5]), np.array([0])) == 0.5  # nobody is his own partner
    noise = 1.2 * UNSEEN * 3.0
    assert (weight_errors(rows_of(apart()), noise) > UNSEEN).all()
    assert not held_shapes(rows_of(apart()), noise, kin()).any()
    assert held_shapes(rows_of(apart()), 1.5 * noise, kin()).all()


def test_two_shapes_that_look_alike_cannot_both_be_seen():
    """Each alone moves the marker by 3 mm, but none tells which of them did: one pair is held, one solved."""
    columns = apart()
    columns[2:4] = columns[0:2]
    assert (weight_errors(rows_of(columns), 0.3) < 0.2).all()
    held = held_shapes(rows_of(columns), 0.3, kin())
    assert held[:4].reshape(2, 2).all(1).sum() == 1 and held.sum() == 2
    gaze = held_shapes(rows_of(columns), 0.3, kin(lids=(0, 1), eyeballs=(2, 3)))
    assert gaze.tolist() == [False, False, True, True, False, False]


def test_opposites_are_one_unknown_with_a_sign():
    """Lid up and lid down move one marker to and fro: as they exclude each other, that marker sees both."""
    columns = apart()
    columns[2:4] = -columns[0:2]
    assert held_shapes(rows_of(columns), 0.6, kin()).any()
    assert not held_shapes(rows_of(columns), 0.6, kin(opposite=np.array([2, 3, 0, 1, 4, 5]))).any()


def test_where_no_lid_is_seen_no_gaze_is():
    """What little moves must not turn the eyes because they happen to move more markers than the lids."""
    columns = apart()
    columns[0:4] *= 0.2
    opposite = np.array([2, 3, 0, 1, 4, 5])  # lids down and up
    family = kin(opposite, lids=(0, 1, 2, 3), eyeballs=(4, 5))
    assert held_shapes(rows_of(columns), 0.3, kin(opposite)).tolist() == [True] * 4 + [False] * 2
    assert held_shapes(rows_of(columns), 0.3, family).all()
    columns[0:2] *= 5  # one of the two is enough
    assert not held_shapes(rows_of(columns), 0.3, family)[[0, 1, 4, 5]].any()


def test_a_shape_without_markers_follows_its_partner_or_rests():
    columns = apart()
    columns[1] = 0.0
    columns[4:] *= 0.01
    assert held_shapes(rows_of(columns), 0.3, kin()).tolist() == [False] * 4 + [True] * 2
    told = np.array([0, 0, 0, 0, 100.0, 100.0])
    assert not held_shapes(rows_of(columns), 0.3, kin(), told).any()


@pytest.mark.parametrize("seen", [1.0, 0.5, 0.1])
def test_a_marker_counts_as_often_as_it_is_seen(seen):
    errors = joint_errors(rows_of(apart(), seen), 0.3, Kinship.of_pairs(np.arange(6)), np.zeros(6), np.ones(6, bool))
    assert np.allclose(errors, 0.1 / np.sqrt(seen), rtol=1e-6)


def test_what_lasts_is_the_rigs_error_and_half_of_the_noise():
    assert lasting_noise(0.2, 0.2) == pytest.approx(0.1)
    assert lasting_noise(np.hypot(0.2, 0.8), 0.2) == pytest.approx(np.hypot(0.1, 0.8))


def test_opposites_of_the_vocabulary():
    opposite = opposite_map(ARKIT52)
    assert np.array_equal(opposite[opposite], np.arange(52)) and (opposite != np.arange(52)).sum() == 16
    mirror = mirror_map(ARKIT52)
    assert np.array_equal(mirror[opposite], opposite[mirror])  # what undoes on the left undoes on the right
    assert ARKIT52[opposite[ARKIT52.index("eyeBlinkLeft")]] == "eyeWideLeft"
    assert opposite_map(("head:EyeWide_L", "jaw", "head:EyeBlink_L")).tolist() == [2, 1, 0]


def test_names_of_shapes_tell_lids_eyeballs_and_what_is_quick():
    names = ("face:EyeBlink_L", "eyeWideRight", "eyeLookInLeft", "jawOpen")
    kinship = Kinship.of_rig(Rig(Mesh(np.eye(3), np.arange(3)[None]), np.zeros((4, 3, 3)), names))
    assert kinship.quick.tolist() == [True, False, False, False]
    assert kinship.lids.tolist() == [True, True, False, False]
    assert kinship.eyeballs.tolist() == [False, False, True, False]


def test_eyes_that_look_sideways_look_the_same_way():
    names = tuple(f"head:EyeLook{way}_{side}" for way in ("In", "Out", "Up") for side in "LR")
    in_left, in_right, out_left, out_right, up_left, up_right = range(6)
    mesh = Mesh(np.eye(3), np.arange(3)[None])
    rig = Rig(mesh, np.zeros((6, 3, 3)), names, mirror=mirror_map(names))
    kinship = Kinship.of_rig(rig)
    assert kinship.mirror.tolist() == [out_right, out_left, in_right, in_left, up_right, up_left]
    prior = kinship.covariance()
    assert prior[in_left, out_right] > 0 > prior[out_left, out_right]
    bare = Rig(mesh, np.zeros((6, 3, 3)), names)
    assert Kinship.of_rig(bare).mirror.tolist() == list(range(6))  # no mirror map: nobody has a partner
    lacking = rig.select([name for name in names if name != "head:EyeLookOut_R"])
    assert np.array_equal(Kinship.of_rig(lacking).mirror, lacking.mirror)


def test_trust_falls_beyond_what_is_usual():
    errors = np.array([0.5, 0.4, 0.6, 0.5, 0.5, 4.0, np.nan])
    factors = trust(errors)
    assert (factors[[0, 1, 2, 3, 4, 6]] == 1).all()
    assert factors[5] == pytest.approx((ASTRAY * 0.5 / 4.0) ** 2)
    assert (trust(np.array([0.01, 0.02, 0.59])) == 1).all()  # a small error is nobody's fault
    assert (trust(np.full(4, np.nan)) == 1).all()


def test_without_symmetry_a_shape_has_no_partner_to_follow():
    columns = apart()
    columns[1] = 0  # its partner on the other side has a marker, it has none
    told = {symmetry: held_shapes(rows_of(columns), 0.3, Kinship.of_pairs(PAIRS, symmetry)) for symmetry in (0.0, 0.97)}
    assert told[0.97].tolist() == [False] * 6
    assert told[0.0].tolist() == [False, True, False, False, False, False]
