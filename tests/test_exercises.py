from dataclasses import replace

import numpy as np
import pytest

from blendcap import InputError, read_rig
from blendcap.data.facs import SHAPE_NAMES, SHAPES, shapes_of
from blendcap.data.names import ARKIT52
from blendcap.synthetic.exercises import TRAINED, action_units, frown, lip_swing
from test_performances import bare_rig


@pytest.fixture(scope="module")
def arkit():
    return bare_rig(ARKIT52)


@pytest.fixture(scope="module")
def everything(arkit):
    return action_units(arkit, seed=1)


def curve(animation, name):
    return animation.weights[:, animation.names.index(name)]


def test_each_unit_comes_five_times_and_rises(everything):
    turns = {}
    for what, start, stop, intensity in everything.turns:
        turns.setdefault(what, []).append((start, stop, intensity))
    assert {"1", "4", "12", "45", "30L", "30R", "19+26"} <= set(turns) and "30" not in turns
    for times in turns.values():
        assert len(times) == 5
        assert (np.diff([t[2] for t in times]) > 0.05).all() and times[-1][2] == 1.0 and times[0][2] < 0.35


def test_labels_are_the_weights_of_the_units_shapes(everything):
    for label in everything.labels.names:
        unit = int(label[2:].rstrip("LR"))
        side = {"L": "Left", "R": "Right"}.get(label[-1], "")
        for name in shapes_of(unit):
            if name.endswith(side) and name != "jawOpen":
                assert np.array_equal(curve(everything.animation, name), curve(everything.labels, label)), label
    assert (curve(everything.animation, "jawOpen") >= curve(everything.labels, "AU26") - 1e-9).all()


def test_a_turn_is_from_rest_to_rest_and_peaks_at_its_intensity(everything):
    shown = everything.labels.weights.max(1)
    inside = np.zeros(len(shown), dtype=bool)
    for what, start, stop, intensity in everything.turns:
        inside[start:stop] = True
        labels = [f"AU{part}" for part in what.split("+")]
        for label in labels:
            assert curve(everything.labels, label)[start:stop].max() == pytest.approx(intensity, abs=1e-9)
        others = [i for i, n in enumerate(everything.labels.names) if n not in labels]
        assert not everything.labels.weights[start:stop, others].any()
    assert not shown[~inside].any() and (~inside).mean() > 0.15


def test_the_exercises_of_the_thesis(arkit):
    done = action_units(arkit, TRAINED, repeats=4)
    assert done.labels.names == ("AU1", "AU2", "AU4", "AU7", "AU9", "AU45", "AU6", "AU43", "AU10L", "AU12L", "AU18L",
                                 "AU23L", "AU10R", "AU12R", "AU18R", "AU23R")  # fmt: skip
    start, stop = next((a, b) for what, a, b, level in done.turns if what == TRAINED[6] and level == 1)
    shown = {n for i, n in enumerate(ARKIT52) if done.animation.weights[start:stop, i].max() > 0.99}
    assert shown == {"mouthUpperUpLeft", "mouthSmileLeft", "mouthPucker", "mouthPressLeft"}
    squeezed = next((a, b) for what, a, b, level in done.turns if what == "6+43" and level == 1)
    shown = {n for i, n in enumerate(ARKIT52) if done.animation.weights[slice(*squeezed), i].max() > 0.99}
    assert shown == {"cheekSquintLeft", "cheekSquintRight", "eyeBlinkLeft", "eyeBlinkRight"}  # 45 stands in for 43


def test_a_richer_rig_uses_its_own_shapes():
    needs = {shape.name: shape.drivers for shape in SHAPES if shape.drivers}
    rig = replace(bare_rig(SHAPE_NAMES), combinations=needs)
    done = action_units(rig, ["18L", "43", "27"], repeats=1)
    moved = {n for i, n in enumerate(rig.names) if done.animation.weights[:, i].any()}
    assert moved == {"mouthPuckerUpperLeft", "mouthPuckerLowerLeft", "eyeCloseLeft", "eyeCloseRight", "jawStretch",
                     "jawOpen"}  # fmt: skip
    every = {f"AU{shape.facs}" for shape in SHAPES if shape.facs.isdigit() and shape.facs != "30"}
    assert every <= set(action_units(rig, repeats=1).labels.names)


def test_a_seed_is_a_performance(arkit):
    one, two, other = (action_units(arkit, ["4"], seed=s).animation.weights for s in (3, 3, 4))
    assert np.array_equal(one, two) and one.shape != other.shape


def test_lips_swing_from_side_to_side(arkit):
    swing = lip_swing(arkit)
    side = curve(swing, "mouthLeft") - curve(swing, "mouthRight")
    assert side.max() > 0.97 and side.min() < -0.97
    assert (np.diff(np.sign(np.where(np.abs(side) < 0.5, 0, side))) != 0).sum() >= 7  # there and back, twice
    assert curve(swing, "mouthPucker")[np.abs(side) > 0.5].min() > 0.7
    assert not swing.weights[0].any() and not swing.weights[-1].any()


def test_a_frown_comes_twice_the_second_time_in_full(arkit):
    anger = frown(arkit)
    for name in ("browDownLeft", "browDownRight", "mouthFrownLeft", "mouthFrownRight"):
        half = len(anger.weights) // 2
        assert curve(anger, name)[:half].max() == pytest.approx(0.6, abs=0.01)
        assert curve(anger, name)[half:].max() == pytest.approx(1.0, abs=0.01)
    assert not anger.weights[0].any() and not anger.weights[-1].any()


def test_bad_input_is_told_in_a_sentence(arkit):
    with pytest.raises(InputError, match="no action unit"):
        action_units(arkit, ["frown"])
    with pytest.raises(InputError, match="no shape for action unit 80"):
        action_units(arkit, ["80"])
    with pytest.raises(InputError, match="at least one repeat"):
        action_units(arkit, repeats=0)
    with pytest.raises(InputError, match="namesake"):
        frown(bare_rig(("sneer",)))


def test_ict_does_the_exercises_of_the_thesis(data):
    ict = read_rig(data("rigs/ict_facekit.npz"))
    done = action_units(ict, TRAINED, repeats=1)
    assert done.animation.names == ict.names
    assert curve(done.animation, "browInnerUp_L").max() == pytest.approx(1)
    assert lip_swing(ict).weights[:, ict.index("mouthLeft")].max() > 0.97
