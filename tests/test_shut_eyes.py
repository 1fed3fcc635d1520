"""Shut eyes of a neutral scan: noticed from the lines of the lids, and left to the template."""

import numpy as np
import pytest

import blendcap
from blendcap.modeling.landmark_names import line_names, rig_landmarks
from blendcap.modeling.shut_eyes import keep_eyes_open

RIG = blendcap.mannequin(shapes=52)
POINTS = rig_landmarks(RIG)


def scanned(**weights):
    """Landmarks on the mannequin itself, in this pose and in centimetres."""
    vector = np.zeros(len(RIG.names))
    for name, weight in weights.items():
        vector[RIG.index(name)] = weight
    return POINTS, POINTS.positions(RIG.mesh.with_vertices(RIG.pose(vector))) / 10


@pytest.mark.parametrize("weight", [0.0, 0.4])
def test_open_eyes_are_left_alone(weight):
    pairs = scanned(eyeBlinkLeft=weight, eyeBlinkRight=weight)
    answer = keep_eyes_open(RIG, pairs)
    assert answer.pairs is pairs and not len(answer.free) and not answer.notes


def test_shut_eyes_lose_their_lines_and_free_their_lids():
    points, places = scanned(eyeBlinkLeft=1.0, eyeBlinkRight=1.0)
    (kept, there), free, notes = keep_eyes_open(RIG, (points, places))
    assert not any(name.startswith("lids_") for name in kept.names)
    assert {"eye_outer_left", "eye_inner_right", "lips_upper_1"} <= set(kept.names)
    np.testing.assert_array_equal(there, places[[points.names.index(name) for name in kept.names]])
    assert len(notes) == 1 and "eyes are shut" in notes[0]
    edges = np.unique(np.concatenate([RIG.contacts["lids_left"], RIG.contacts["lids_right"]]))
    assert np.isin(edges, free).all()
    assert not np.isin(RIG.regions["lips"], free).any() and not np.isin(RIG.regions["jaw"], free).any()


@pytest.mark.parametrize(("share", "shut"), [(0.3, True), (0.4, False)])
def test_an_eye_is_shut_below_a_third_of_the_templates_opening(share, shut):
    places = POINTS.positions(RIG.mesh)
    for side in ("left", "right"):
        upper, lower = ([POINTS.names.index(n) for n in line_names(f"lids_{e}_{side}")] for e in ("upper", "lower"))
        middle, half = (places[upper] + places[lower]) / 2, (places[upper] - places[lower]) / 2
        places[upper], places[lower] = middle + share * half, middle - share * half
    assert bool(keep_eyes_open(RIG, (POINTS, places)).notes) == shut


def test_a_wink_frees_one_eye():
    (kept, _), free, notes = keep_eyes_open(RIG, scanned(eyeBlinkLeft=1.0))
    assert "lids_upper_right_1" in kept.names and "lids_upper_left_1" not in kept.names
    assert (RIG.mesh.vertices[free, 0] > 0).all() and "eye is shut" in notes[0]


def test_without_landmarks_nothing_is_known():
    assert keep_eyes_open(RIG, None).pairs is None
