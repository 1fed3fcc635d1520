"""Contact pairs by proximity, and the rule of which pairs meet."""

from dataclasses import replace

import numpy as np

from blendcap import mannequin
from blendcap.modeling.closing import wanted_gaps
from blendcap.modeling.contacts import drivers_of, find_contacts, gaps
from sheet import sheet_rig


def test_pairs_are_found_again_where_the_mannequin_has_them():
    rig = mannequin(shapes=52)
    found = find_contacts(replace(rig, contacts={}))
    assert set(found) == {"lips", "lids_left", "lids_right"}
    for name, pairs in found.items():
        known = {frozenset(pair) for pair in rig.contacts[name].tolist()}
        same = sum(frozenset(pair) in known for pair in pairs.tolist())
        assert same >= 0.5 * len(known), name  # the rest lie a row deeper, where lids and lips touch too
        sides = {"lids_left": {1}, "lids_right": {-1}, "lips": {-1, 0, 1}}[name]
        assert set(np.sign(rig.mesh.vertices[pairs, 0]).ravel()) == sides


def test_pairs_close_in_the_pose_that_finds_them_and_part_in_the_other():
    rig = mannequin(5, shapes=52)
    pairs = find_contacts(replace(rig, contacts={}))["lids_left"]
    closed = np.zeros(len(rig.names))
    closed[rig.index("eyeBlinkLeft")] = 1
    assert gaps(rig.pose(closed), pairs).max() < 1.5
    assert gaps(rig.mesh.vertices, pairs).max() > 4.5


def test_a_rig_without_the_names_has_no_contacts():
    rig = sheet_rig()
    nameless = replace(rig, names=tuple(f"shape {i}" for i in range(len(rig.names))), combinations={}, contacts={})
    assert find_contacts(nameless) == {}


def test_arkits_rule_says_what_drives_mouth_close():
    rig = sheet_rig()
    assert drivers_of(replace(rig, combinations={}), "mouthClose") == (rig.index("jawOpen"),)
    assert drivers_of(rig, "jawOpen") == ()


def test_what_closes_takes_the_templates_gap_and_what_stays_closed_its_change():
    base = np.array([[0, 8.0, 0], [0, 0.2, 0], [0, 8.0, 0]])
    change = np.array([[0, -7.5, 0], [0, 0.1, 0], [0, -2.0, 0]])
    own = np.array([[0, 10.0, 0], [0, 0.6, 0], [0, 10.0, 0]])
    wanted, meets = wanted_gaps(base, change, own, 1.0)
    np.testing.assert_array_equal(meets, [True, True, False])
    np.testing.assert_allclose(own[0] + wanted[0], [0, 0.5, 0])
    np.testing.assert_allclose(wanted[1], change[1])
