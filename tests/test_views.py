"""Shots in color and on disk: drift, blur and noise as the truth says, and files that hold it whole."""

from functools import cache

import cv2
import numpy as np
import pytest

from blendcap import Animation, InputError, read_animation, read_markers, read_rig, read_video
from blendcap.io.cameras import read_cameras
from blendcap.io.npz import read_meta, read_npz
from blendcap.rendering import Light
from blendcap.synthetic.color import Take, drift, film, one_light
from blendcap.synthetic.head_camera import Sensor, film_head, mount_head_camera
from blendcap.synthetic.mannequin import mannequin
from blendcap.synthetic.performances import for_rig
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take
from blendcap.synthetic.unit_curves import unit_curves
from blendcap.synthetic.views import five_views, head_motion, one_camera, photographs
from blendcap.view.footage import write_shots

SIZE = (96, 72)


@cache
def performer():
    kept = ("jawOpen", "mouthSmileLeft", "eyeBlinkLeft", "browInnerUp")
    return make_performer(mannequin().select([n for n in mannequin().names if n in kept]), seed=2)


def talk(count=3, rate=30.0):
    weights = np.stack([np.linspace(0, 0.6, count), np.linspace(0, 0.4, count)], 1)
    return for_rig(Animation(weights, ("jawOpen", "mouthSmileLeft"), rate), performer().rig.select(performer().names))


def test_one_camera_repeats_itself_and_knows_where_the_landmarks_are():
    shot, again = (one_camera(performer(), talk(), seed=4, size=SIZE) for _ in range(2))
    frames = list(shot.frames())
    assert [f.shape for f in frames] == [(72, 96, 3)] * 3
    assert all(np.array_equal(a, b) for a, b in zip(frames, again.frames(), strict=True))
    assert not np.array_equal(frames[0], next(one_camera(performer(), talk(), seed=5, size=SIZE).frames()))
    lens, place = shot.camera, shot.placement
    for frame in range(3):  # the camera's pose after the head's is what a pose solver should find
        model = lens.pose @ place[frame]
        rest = performer().rig.points["landmarks68"].matrix(performer().rig.mesh)
        points = rest @ performer().pose(shot.animation.weights[frame])
        peer = cv2.projectPoints(
            points, cv2.Rodrigues(model[:3, :3])[0], model[:3, 3], lens.intrinsics, lens.distortion
        )[0]
        np.testing.assert_allclose(shot.landmarks.pixels[frame], peer[:, 0], atol=1e-6)
    assert np.abs(np.diff(place, axis=0)).max() > 0.1  # the head moves


def plain(gain, *, well=1e12, read=0.0, shutter=0.0, background=0.5):
    """A shot in which nothing but what is asked for happens."""
    animation = talk(len(gain))
    take = Take(one_light((0.3, 0.5, 1.0), 0.8, 0.4), np.full((72, 96, 3), background), gain, shutter, well, read)
    camera = one_camera(performer(), animation, seed=1, size=SIZE).camera
    return film("plain", performer(), animation, camera, SIZE, take, seed=1)


def linear(picture):
    value = picture / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def test_the_exposure_drifts_by_the_true_gain():
    gain = np.array([[1.0, 1, 1], [0.8, 0.9, 1.1], [0.5, 0.5, 0.5]])
    frames = [linear(f)[:3, :3].mean((0, 1)) for f in plain(gain).frames()]  # a corner of the background
    np.testing.assert_allclose(np.array(frames) / frames[0], gain, rtol=0.02)


def test_noise_has_the_variance_of_photons():
    quiet, loud = (plain(np.ones((2, 3)), well=w, read=5.0) for w in (1e12, 2000.0))
    clean, noisy = linear(next(quiet.frames())), linear(next(loud.frames()))
    level = clean[0, 0, 0]
    variance = (noisy[:, :14] - clean[:, :14]).var()
    assert variance == pytest.approx((2000 * level + 25) / 2000**2, rel=0.1)


