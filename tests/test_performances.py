from dataclasses import replace

import numpy as np
import pytest

from blendcap.data import Animation, InputError, Mesh, Rig
from blendcap.data.names import ARKIT52, mirror_map
from blendcap.synthetic.performances import for_rig, range_of_motion, speech
from sheet import sheet_rig


@pytest.fixture(scope="module")
def rig():
    return sheet_rig()


def bare_rig(names):
    """A rig of one triangle, or two for shapes with a side: enough for scripts, which look at names and sides."""
    mesh = Mesh(np.arange(18.0).reshape(6, 3) % 7, np.array([[0, 1, 2], [3, 4, 5]]))
    deltas = np.zeros((len(names), 6, 3))
    for i, name in enumerate(names):
        middle = name.startswith(("jaw", "mouthLeft", "mouthRight"))
        deltas[i, slice(None) if middle else slice(0, 3) if name.endswith(("Left", "_L")) else slice(3, 6)] = 1
    return Rig(mesh, deltas, names, mirror=mirror_map(names))


@pytest.fixture(scope="module")
def arkit():
    return bare_rig(ARKIT52)


def test_the_range_of_motion_shows_every_shape_in_full(arkit):
    rom = range_of_motion(arkit, rate=60)
    assert rom.names == ARKIT52
    assert rom.weights.max(0) == pytest.approx(np.ones(52), abs=1e-3)
    assert rom.weights.min() >= 0 and rom.weights.max() <= 1
    assert not rom.weights[0].any() and not rom.weights[-1].any()
    assert 15 < len(rom.weights) / 60 < 45  # seconds


def test_sides_show_alone_and_together(rig):
    rom = range_of_motion(rig)
    left, right = (rom.weights[:, rig.index(f"mouthSmile{s}")] for s in ("Left", "Right"))
    assert left[right < 0.01].max() > 0.45 and right[left < 0.01].max() > 0.45
    assert np.minimum(left, right).max() > 0.99


def test_opposites_take_turns_and_eyes_look_together(arkit):
    rom = range_of_motion(arkit)
    at = {n: rom.weights[:, i] for i, n in enumerate(rom.names)}
    for one, two in (("jawLeft", "jawRight"), ("mouthLeft", "mouthRight"), ("eyeLookInLeft", "eyeLookOutLeft")):
        assert np.minimum(at[one], at[two]).max() < 0.6
    assert np.array_equal(at["eyeLookOutLeft"], at["eyeLookInRight"])
    assert np.array_equal(at["eyeLookOutRight"], at["eyeLookInLeft"])


def test_shapes_that_need_others_come_with_them(rig, arkit):
    for face in (rig, arkit):
        rom = range_of_motion(face)
        assert (rom.weights[:, face.index("mouthClose")] <= rom.weights[:, face.index("jawOpen")] + 1e-9).all()
    both = replace(rig, combinations={"mouthPucker": ("jawOpen", "browInnerUp")})
    rom = range_of_motion(both)
    for need in ("jawOpen", "browInnerUp"):
        assert (rom.weights[:, rig.index("mouthPucker")] <= rom.weights[:, rig.index(need)] + 1e-9).all()


def test_motion_is_smooth(rig):
    fine = range_of_motion(rig, rate=240).weights
    acceleration = np.abs(np.diff(fine, n=2, axis=0)).max() * 240**2
    assert acceleration < 1.2 * 5.78 / 0.22**2  # of a minimum-jerk rise: 10 / sqrt(3) / T²


def test_the_rate_only_samples(rig):
    assert np.allclose(range_of_motion(rig, rate=120).weights[::2][:400], range_of_motion(rig, rate=60).weights[:400])


def test_both_spellings_are_the_same_performance(arkit):
    whole = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
    names = [n if n in whole else n.replace("Left", "_L").replace("Right", "_R") for n in ARKIT52]
    other = bare_rig(names)
    assert np.array_equal(range_of_motion(other).weights, range_of_motion(arkit).weights)
    assert np.array_equal(speech(other, 60, 5, 3).weights, speech(arkit, 60, 5, 3).weights)


