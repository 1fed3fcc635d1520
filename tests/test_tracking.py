"""Skin followed through film whose truth is known: where points are, when they are lost, and what that gains."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import blendcap
from blendcap import Animation, InputError, PaintTracks, SolveSettings
from blendcap.makeup.skin_points import skin_points
from blendcap.makeup.tracking import track_paint
from blendcap.rendering import project, sight_lines
from blendcap.synthetic.head_camera import HeadCamera, film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.shot import Shot
from blendcap.synthetic.takes import Truth, choose_points, make_take

SIZE, RATE, VIEWS = (480, 360), 24.0, 2
LIDS, BROWS = ("eyeBlinkLeft", "eyeBlinkRight"), ("browDownLeft", "browDownRight")
KEEP = SolveSettings(head="keep")


@dataclass(frozen=True)
class Film:
    """A blink and a frown before two cameras, markers that see no lid, and the tracks of the paint."""

    rig: blendcap.Rig
    take: blendcap.MarkerTake
    truth: Truth
    binding: blendcap.Binding
    helmet: HeadCamera
    shots: tuple[Shot, ...]
    pictures: list[np.ndarray]  # (T, H, W) each
    first: blendcap.Solution
    tracks: PaintTracks

    def follow(self, pictures=None, first=None, cameras=None) -> PaintTracks:
        pictures = self.pictures if pictures is None else pictures
        cameras = self.helmet.cameras[:VIEWS] if cameras is None else cameras
        return track_paint(pictures, self.rig, self.take, self.binding, cameras, first or self.first)


@pytest.fixture(scope="module")
def film() -> Film:
    rig = blendcap.mannequin(1, shapes=52)
    performer = make_performer(rig, seed=1, strength=0.0)
    makeup = draw_makeup(performer.rig, seed=1)
    hump = np.sin(np.linspace(0, np.pi, 12)) ** 2
    acted = Animation(np.stack([hump, hump, 0.8 * hump, 0.5 * hump], axis=1), (*LIDS, *BROWS), RATE)
    points = choose_points(rig, 40)
    _, blinks = rig.select(LIDS).sample(points)
    still = [n for n, d in zip(points.names, np.linalg.norm(blinks, axis=2).max(0), strict=True) if d < 0.5]
    worn = points.select(still)
    take, truth = make_take(performer, acted, worn, seed=1, noise=0.1, misplacement=0.0, slip=(1.0, 1.0), occlusion=0.0)
    helmet = mount_head_camera(performer.rig, seed=1, size=SIZE)
    shots = film_head(truth, helmet, seed=1, makeup=makeup)[:VIEWS]
    pictures = [np.stack(list(shot.frames())) for shot in shots]
    binding = blendcap.bind(rig, take, worn)
    first = blendcap.solve(rig, take, binding, settings=KEEP)
    tracks = track_paint(pictures, rig, take, binding, helmet.cameras[:VIEWS], first)
    return Film(rig, take, truth, binding, helmet, shots, pictures, first, tracks)


def apart(film: Film, tracks: PaintTracks) -> np.ndarray:
    """(T, K) how far tracks are from the truth across their lines of sight, as far as they tell it, mm."""
    found = np.full(tracks.positions.shape, np.nan)
    for view, shot in enumerate(film.shots):
        own = np.flatnonzero(tracks.cameras == view)
        names = [tracks.points.names[k] for k in own]
        found[:, own] = tracks.positions[:, own] - shot.look_at(tracks.points.select(names)).positions
    found -= found[:1]  # the rig is laid over the face by markers with noise; motion is what is told
    return np.linalg.norm(np.einsum("kij,tkj->tki", tracks.axes, found), axis=2)


def test_points_are_where_the_skin_went(film):
    off = apart(film, film.tracks)
    assert len(film.tracks.rest) > 200 and film.tracks.lost.mean() < 0.1
    assert np.nanmedian(off) < 0.05 and np.nanpercentile(off, 90) < 0.25
    moved = np.linalg.norm(film.tracks.positions - film.tracks.rest, axis=2)
    assert np.nanmax(moved) > 5  # the lids


def test_the_first_frame_is_rest(film):
    np.testing.assert_allclose(film.tracks.positions[0], film.tracks.rest, atol=1e-9)


def test_each_point_lies_on_the_line_of_sight_and_tells_nothing_along_it(film):
    for view, camera in enumerate(film.helmet.cameras[:VIEWS]):
        own = film.tracks.cameras == view
        away = film.tracks.rest[own] - camera.position
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        np.testing.assert_allclose(sight_lines(project(film.tracks.rest[own], camera)[0], camera), away, atol=1e-6)
        assert np.abs(np.einsum("kij,kj->ki", film.tracks.axes[own], away)).max() < 1e-6
        lengths = np.linalg.norm(film.tracks.axes[own], axis=2)
        assert (lengths < 1.15).all() and (lengths[:, 0] > lengths[:, 1] - 0.05).all()


def test_tracks_shut_the_lids_that_no_marker_sees(film):
    both = blendcap.solve(film.rig, film.take, film.binding, tracks=film.tracks, settings=KEEP)
    true, errors = film.truth.animation.weights, []
    rows = [film.rig.index(name) for name in LIDS]
    for solution in (film.first, both):
        errors.append(np.abs(solution.animation.weights - true)[:, rows].max())
    assert errors[0] > 0.9 and errors[1] < 0.35
    assert both.track_rms.max() < 0.2


def test_lids_are_found_at_once_where_they_shut(film):
    """From one frame to the next, and the solve of the markers knows nothing of it."""
    shut = int(film.truth.animation.weights[:, film.rig.index(LIDS[0])].argmax())
    jump = [part[[0, 0, 0, shut, shut, shut, 0, 0]] for part in film.pictures]
    rows = [0, 0, 0, shut, shut, shut, 0, 0]
    take = replace(film.take, positions=film.take.positions[rows])
    first = blendcap.solve(film.rig, take, film.binding, settings=KEEP)
    tracks = track_paint(jump, film.rig, take, film.binding, film.helmet.cameras[:VIEWS], first)
    blink = film.rig.deltas[film.rig.index(LIDS[0])] + film.rig.deltas[film.rig.index(LIDS[1])]
    carried = np.linalg.norm(tracks.points.matrix(film.rig.mesh) @ blink, axis=1) > 5
    assert carried.sum() > 10
    moved = np.linalg.norm(tracks.positions - tracks.rest, axis=2)[:, carried]
    assert np.nanmedian(moved[3:6]) > 4
    assert (tracks.lost[3:6, carried].mean(1) < 0.6).all()  # near half of them
    assert np.nanmedian(moved[6:]) < 0.5


def test_half_the_light_changes_little(film):
    dim = [np.concatenate([part[:6], part[6:] // 2]) for part in film.pictures]
    tracks = film.follow(dim)
    off = apart(film, tracks)
    assert tracks.lost.mean() < film.tracks.lost.mean() + 0.05 and np.nanpercentile(off, 90) < 0.3


def test_black_frames_lose_the_points_and_they_come_back(film):
    black = [film.pictures[0].copy(), film.pictures[1]]
    black[0][5:8] = 0
    tracks = film.follow(black)
    own = tracks.cameras == 0
    assert tracks.lost[5:8, own].all() and tracks.lost[8:, own].mean() < 0.3
    np.testing.assert_array_equal(tracks.positions[:, ~own], film.tracks.positions[:, film.tracks.cameras == 1])


def test_following_is_the_same_every_time(film):
    np.testing.assert_array_equal(film.follow().positions, film.tracks.positions)


def test_a_picture_of_twice_the_size_tells_the_same(film):
    large = [part.repeat(2, axis=1).repeat(2, axis=2) for part in film.pictures]
    to_large = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    cameras = [replace(camera, intrinsics=to_large @ camera.intrinsics) for camera in film.helmet.cameras[:VIEWS]]
    tracks = film.follow(large, cameras=cameras)
    np.testing.assert_allclose(tracks.positions, film.tracks.positions, atol=1e-6)


def test_sliders_to_a_hundred_are_followed_like_all_others(film):
    bounds, deltas = 100 * film.rig.bounds, film.rig.deltas / 100
    rig = replace(film.rig, deltas=deltas, bounds=bounds)
    first = replace(film.first, animation=replace(film.first.animation, weights=100 * film.first.animation.weights))
    tracks = track_paint(film.pictures, rig, film.take, film.binding, film.helmet.cameras[:VIEWS], first)
    np.testing.assert_allclose(tracks.positions, film.tracks.positions, atol=1e-3)


def test_points_are_apart_and_on_skin_alone(film):
    camera = film.helmet.cameras[0]
    points = skin_points(film.pictures[0][0].astype(np.float32), film.rig, film.binding, camera)
    far = np.linalg.norm(points.pixels[:, None] - points.pixels, axis=2)
    np.fill_diagonal(far, np.inf)
    assert far.min() >= 8
    eyes = set(film.rig.regions["eyes"].tolist())
    assert not eyes & set(film.rig.mesh.faces[points.faces].ravel().tolist())


def test_frames_without_markers_are_placed_as_the_frame_before(film):
    gone = film.take.positions.copy()
    gone[4] = np.nan
    take = replace(film.take, positions=gone)
    first = blendcap.solve(film.rig, take, film.binding, settings=KEEP)
    tracks = track_paint(film.pictures, film.rig, take, film.binding, film.helmet.cameras[:VIEWS], first)
    assert tracks.lost[4].mean() < 0.3


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda film: [film.pictures[0], film.pictures[1][:-2]], "camera 1 ends after"),
        (lambda film: [np.concatenate([film.pictures[0]] * 2), film.pictures[1]], "camera 0 has more frames"),
        (lambda film: [film.pictures[0], film.pictures[1][:0]], "camera 1 has no frame"),
        (lambda film: film.pictures[:1], "Videos: 1; cameras: 2"),
        (lambda film: [0 * part for part in film.pictures], "anything on the skin that could be followed"),
    ],
)
def test_films_that_cannot_be_followed_are_refused(film, change, sentence):
    with pytest.raises(InputError, match=sentence):
        film.follow(change(film))


def test_a_solution_that_does_not_place_its_markers_is_refused(film):
    with pytest.raises(InputError, match="where it put the markers"):
        film.follow(first=replace(film.first, fitted=None))
