"""Names of shapes."""

from dataclasses import replace

import numpy as np
import pytest

from blendcap.data import Animation, InputError
from blendcap.data.names import (
    ARKIT52,
    HEAD_AND_EYES,
    canonical,
    in_vocabulary,
    match,
    mirror_map,
    mirror_name,
    without_place,
)


@pytest.mark.parametrize(
    "name",
    ["eyeBlink_L", "EyeBlinkLeft", "eyeBlinkLeft", "eyeBlink_left", "eyeBlink.L", "eye_blink_left", "head:eyeBlink_L",
     "blendShape2.eyeBlink_L", "face|EyeBlinkLeft", "eye blink_L"],
)  # fmt: skip
def test_spellings_of_one_shape(name):
    assert canonical(name) == "eyeBlinkLeft"


def test_the_vocabulary_is_whole_and_already_canonical():
    assert len(set(ARKIT52)) == 52
    assert all(canonical(name) == name for name in (*ARKIT52, *HEAD_AND_EYES))


@pytest.mark.parametrize(
    ("name", "other"),
    [("jawLeft", "jawRight"), ("mouthLeft", "mouthRight"), ("eyeLookOutLeft", "eyeLookOutRight"), ("brow_L", "brow_R"),
     ("leftEyeYaw", "rightEyeYaw"), ("brow_l", "brow_r"), ("brow.R", "brow.L"), ("left_brow", "right_brow"),
     ("jawOpen", "jawOpen"), ("brightness", "brightness"), ("cleft", "cleft"), ("mouthLeftCorner", "mouthRightCorner"),
     ("EyeBlinkLeft", "EyeBlinkRight"), ("Upright", "Upright"), ("Leftover", "Leftover")],
)  # fmt: skip
def test_left_and_right(name, other):
    assert mirror_name(name) == other
    assert mirror_name(other) == name


def test_mirror_map_is_its_own_inverse_and_pairs_every_sided_shape():
    mirror = mirror_map(ARKIT52)
    np.testing.assert_array_equal(mirror[mirror], np.arange(52))
    alone = {ARKIT52[i] for i in range(52) if mirror[i] == i}
    assert alone == {"jawForward", "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthRollLower",
                     "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper", "browInnerUp", "cheekPuff",
                     "tongueOut"}  # fmt: skip
    np.testing.assert_array_equal(mirror_map(["a_L", "b"]), [0, 1])  # the other side is not there


def test_match_finds_halves():
    found = match(["browInnerUp", "JawOpen", "eyeBlinkLeft", "odd"], ["jawOpen", "browInnerUp_R", "browInnerUp_L"])
    assert found == {"browInnerUp": ("browInnerUp_L", "browInnerUp_R"), "JawOpen": ("jawOpen",)}


def test_arkit_on_the_real_rig(data):
    import json

    expected = json.loads(data("rigs/ict_arkit52_map.json").read_text())
    names = [str(n) for n in np.load(data("rigs/ict_facekit.npz"))["expression_names"]]
    found = match(ARKIT52, names)
    for name, shapes in expected.items():
        assert sorted(found.get(name, ())) == sorted(shapes), name


def test_halves_and_wholes_are_carried_both_ways():
    whole = Animation([[0.4, 0.8, 0.1]], ("browInnerUp", "JawOpen", "headYaw"), 30)
    halves = in_vocabulary(whole, ("browInnerUp_R", "jawOpen", "browInnerUp_L", "mouthClose"))
    assert halves.names == ("browInnerUp_R", "jawOpen", "browInnerUp_L")
    np.testing.assert_allclose(halves.weights, [[0.4, 0.8, 0.4]])
    again = in_vocabulary(replace(halves, weights=np.array([[0.2, 0.8, 0.6]])), ("browInnerUp", "jawOpen"))
    np.testing.assert_allclose(again.weights, [[0.4, 0.8]])
    with pytest.raises(InputError, match="None of the shapes"):
        in_vocabulary(whole, ("tail",))


def test_what_finds_no_place_is_told_the_strongest_first(caplog):
    names = ("tail", "jawOpen", "horn", "still", "gap")
    weights = np.array([[0.2, 1, 0, 5e-5, np.nan], [0.1, 1, -0.9, 0, np.nan]])
    animation = Animation(weights, names, 30)
    assert without_place(animation, ("jawOpen",)) == ["horn", "tail"] and not without_place(animation, names)
    in_vocabulary(animation, ("jawOpen",))
    assert "2 of 5 shapes move, but find no place and are left out, the strongest first: horn, tail." in caplog.text
    with pytest.raises(InputError, match="moves the shape 'horn'"):
        in_vocabulary(animation, ("jawOpen",), partial=False)


def test_a_rig_with_wholes_and_halves_moves_once():
    both, halves = ("browInnerUp", "browInnerUpLeft", "browInnerUpRight"), ("browInnerUp_L", "browInnerUp_R")
    sides = in_vocabulary(Animation([[0.2, 0.6]], halves, 30), both)
    assert sides.names == both[1:]
    np.testing.assert_allclose(sides.weights, [[0.2, 0.6]])
    parts = Animation([[0.3, 0.2, 0.0]], both, 30, confidence=[[1.0, 0.5, np.nan]])
    added = in_vocabulary(parts, halves)
    np.testing.assert_allclose(added.weights, [[0.5, 0.3]])
    np.testing.assert_allclose(added.confidence, [[0.75, np.nan]])
    np.testing.assert_allclose(in_vocabulary(parts, ("browInnerUp",)).weights, [[0.4]])
    np.testing.assert_array_equal(in_vocabulary(parts, both).weights, parts.weights)
