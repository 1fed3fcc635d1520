"""Stabilization: known head motion comes back, and a take without any is left alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from blendcap.data import InputError, MarkerTake
from blendcap.markers.stabilization import find_stable, stabilize
from blendcap.numerics.similarity import apply

FRAMES, STILL, LIVELY = 300, 8, 16
NAMES = [f"still{i}" for i in range(STILL)] + [f"lively{i}" for i in range(LIVELY)]


def smooth(shape, seed, width=15):
    return gaussian_filter1d(np.random.default_rng(seed).normal(size=(FRAMES, *shape)), width, axis=0) * 6


def face(seed=0, noise=0.0):
    """Markers in the head's space: some on the skull, some that play; neutral in the first frames."""
    rng = np.random.default_rng(seed)
    rest = rng.normal([0, 0, 90], [45, 60, 20], (len(NAMES), 3))
    play = 5 * smooth((LIVELY, 3), seed + 1)
    play = np.where(np.arange(FRAMES)[:, None, None] < 15, 0, play)
    positions = np.repeat(rest[None], FRAMES, 0)
    positions[:, STILL:] += play
    return positions + rng.normal(0, noise, positions.shape)


def head_motion(size=1.0, seed=7):
    path = smooth((6,), seed)
    path = size * (path - path[0])
    path[:15] = 0
    return Rotation.from_rotvec(0.05 * path[:, 3:]).as_matrix(), 15 * path[:, :3]


def as_take(positions):
    return MarkerTake(positions, NAMES, 60)


def test_the_markers_on_the_skull_are_found():
    moved = apply(face(noise=0.1), *head_motion())
    stable = find_stable(as_take(moved))
    assert len(stable) >= 4
    assert all(name.startswith("still") for name in stable)


@pytest.mark.parametrize("stable", [None, NAMES[:STILL]])
def test_known_motion_is_removed_exactly(stable):
    rotation, translation = head_motion()
    head, still = stabilize(as_take(apply(face(), rotation, translation)), stable)
    np.testing.assert_allclose(still.positions, face(), atol=1e-6)
    np.testing.assert_allclose(head[:, :3, :3], rotation, atol=1e-8)
    np.testing.assert_allclose(head[:, :3, 3], translation, atol=1e-6)
    np.testing.assert_array_equal(head[:, 3], np.tile([0, 0, 0, 1], (FRAMES, 1)))


def test_a_take_that_starts_elsewhere_comes_back_to_a_given_rest():
    rotation, translation = head_motion()
    volume = np.array([40.0, -30, 900])
    lifted = apply(face()[100:], rotation[100:], translation[100:] + volume)
    head, still = stabilize(as_take(lifted), rest=face()[0])
    np.testing.assert_allclose(still.positions, face()[100:], atol=1e-6)
    np.testing.assert_allclose(head[:, :3, :3], rotation[100:], atol=1e-8)


def test_noise_is_not_amplified():
    noisy = face(noise=0.2)
    _, still = stabilize(as_take(apply(noisy, *head_motion())), NAMES[:STILL])
    added = still.positions - noisy
    assert np.sqrt((added**2).mean()) < 0.2


def test_head_and_take_belong_together():
    moved = apply(face(noise=0.2), *head_motion())
    head, still = stabilize(as_take(moved))
    np.testing.assert_allclose(apply(still.positions, head[:, :3, :3], head[:, :3, 3]), moved, atol=1e-9)


def test_a_helmet_that_sits_tight_is_left_alone():
    take = as_take(face(noise=0.2))
    head, still = stabilize(take)
    assert still is take
    np.testing.assert_array_equal(head, np.tile(np.eye(4), (FRAMES, 1, 1)))


def test_a_slipping_helmet_is_not_made_worse():
    rotation, translation = head_motion(size=0.1)
    slipped = apply(face(noise=0.2), rotation, translation)
    _, still = stabilize(as_take(slipped))
    assert np.abs(still.positions - face(noise=0.2)).mean() <= np.abs(slipped - face(noise=0.2)).mean()


def test_what_hides_in_the_markers_play_is_removed_if_that_is_asked_for():
    """Lively markers on a head that hardly turns do not look like one body; the fit of all of them is asked for."""
    rotation, translation = head_motion(size=0.1)
    moved = apply(face(), rotation, translation)
    assert np.array_equal(stabilize(as_take(moved), NAMES)[1].positions, moved)
    head, still = stabilize(as_take(moved), NAMES, always=True)
    np.testing.assert_allclose(apply(still.positions, head[:, :3, :3], head[:, :3, 3]), moved, atol=1e-9)
    away = [np.abs(take[:, :STILL] - face()[:, :STILL]).mean() for take in (moved, still.positions)]
    assert away[1] < 0.5 * away[0]


def test_missing_markers_cost_little():
    rotation, translation = head_motion()
    moved = apply(face(), rotation, translation)
    moved[np.random.default_rng(0).random(moved.shape[:2]) < 0.2] = np.nan
    moved[:15] = apply(face(), rotation, translation)[:15]
    head, _ = stabilize(as_take(moved), NAMES[:STILL])
    np.testing.assert_allclose(head[:, :3, :3], rotation, atol=1e-6)


def test_frames_without_a_pose_take_it_from_their_neighbors(caplog):
    rotation, translation = head_motion()
    moved = apply(face(), rotation, translation)
    moved[100:106, : STILL - 2] = np.nan
    moved[295:, :STILL] = np.nan
    head, still = stabilize(as_take(moved), NAMES[:STILL])
    assert "11 frames" in caplog.text
    centered = np.abs(still.positions - face())[100:106, STILL:]
    assert centered.max() < 1.0
    np.testing.assert_array_equal(head[295:], np.tile(head[294], (5, 1, 1)))


def test_one_wrong_stable_marker_does_not_bend_the_head():
    moved = face()
    moved[150:, 0] += [0, 25, 0]
    moved = apply(moved, *head_motion())
    head, _ = stabilize(as_take(moved), NAMES[:STILL])
    np.testing.assert_allclose(head[:, :3, :3], head_motion()[0], atol=2e-3)


def test_what_cannot_be_stabilized_is_refused():
    with pytest.raises(InputError, match="'Nose'"):
        stabilize(as_take(face()), ["Nose"])
    holed = face()
    holed[:, 2:] = np.nan
    with pytest.raises(InputError, match="Fewer than four"):
        find_stable(as_take(holed))
    with pytest.raises(InputError, match="three stable"):
        stabilize(as_take(face()), NAMES[:2])


def test_few_stable_markers_do_not_outvote_each_other_in_turns():
    """Four that drift by up to 2 mm each: whoever would count more in a frame, the head must not jump."""
    rest = np.array([[0, 40.0, 10], [40, 38, 0], [-40, 38, 0], [-50, 5, -5]])
    drift = gaussian_filter1d(np.random.default_rng(4).normal(size=(400, 4, 3)), 30, axis=0)
    drift *= 2 / np.abs(drift).max()
    take = MarkerTake(rest + drift - drift[0], ("a", "b", "c", "d"), 60.0)
    head, _ = stabilize(take, stable=take.names, rest=rest, always=True)
    carried = rest @ np.swapaxes(head[:, :3, :3], 1, 2) + head[:, None, :3, 3]
    assert np.abs(np.diff(carried, n=2, axis=0)).max() < 0.005