def test_a_longer_shutter_blurs_what_moves_and_nothing_else():
    still, blurred = (next(plain(np.ones((3, 3)), shutter=s).frames(1, 2)).astype(float) for s in (0.0, 1 / 30))
    changed = np.abs(still - blurred).max(2) > 3
    mouth = plain(np.ones((3, 3))).landmarks.pixels[1, 48:].mean(0)
    rows, columns = np.nonzero(changed)
    assert 5 < changed.sum() < 800
    assert np.hypot(columns.mean() - mouth[0], rows.mean() - mouth[1]) < 12


def test_photographs_show_the_sides_that_they_name():
    shots = {shot.name: shot for shot in photographs(performer(), seed=3, size=SIZE[::-1])}
    assert [shot.count for shot in shots.values()] == [1, 1, 1]
    marks = {name: shot.landmarks for name, shot in shots.items()}
    assert marks["left"].visible[0, 15] and not marks["left"].visible[0, 0]  # 0 is on the subject's right
    assert marks["right"].visible[0, 1] and not marks["right"].visible[0, 16]
    assert not np.allclose(shots["left"].placement, shots["right"].placement)
    assert next(shots["centre"].frames()).shape == (96, 72, 3)


def test_five_views_meet_in_one_face():
    shots = five_views(performer(), talk(2), seed=3, size=SIZE[::-1])
    positions = np.array([shot.landmarks.positions for shot in shots])
    np.testing.assert_array_equal(positions, np.broadcast_to(positions[:1], positions.shape))
    rows = []
    for shot in shots:
        lens = shot.camera
        given = shot.landmarks.pixels[1][:, None]
        straight = cv2.undistortPointsIter(given, lens.intrinsics, lens.distortion, None, None, (3, 100, 1e-12))[:, 0]
        rows.append(straight[:, :, None] * lens.pose[2] - lens.pose[:2])
    found = np.linalg.svd(np.concatenate(rows, axis=1))[2][:, -1]
    np.testing.assert_allclose(found[:, :3] / found[:, 3:], positions[0, 1], atol=1e-3)
    assert sum(shot.landmarks.visible[1].astype(int) for shot in shots).min() >= 2


def test_head_motion_is_as_large_as_asked_at_every_length():
    rig = performer().rig
    motion = head_motion(rig, 4000, 30.0, seed=1, size=(8.0, 5.0))
    angle = np.degrees(np.arccos((np.trace(motion[:, :3, :3], axis1=1, axis2=2) - 1) / 2))
    assert np.sqrt((angle**2).mean()) == pytest.approx(5.0, rel=0.25)
    short = [head_motion(rig, 5, 30.0, seed=s) for s in range(40)]
    assert 3 < np.degrees(np.sqrt(np.mean([np.square(m[0, 2, 0]) * 3 for m in short]))) < 7


def test_drift_has_its_size():
    rng = np.random.default_rng(0)
    assert np.std([drift(30, 30.0, 0.1, rng) for _ in range(300)]) == pytest.approx(0.1, rel=0.25)


def test_action_units_come_from_the_names():
    names = ("browInnerUp", "mouthSmile_L", "mouthPucker", "unknown")
    units = unit_curves(Animation([[0.2, 0.8, 0.5, 1.0]], names, 30.0))
    assert dict(zip(units.names, units.weights[0], strict=True)) == {
        "AU1L": 0.2, "AU1R": 0.2, "AU12L": 0.8, "AU18L": 0.5, "AU18R": 0.5,
    }  # fmt: skip
    with pytest.raises(InputError, match="None of the shapes unknown"):
        unit_curves(Animation([[1.0]], ("unknown",), 30.0))


def test_one_light_is_one_light():
    light = one_light((1, 1, 1), 0.8, 0.3)
    assert isinstance(light, Light) and light.strengths == (0.8, 0.0, 0.0, 0.3)


