"""The table of the 140 shapes: whole, consistent, and the words that scripts ask it with."""

import numpy as np
import pytest

from blendcap.data.facs import ARKIT_NAMES, SHAPE_NAMES, SHAPES, shapes_of
from blendcap.data.names import ARKIT52, canonical, mirror_map

BY_NAME = {shape.name: shape for shape in SHAPES}
ASKED_FOR = (1, 2, 4, 6, 7, 9, 10, 12, 15, 17, 18, 20, 22, 23, 24, 25, 26, 27, 28, 43, 45)


def test_there_are_140_shapes_and_arkit_comes_first():
    assert len(SHAPES) == len(set(SHAPE_NAMES)) == 140
    assert SHAPE_NAMES[:52] == ARKIT_NAMES
    assert set(ARKIT_NAMES) == set(ARKIT52)
    assert all(canonical(name) == name for name in SHAPE_NAMES)


def test_mirror_is_an_involution_that_swaps_sides_and_keeps_meaning():
    other = {"left": "right", "right": "left", "both": "both"}
    places = [SHAPE_NAMES.index(shape.mirror) for shape in SHAPES]
    np.testing.assert_array_equal(places, mirror_map(SHAPE_NAMES))
    gaze = {"61": "62", "62": "61"}  # eyes to the left, to the right
    for shape in SHAPES:
        twin = BY_NAME[shape.mirror]
        assert twin.mirror == shape.name
        assert twin.side == other[shape.side]
        assert twin.facs == gaze.get(shape.facs, shape.facs)
        mirrored = BY_NAME[shape.arkit].mirror if shape.arkit else ""
        assert twin.arkit == mirrored


def test_parts_and_drivers_are_shapes():
    for shape in SHAPES:
        assert shape.arkit in ("", *ARKIT_NAMES)
        assert set(shape.drivers) <= set(SHAPE_NAMES) - {shape.name}
    assert all(BY_NAME[name].arkit == name for name in ARKIT_NAMES)
    assert BY_NAME["mouthClose"].drivers == ("jawOpen",)
    assert BY_NAME["blinkSquintRight"].drivers == ("eyeBlinkRight", "eyeSquintRight")


@pytest.mark.parametrize("unit", ASKED_FOR)
def test_every_action_unit_of_the_papers_has_shapes_on_the_sides_where_it_applies(unit):
    assert shapes_of(unit)
    if unit in (26, 27):  # the jaw has no side
        return
    left, right = shapes_of(unit, "left"), shapes_of(unit, "right")
    if unit == 17:
        assert left == ("chinRaiseLeft",)
    assert left and tuple(BY_NAME[name].mirror for name in left) == right
    assert all(BY_NAME[name].side == "left" for name in left)


@pytest.mark.parametrize(
    ("unit", "side", "names"),
    [(12, "left", ["mouthSmileLeft"]), (12, "both", ["mouthSmileLeft", "mouthSmileRight"]),
     (18, "both", ["mouthPucker"]), (18, "right", ["mouthPuckerLowerRight", "mouthPuckerUpperRight"]),
     (1, "left", ["browInnerUpLeft"]), (4, "left", ["browDownLeft"]), (24, "right", ["mouthPressRight"]),
     (38, "left", ["nostrilDilateLeft"]), (27, "both", ["jawStretch"]), (99, "both", [])],
)  # fmt: skip
def test_an_action_unit_by_number(unit, side, names):
    assert list(shapes_of(unit, side)) == names
