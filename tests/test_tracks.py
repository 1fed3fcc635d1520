"""Tracks between the markers as rows of the same equation: what they tell, and what is not theirs to tell."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import blendcap
from blendcap import InputError, PaintTracks, SolveSettings, SurfacePoints
from blendcap.io import read_tracks, write_tracks
from blendcap.markers.track_rows import track_deltas
from blendcap.solving.paper import solve_paper
from blendcap.solving.rows import marker_rows
from blendcap.solving.trust import without_strays
from blendcap.synthetic.head_camera import slip_matrices
from blendcap.synthetic.takes import choose_points
from stage import Scene, motion, scene

SHAPES, MARKERS, FRAMES = 4, 6, 20
BOUNDS = np.tile([0.0, 1.0], (SHAPES, 1))
LIDS = ("eyeBlinkLeft", "eyeBlinkRight")
KEEP = SolveSettings(head="keep")


def columns(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Deltas (N, M, 3) and displacements (T, M, 3) that weights between 0 and 1 explain, but for some noise."""
    rng = np.random.default_rng(seed)
    deltas = rng.normal(size=(SHAPES, MARKERS, 3))
    moved = np.tensordot(rng.uniform(size=(FRAMES, SHAPES)), deltas, axes=1)
    return deltas, moved + rng.normal(scale=0.02, size=moved.shape)


@pytest.fixture(scope="module")
def bare() -> Scene:
    """A take with nothing wrong but that no marker sees the lids."""
    whole = scene(motion())
    _, deltas = whole.rig.select(LIDS).sample(whole.binding.points)
    kept = [n for n, d in zip(whole.take.names, np.linalg.norm(deltas, axis=2).max(0), strict=True) if d < 1e-9]
    take, points = whole.take.select(kept), whole.binding.points.select(kept)
    return Scene(whole.rig, take, whole.truth, blendcap.bind(whole.rig, take, points, method="given"))


def seen_from(scene: Scene, eye, points: SurfacePoints | None = None) -> PaintTracks:
    """Exact tracks of points on the skin from a camera at `eye` (3,)."""
    points = points or choose_points(scene.rig, 60, seed=3)
    rest, deltas = scene.truth.performer.rig.sample(points)
    places = rest + np.tensordot(scene.truth.performer.expand(scene.truth.animation.weights), deltas, axes=1)
    sight = rest - eye
    axes = np.linalg.svd(sight[:, None])[2][:, 1:]
    names = tuple(f"p{k}" for k in range(len(rest)))
    points = SurfacePoints(names, points.faces, points.barycentric)
    to_take = scene.binding.to_take
    axes = axes @ scene.binding.rotation
    return PaintTracks(points, np.zeros(len(rest), dtype=int), to_take(rest), to_take(places), axes, scene.take.rate)


def solved(scene: Scene, tracks: PaintTracks | None = None, **settings):
    settings = SolveSettings(**{"head": "keep", **settings})
    return blendcap.solve(scene.rig, scene.take, scene.binding, tracks=tracks, settings=settings)


def lids_off(scene: Scene, solution) -> float:
    rows = [scene.rig.index(name) for name in LIDS]
    return float(np.abs(scene.off(solution)[:, rows]).max())


# The equation


def test_two_tracks_that_see_all_of_a_point_are_a_marker():
    deltas, moved = columns()
    whole = marker_rows(deltas, np.empty((0, MARKERS, 3)), moved, BOUNDS, -1.0)
    first, second = np.diag([1, np.sqrt(0.5), 0.0]), np.diag([0.0, np.sqrt(0.5), 1])
    twice = [np.concatenate([part, part[..., -2:, :]], axis=-2) for part in (deltas, moved)]
    axes = np.concatenate([np.tile(np.eye(3), (4, 1, 1)), [first] * 2, [second] * 2])
    split = marker_rows(twice[0], np.empty((0, MARKERS + 2, 3)), twice[1], BOUNDS, -1.0, axes)
    np.testing.assert_array_equal(split.coordinates, [3, 3, 3, 3, 1.5, 1.5, 1.5, 1.5])
    np.testing.assert_allclose(split.gram, whole.gram, atol=1e-12)
    ours, theirs = (solve_paper(rows, 0.1, 0.01)[0] for rows in (split, whole))
    np.testing.assert_allclose(ours, theirs, atol=1e-10)