def headcam(**sensor):
    points = choose_points(performer().rig.select(performer().names), 30, seed=1)
    take, truth = make_take(performer(), talk(4), points, seed=1, neutral_frames=0)
    helmet = mount_head_camera(performer().rig, seed=1, sensor=Sensor(**sensor))
    return film_head(truth, helmet, seed=1)[:1], take


def test_what_is_written_holds_the_truth(tmp_path):
    shots, take = headcam()
    files = write_shots(tmp_path, shots, take)
    assert sorted(tmp_path.iterdir()) == sorted(files)
    camera, size = read_cameras(tmp_path / "cameras.json")["upper_right"]
    assert size == (640, 480)
    np.testing.assert_allclose(camera.pose, shots[0].camera.pose)
    arrays = read_npz(tmp_path / "upper_right.npz")
    meta = read_meta(arrays, tmp_path)
    assert meta["size"] == [640, 480] and meta["rate"] == 30 and len(meta["landmarks"]) == 68
    np.testing.assert_array_equal(arrays["landmarks"], shots[0].landmarks.pixels)
    np.testing.assert_array_equal(arrays["dots_visible"], shots[0].markers.visible)
    np.testing.assert_array_equal(arrays["light_rings"], shots[0].lights["rings"])
    np.testing.assert_array_equal(read_animation(tmp_path / "animation.npz").weights, shots[0].animation.weights)
    assert "AU26L" in read_animation(tmp_path / "action_units.npz").names
    np.testing.assert_allclose(read_markers(tmp_path / "markers.c3d").positions, take.positions, atol=1e-3)
    assert read_video(tmp_path / "upper_right.mp4").count == 4


def test_dots_survive_the_file(tmp_path):
    """Squeezing a film moves the middle of a dot by less than a tenth of a pixel."""
    shots, _ = headcam()
    write_shots(tmp_path, shots)
    offs = []
    for frame, read in enumerate(read_video(tmp_path / "upper_right.mp4").frames(grey=True)):
        before = next(shots[0].frames(frame, frame + 1))
        seen = shots[0].markers
        for pixel in seen.pixels[frame][seen.visible[frame]]:
            if (pixel > 12).all() and (pixel < [627, 467]).all():
                offs.append(np.linalg.norm(middle(read, pixel) - middle(before, pixel)))
    offs = np.array(offs)[np.isfinite(offs)]
    assert len(offs) > 30
    assert np.sqrt(np.mean(offs**2)) < 0.05 and offs.max() < 0.1


def middle(picture, pixel):
    """The middle of what is brighter than all around it; NaN where that is little."""
    column, row = np.round(pixel).astype(int)
    window = picture[row - 6 : row + 7, column - 6 : column + 7].astype(float)
    around = max(window[[0, -1]].max(), window[:, [0, -1]].max())
    if window.max() - around < 60:
        return np.full(2, np.nan)
    weight = (window - around - 0.1 * (window.max() - around)).clip(0)
    y, x = np.mgrid[-6:7, -6:7]
    return np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()


def test_a_folder_must_be_there(tmp_path):
    with pytest.raises(InputError, match="there is no such folder"):
        write_shots(tmp_path / "none", [])


@pytest.mark.slow
def test_every_kind_of_shot_works_on_another_rig(data):
    rig = read_rig(data("rigs/ict_facekit.npz"))
    other = make_performer(rig, seed=1)
    animation = Animation(np.linspace(0, 0.5, 2)[:, None], ("jawOpen",), 30.0)
    shots = [one_camera(other, animation, seed=1, size=SIZE), *photographs(other, seed=1, size=SIZE),
             *five_views(other, animation, seed=1, size=SIZE)]  # fmt: skip
    for shot in shots:
        picture = next(shot.frames())
        assert picture.std() > 10
        assert shot.landmarks.visible[0].sum() > 30
