import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from blendcap import InputError
from blendcap.data.names import ARKIT52
from blendcap.synthetic.conversation import PHRASES, VISEMES, _mouths, conversation
from test_performances import bare_rig


@pytest.fixture(scope="module")
def rig():
    return bare_rig(ARKIT52)


@pytest.fixture(scope="module")
def talk(rig):
    return conversation(rig, seconds=40, seed=2)


def curve(animation, name):
    return animation.weights[:, animation.names.index(name)]


def test_every_sound_has_a_mouth_that_arkit_can_make():
    for phrase in PHRASES:
        assert all(_mouths(sound) for sound in phrase.split())
    for mouth in VISEMES.values():
        for name in mouth:
            assert all(name.replace("*", side) in ARKIT52 for side in ("Left", "Right"))


def test_there_are_turns_of_talk_and_of_listening(talk):
    mouth = np.abs(np.diff(curve(talk, "jawOpen"))) > 2e-3
    windows = mouth[: len(mouth) // 60 * 60].reshape(-1, 60).mean(1)
    assert 0.25 < (windows > 0.3).mean() < 0.9 and (windows == 0).mean() > 0.1
    assert curve(talk, "mouthPucker").max() > 0.4 and curve(talk, "mouthFunnel").max() > 0.3


def test_lips_that_must_close_press(talk):
    press, jaw = curve(talk, "mouthRollLower"), curve(talk, "jawOpen")
    closed = press > 0.2
    assert closed.any() and jaw[closed].mean() < jaw[jaw > 0.02].mean() + 0.1


def test_weights_are_smooth_and_in_bounds(talk):
    assert talk.weights.min() >= 0 and talk.weights.max() <= 1
    assert np.abs(np.diff(talk.weights, axis=0)).max() < 0.36  # the eyes, which jump


def test_eyes_blink_about_as_often_as_people_do(talk):
    blink = curve(talk, "eyeBlinkLeft") > 0.5
    assert 6 < (np.diff(blink.astype(int)) == 1).sum() < 22  # in 40 s


def test_the_head_nods_and_stays_a_head(talk):
    turns = Rotation.from_matrix(talk.head[:, :3, :3]).as_rotvec()
    assert np.allclose(np.linalg.det(talk.head[:, :3, :3]), 1) and np.allclose(talk.head[0], np.eye(4))
    quick = np.abs(turns - gaussian_filter1d(turns, 24, axis=0)).max(0)  # without the sway
    assert quick[0] > 0.04 and quick[1] > 0.04 > quick[2]  # nods and shakes, no tilts
    assert np.abs(turns).max() < 0.5
    assert np.abs(np.diff(turns, axis=0)).max() < 0.03


def test_a_seed_is_a_conversation(rig, talk):
    assert np.array_equal(conversation(rig, seconds=40, seed=2).weights, talk.weights)
    assert not np.array_equal(conversation(rig, seconds=40, seed=3).weights, talk.weights)
    with pytest.raises(InputError, match="more than 0 seconds"):
        conversation(rig, seconds=0)