def test_the_markers_of_rows_with_tracks_are_those_without():
    deltas, moved = columns()
    axes = np.concatenate([np.tile(np.eye(3), (4, 1, 1)), np.tile(np.diag([1.0, 1, 0]), (2, 1, 1))])
    rows = marker_rows(deltas, np.empty((0, MARKERS, 3)), moved, BOUNDS, -1.0, axes)
    alone = marker_rows(deltas[:, :4], np.empty((0, 4, 3)), moved[:, :4], BOUNDS, -1.0)
    assert rows.tracks.tolist() == [False] * 4 + [True] * 2
    for name in ("rows", "targets", "missing"):
        np.testing.assert_array_equal(getattr(rows.markers, name), getattr(alone, name))


def test_samples_that_are_something_else_are_left_out_and_markers_never():
    deltas, moved = columns()
    axes = np.concatenate([np.tile(np.eye(3), (2, 1, 1)), np.tile(np.diag([1.0, 1, 0]), (4, 1, 1))])
    truth = marker_rows(deltas, np.empty((0, MARKERS, 3)), moved, BOUNDS, -1.0, axes)
    unknowns = solve_paper(truth, 0.0, 1e-6)[0]
    moved[5, 0] += 9  # a marker
    moved[7, 4] += [6.0, 0, 0]  # a track
    moved[8, 5] += [0.0, 0, 50]  # along its line of sight
    rows = without_strays(marker_rows(deltas, np.empty((0, MARKERS, 3)), moved, BOUNDS, -1.0, axes), unknowns)
    assert np.argwhere(rows.missing).tolist() == [[7, 4]]
    np.testing.assert_array_equal(rows.targets[7, 4], 0)
    alone = marker_rows(deltas, np.empty((0, MARKERS, 3)), moved, BOUNDS, -1.0)
    assert without_strays(alone, unknowns) is alone


# The solve


@pytest.mark.parametrize("method", ["learned", "paper", "live"])
def test_tracks_tell_the_lids_that_no_marker_sees(bare, method):
    ways = {"method": method} | ({"beta": 0.0, "gamma": 1e-9} if method == "paper" else {})
    assert lids_off(bare, solved(bare, **ways)) > 0.5
    assert lids_off(bare, solved(bare, seen_from(bare, [0, 0, 250]), **ways)) < (1e-5 if method == "paper" else 0.12)


def test_how_deep_a_track_lies_is_not_believed(bare):
    tracks = seen_from(bare, [40, 20, 250])
    away = np.cross(tracks.axes[:, 0], tracks.axes[:, 1])
    deep = tracks.positions + np.random.default_rng(0).normal(scale=5.0, size=(*tracks.lost.shape, 1)) * away
    shallow, other = (
        solved(bare, t, helmet="none").animation.weights for t in (tracks, replace(tracks, positions=deep))
    )
    np.testing.assert_allclose(shallow, other, atol=1e-6)
    assert np.abs(shallow - bare.truth.animation.weights).mean() < 0.02


def test_a_solution_with_tracks_speaks_of_its_markers_and_of_its_tracks(bare):
    tracks = seen_from(bare, [0, 0, 250])
    lost = np.array(tracks.positions)
    lost[:, ::10] = np.nan
    solution = solved(bare, replace(tracks, positions=lost))
    assert solution.residuals.shape == bare.take.positions.shape[:2] and solution.marker_names == bare.take.names
    assert solution.fitted.shape == solution.targets.shape == bare.take.positions.shape
    assert set(solution.trusted) == set(bare.take.names)
    assert solution.track_rms.shape == (len(lost),) and solution.track_rms.max() < 0.1
    assert solution.settings["tracks"].startswith("60, of their samples 10.0% lost")
    assert solution.certificate.converged
    alone = solved(bare)
    assert alone.track_rms is None and "tracks" not in alone.settings


def test_how_the_take_lies_beside_the_rig_changes_nothing(bare):
    """Turned by 30 degrees, larger and elsewhere: axes are directions in the take, and turn with it."""
    turn = cv2.Rodrigues(np.deg2rad(30) * np.array([0.48, 0.6, 0.64]))[0]

    def laid(positions: np.ndarray) -> np.ndarray:
        return 1.3 * positions @ turn.T + np.array([20.0, -70, 300])

    tracks = seen_from(bare, [90, 40, 250])
    take = replace(bare.take, positions=laid(bare.take.positions))
    turned = Scene(bare.rig, take, bare.truth, blendcap.bind(bare.rig, take, bare.binding.points, method="given"))
    other = replace(tracks, rest=laid(tracks.rest), positions=laid(tracks.positions), axes=tracks.axes @ turn.T)
    ours, theirs = solved(turned, other), solved(bare, tracks)
    np.testing.assert_allclose(ours.animation.weights, theirs.animation.weights, atol=1e-5)
    np.testing.assert_allclose(ours.track_rms, theirs.track_rms, atol=1e-6)