def test_blinks_have_human_timing(arkit):
    talk = speech(arkit, rate=240, seconds=120, seed=1)
    left, right = (talk.weights[:, talk.names.index(f"eyeBlink{s}")] for s in ("Left", "Right"))
    starts = np.flatnonzero((left[1:] > 0) & (left[:-1] == 0))
    assert 12 < len(starts) / 2 < 25  # a minute
    for start in starts[:-1]:
        blink = left[start : start + 240]
        blink = blink[: np.flatnonzero(blink[1:] == 0)[0] + 2]
        closing = np.flatnonzero(blink >= 0.999 * blink.max())[0] / 240
        opening = (len(blink) - np.flatnonzero(blink >= 0.999 * blink.max())[-1]) / 240
        assert 0.09 < closing < 0.16
        assert opening > closing
    assert left.max() > 0.95
    assert np.abs(left - right).max() < 0.5  # they start a few milliseconds apart, no more


def test_speech_has_the_rhythm_of_syllables_and_pauses(arkit):
    talk = speech(arkit, rate=60, seconds=60, seed=2)
    jaw = talk.weights[:, talk.names.index("jawOpen")]
    peaks = np.flatnonzero((jaw[1:-1] > jaw[:-2]) & (jaw[1:-1] >= jaw[2:]) & (jaw[1:-1] > 0.04))
    assert 2.5 < len(peaks) / 60 < 6
    mouth = talk.weights[:, [i for i, n in enumerate(talk.names) if n.startswith(("jaw", "mouth"))]].sum(1)
    assert 0.05 < (mouth < 0.01).mean() < 0.5
    assert talk.weights.min() >= 0 and talk.weights.max() <= 1
    used = {n for n, w in zip(talk.names, talk.weights.T, strict=True) if w.max() > 0.05}
    assert {"browInnerUp", "mouthSmileLeft", "mouthPucker", "mouthPressRight", "eyeLookUpLeft"} <= used


def test_speech_is_a_little_uneven(arkit):
    talk = speech(arkit, rate=60, seconds=20, seed=3)
    left, right = (talk.weights[:, talk.names.index(f"mouthSmile{s}")] for s in ("Left", "Right"))
    assert 0.01 < np.abs(left - right).max() / left.max() < 0.5


def test_a_seed_is_a_talk(arkit):
    assert np.array_equal(speech(arkit, 30, 4, 1).weights, speech(arkit, 30, 4, 1).weights)
    assert not np.array_equal(speech(arkit, 30, 4, 1).weights, speech(arkit, 30, 4, 2).weights)


def test_an_animation_finds_its_namesakes():
    face = bare_rig(("browInnerUp_L", "browInnerUp_R", "jawOpen"))
    animation = Animation(np.array([[0.4, 1.3, 0.9]]), ("browInnerUp", "jawOpen", "cheekPuff"), 30)
    mapped = for_rig(animation, face)
    assert mapped.names == face.names
    assert np.array_equal(mapped.weights, [[0.4, 0.4, 1.0]])
    table = {"cheekPuff": ("jawOpen",), "jawOpen": ()}
    assert np.array_equal(for_rig(animation, face, table).weights, [[0, 0, 0.9]])
    with pytest.raises(InputError, match="namesake"):
        for_rig(Animation(np.ones((1, 1)), ("frown",), 30), face)


def test_correctives_follow_their_drivers():
    names = ("eyeBlinkLeft", "eyeSquintLeft", "blinkSquintLeft", "jawOpen", "mouthClose")
    needs = {"blinkSquintLeft": ("eyeBlinkLeft", "eyeSquintLeft"), "mouthClose": ("jawOpen",)}
    rig = replace(bare_rig(names), combinations=needs)
    given = Animation(np.array([[0.5, 0.4, 0.9]]), ("eyeBlinkLeft", "eyeSquintLeft", "jawOpen"), 30)
    assert np.allclose(for_rig(given, rig).weights, [[0.5, 0.4, 0.2, 0.9, 0.0]])
    driven = Animation(np.array([[0.5, 0.4, 0.7]]), ("eyeBlinkLeft", "eyeSquintLeft", "blinkSquintLeft"), 30)
    assert np.allclose(for_rig(driven, rig).weights, [[0.5, 0.4, 0.7, 0.0, 0.0]])  # its own curve stays