def test_curves_are_put_on_the_scale_of_what_sees_their_shapes(bare):
    """No marker sees the lids: alone, a curve that tells half of them counts at its word; beside tracks not."""
    true = bare.truth.animation.select(LIDS)
    half, tracks = replace(true, weights=0.5 * true.weights), seen_from(bare, [0, 0, 250])
    weak = replace(tracks, axes=0.3 * tracks.axes)

    def gain(tracks: PaintTracks | None) -> float:
        answer = blendcap.solve(bare.rig, bare.take, bare.binding, tracks=tracks, patches=half, settings=KEEP)
        lids = answer.animation.select(LIDS).weights
        return float((lids * true.weights).sum() / (true.weights**2).sum())

    assert 0.4 < gain(None) < 0.6
    assert 0.75 < gain(weak) < 1.05


def test_a_curve_is_believed_where_shut_lids_hide_the_tracks(bare):
    true = bare.truth.animation.select(LIDS)
    shut = (true.weights > 0.5).any(1)
    tracks = seen_from(bare, [0, 0, 250])
    hidden = replace(tracks, positions=np.where(shut[:, None, None], np.nan, tracks.positions))
    answer = blendcap.solve(bare.rig, bare.take, bare.binding, tracks=hidden, patches=true, settings=KEEP)
    told = answer.animation.select(LIDS).weights
    assert np.abs(told - true.weights)[shut].mean() < 0.06
    alone = solved(bare, hidden).animation.select(LIDS).weights
    assert np.abs(alone - true.weights)[shut].mean() > 0.3


def test_axes_say_by_how_much_a_track_counts(bare):
    """Longer axes are believed more; one that tells nothing changes nothing."""
    tracks = seen_from(bare, [0, 0, 250])
    assert solved(bare, replace(tracks, axes=1.7 * tracks.axes)).residuals.shape == bare.take.positions.shape[:2]
    blind = np.array(tracks.axes)
    blind[7] = 0
    wild = np.array(tracks.positions)
    wild[:, 7] += 30
    ours = solved(bare, replace(tracks, axes=blind, positions=wild))
    theirs = solved(bare, replace(tracks, axes=blind))
    np.testing.assert_array_equal(ours.animation.weights, theirs.animation.weights)


def test_precise_tracks_do_not_put_markers_in_doubt(bare):
    """The markers' errors of half a millimetre are usual among markers, though no track errs so far."""
    noisy = bare.take.positions + np.random.default_rng(0).normal(scale=0.8, size=bare.take.positions.shape)
    scene = Scene(bare.rig, replace(bare.take, positions=noisy), bare.truth, bare.binding)
    with_tracks = solved(scene, seen_from(bare, [0, 0, 250]))
    assert min(with_tracks.trusted.values()) > 0.9


def test_a_helmet_that_slips_takes_the_tracks_along():
    slipping = scene(motion(), slip=(2.0, 2.0), seed=4)
    points = choose_points(slipping.rig, 60, seed=3)
    still = seen_from(slipping, [0, 0, 250], points)
    truth = slipping.truth
    matrices = slip_matrices(truth)
    moved = slipping.binding.to_rig(still.positions) @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]
    solution = solved(slipping, replace(still, positions=slipping.binding.to_take(moved)))
    assert np.sqrt((slipping.off(solution) ** 2).mean()) < 0.04
    assert np.abs(solution.helmet[:, 3:] - truth.slip[:, 3:]).max() < 0.01


def test_tracks_of_another_time_are_told(bare, caplog):
    tracks = seen_from(bare, [0, 0, 250])
    for wrong in (tracks.positions[::-1], np.roll(tracks.positions, 90, axis=0)):
        caplog.clear()
        solved(bare, replace(tracks, positions=wrong))
        assert any("hardly move as the markers do" in message for message in caplog.messages)


@pytest.mark.parametrize(("late", "words"), [(2, "2 frames before"), (-3, "3 frames after"), (0, "")])
def test_a_film_that_is_early_or_late_is_told(bare, caplog, late, words):
    """Tracks that come late are of a film that began before the markers."""
    tracks = seen_from(bare, [0, 0, 250])
    caplog.clear()
    solved(bare, replace(tracks, positions=np.roll(tracks.positions, late, axis=0)))
    said = [message for message in caplog.messages if "film seems" in message or "hardly" in message]
    assert len(said) == bool(late) and all(words in message for message in said)


@pytest.mark.parametrize(
    ("change", "settings", "sentence"),
    [
        (lambda t: replace(t, positions=t.positions[:-1]), {}, "frames at 24 a second, but the take"),
        (lambda t: replace(t, rate=30.0), {}, "frames at 30 a second, but the take"),
        (lambda t: replace(t, rest=t.rest + 20), {}, "mm from the rig"),
        (lambda t: replace(t, positions=np.full_like(t.positions, np.nan)), {}, "No track was found in any frame"),
        (lambda t: t, {"head": "remove"}, "keep the head's motion"),
    ],
)
def test_tracks_of_something_else_are_refused(bare, change, settings, sentence):
    with pytest.raises(InputError, match=sentence):
        solved(bare, change(seen_from(bare, [0, 0, 250])), **settings)


def test_head_motion_found_by_itself_stays_when_there_are_tracks():
    turning = scene(motion(), head=(30.0, 8.0))
    settings = SolveSettings()
    tracks = seen_from(turning, [0, 0, 250])
    assert blendcap.solve(turning.rig, turning.take, turning.binding, settings=settings).animation.head is not None
    both = blendcap.solve(turning.rig, turning.take, turning.binding, tracks=tracks, settings=settings)
    assert both.animation.head is None


# The record and its file


def test_tracks_come_back_from_their_file(bare, tmp_path):
    tracks = seen_from(bare, [0, 0, 250])
    gone = np.array(tracks.positions)
    gone[3, 4] = np.nan
    write_tracks(tmp_path / "t.npz", replace(tracks, positions=gone))
    back = read_tracks(tmp_path / "t.npz")
    assert back.points.names == tracks.points.names and back.rate == tracks.rate
    np.testing.assert_array_equal(back.points.faces, tracks.points.faces)
    for name in ("cameras", "rest", "axes"):
        np.testing.assert_array_equal(getattr(back, name), getattr(tracks, name))
    np.testing.assert_allclose(back.positions, gone, atol=1e-4)
    assert np.argwhere(back.lost).tolist() == [[3, 4]]


def test_files_that_are_no_tracks_are_refused(bare, tmp_path):
    write_tracks(tmp_path / "t.npz", seen_from(bare, [0, 0, 250]))
    content = (tmp_path / "t.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(content[: len(content) // 2])
    blendcap.write_animation(tmp_path / "weights.npz", motion())
    for name, sentence in (("cut", "cut.npz"), ("weights", "holds no paint tracks"), ("none", "no such file")):
        with pytest.raises(InputError, match=sentence):
            read_tracks(tmp_path / f"{name}.npz")
    with pytest.raises(InputError, match=r"end its name with \.npz"):
        write_tracks(tmp_path / "t.csv", seen_from(bare, [0, 0, 250]))


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"positions": np.zeros((0, 2, 3))}, "empty"),
        ({"positions": np.full((4, 2, 3), np.inf)}, "'p0' is at infinity in frame 0"),
        ({"rest": np.zeros((3, 3))}, "rest"),
        ({"axes": np.full((2, 2, 3), np.nan)}, "axes"),
        ({"rate": 0.0}, "rate"),
        ({"cameras": np.array([0, -1])}, "cameras"),
    ],
)
def test_tracks_that_cannot_be_are_refused(wrong, sentence):
    points = SurfacePoints(("p0", "p1"), np.array([0, 1]), np.tile([1.0, 0, 0], (2, 1)))
    right = {"cameras": np.array([0, 0]), "rest": np.zeros((2, 3)), "positions": np.zeros((4, 2, 3)),
             "axes": np.zeros((2, 2, 3)), "rate": 24.0}  # fmt: skip
    PaintTracks(points, **right)
    with pytest.raises(InputError, match=sentence):
        PaintTracks(points, **right | wrong)


def test_tracks_of_skin_do_not_tell_what_lies_behind_it():
    """A tongue that moves the lip, too, stays where the markers leave it."""
    rig = blendcap.mannequin(1, shapes=52)
    points = choose_points(rig, 60, seed=3)
    told = np.abs(track_deltas(rig, points)).max((1, 2)) > 0
    shown = np.abs(rig.sample(points)[1]).max((1, 2)) > 0.01
    lost = {name for name, was, now in zip(rig.names, shown, told, strict=True) if was and not now}
    assert lost <= {"tongueOut", "eyeLookInLeft", "eyeLookInRight", "eyeLookOutLeft", "eyeLookOutRight"}
    assert "tongueOut" in lost and told[rig.index("eyeLookDownLeft")] and told[rig.index("jawOpen")]
