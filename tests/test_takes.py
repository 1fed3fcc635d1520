from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blendcap.data import Animation, InputError, Mesh, Rig, SurfacePoints
from blendcap.numerics.geodesic import surface_distances, weld
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take, misplace
from sheet import SLIT_Y, sheet_rig

PERFECT = {"noise": 0.0, "misplacement": 0.0, "slip": (0.0, 0.0), "occlusion": 0.0}


@pytest.fixture(scope="module")
def rig():
    return sheet_rig()


@pytest.fixture(scope="module")
def performer(rig):
    return make_performer(rig, seed=3)


@pytest.fixture(scope="module")
def points(rig):
    return choose_points(rig, 20, seed=1)


@pytest.fixture(scope="module")
def animation(rig):
    time = np.arange(900)[:, None] / 60
    weights = 0.5 + 0.5 * np.sin(2 * np.pi * time * np.linspace(0.3, 1.1, len(rig.names)) + np.arange(len(rig.names)))
    return Animation(weights, rig.names, 60)


def test_points_spread_along_the_surface(rig, points):
    vertices = np.array([rig.mesh.faces[f][b.argmax()] for f, b in zip(points.faces, points.barycentric, strict=True)])
    between = surface_distances(rig.mesh.vertices, rig.mesh.faces, vertices)[:, vertices]
    gaps = [between[k, :k].min() for k in range(1, len(vertices))]
    assert (np.diff(gaps) <= 1e-9).all()  # each is the farthest there was
    assert np.isin(vertices, rig.moving_vertices()).all()
    assert points.names[:2] == ("m00", "m01") and len(set(vertices)) == 20
    moving = rig.moving_vertices()
    cover = surface_distances(rig.mesh.vertices, rig.mesh.faces, vertices)[:, moving].min(0)
    assert cover.max() <= gaps[-1] + 1e-9  # nothing is farther from a marker than markers from each other


def test_points_keep_to_the_skin(rig, points):
    assert np.array_equal(choose_points(rig, 20, seed=1).faces, points.faces)
    with pytest.raises(InputError, match="moving vertices"):
        choose_points(rig, 5000)


def test_a_texture_seam_is_no_border(rig):
    split, _ = cut(rig)
    whole, found = choose_points(rig, 15, seed=3), choose_points(split, 15, seed=3)
    assert np.allclose(found.positions(split.mesh), whole.positions(rig.mesh))


def cut(rig):
    """The rig as a file would have it whose texture has a seam: the middle column of the upper half twice."""
    vertices, faces = rig.mesh.vertices, rig.mesh.faces.copy()
    seam = np.flatnonzero((np.abs(vertices[:, 0]) < 1e-9) & (vertices[:, 1] > 0))
    copy = np.arange(len(vertices))
    copy[seam] = len(vertices) + np.arange(len(seam))
    right = vertices[faces][:, :, 0].mean(1) < 0
    faces[right] = copy[faces[right]]
    mesh = Mesh(np.concatenate([vertices, vertices[seam]]), faces)
    split = Rig(mesh, np.concatenate([rig.deltas, rig.deltas[:, seam]], axis=1), rig.names)
    return replace(split, mirror=rig.mirror, regions=rig.regions), seam


def test_welding_joins_seams_and_leaves_lips_apart(rig):
    split, seam = cut(rig)
    welded = weld(split.mesh.faces, split.mesh.vertices, split.deltas)
    assert np.array_equal(welded, rig.mesh.faces)
    assert len(seam) > 10 and np.array_equal(weld(rig.mesh.faces, rig.mesh.vertices, rig.deltas), rig.mesh.faces)
    stiff = weld(rig.mesh.faces, rig.mesh.vertices, 0 * rig.deltas)
    assert len(np.unique(stiff)) == len(rig.mesh.vertices) - len(rig.contacts["lips"])


def test_a_perfect_take_is_the_performer(performer, points, animation):
    take, truth = make_take(performer, animation, points, seed=0, neutral_frames=0, **PERFECT)
    assert np.allclose(take.positions, performer.sample(points, animation.weights))
    assert np.array_equal(truth.animation.weights, animation.weights)
    assert not truth.missing.any() and not truth.slip.any()
    assert take.names == points.names and take.rate == 60


def test_neutral_frames_come_first_and_ease_into_the_performance(performer, points, animation):
    take, truth = make_take(performer, animation, points, seed=0, neutral_frames=10, noise=0, occlusion=0.5)
    assert len(take.positions) == 10 + 15 + 900
    assert np.allclose(take.positions[:10], truth.points.positions(performer.rig.mesh))
    assert not truth.slip[:10].any() and not truth.missing[:10].any()
    assert np.array_equal(truth.animation.weights[25:], animation.weights)
    steps = np.abs(np.diff(truth.animation.weights[:26], axis=0))
    assert steps.max() < 0.14 * animation.weights[0].max()  # a minimum-jerk rise over a quarter of a second
    assert np.allclose(truth.vertices(5), performer.rig.mesh.vertices)


def test_the_truth_explains_the_positions(performer, points, animation):
    take, truth = make_take(performer, animation, points, seed=5, noise=0, slip=(3.0, 4.0), occlusion=0)
    rigid = Rotation.from_rotvec(truth.slip[:, 3:])
    back = np.stack(
        [rigid[t].inv().apply(truth.positions[t] - truth.pivot - truth.slip[t, :3]) for t in range(0, 900, 50)]
    )
    expected = np.stack([truth.points.matrix(performer.rig.mesh) @ truth.vertices(t) for t in range(0, 900, 50)])
    assert np.allclose(back + truth.pivot, expected, atol=1e-4)
    assert np.allclose(take.positions, truth.positions)


def test_misplaced_markers_stay_on_their_side_of_the_mouth(rig, performer):
    lips = rig.contacts["lips"]
    for side, sign in ((0, 1), (1, -1)):
        faces = np.flatnonzero(np.isin(rig.mesh.faces, lips[:, side]).any(1))
        names = [f"p{i}" for i in range(len(faces))]
        given = SurfacePoints(names, faces, np.full((len(faces), 3), 1 / 3))
        moved = misplace(given, rig, 3.0, np.random.default_rng(side))
        y = moved.positions(rig.mesh)[:, 1]
        assert ((y - SLIT_Y) * sign > -1e-9).mean() > 0.9  # the few others went around the corner
        jaw = np.zeros(len(rig.names))
        jaw[rig.index("jawOpen")] = 1
        motion = moved.matrix(rig.mesh) @ (rig.pose(jaw) - rig.mesh.vertices)
        near = np.abs(y - SLIT_Y) < 1e-6  # stopped at the lip
        assert near.any()
        middle = near & (np.abs(moved.positions(rig.mesh)[:, 0]) < 15)
        assert (np.abs(motion[middle, 1]) > 5).all() if sign < 0 else (np.abs(motion[middle, 1]) < 1).all()


def test_misplacement_has_the_length_that_was_asked_for(rig, points):
    inner = [n for n, p in zip(points.names, points.positions(rig.mesh), strict=True) if np.abs(p[:2]).max() < 52]
    inner = points.select([n for n in inner if abs(points.select([n]).positions(rig.mesh)[0, 1] - SLIT_Y) > 6])
    rng = np.random.default_rng(0)
    moved = np.stack([misplace(inner, rig, 1.5, rng).positions(rig.mesh) for _ in range(60)])
    shift = moved - inner.positions(rig.mesh)
    assert np.sqrt((shift**2).sum(2).mean()) == pytest.approx(1.5, rel=0.08)
    assert np.abs(shift.mean((0, 1))).max() < 0.15  # no direction is favored


def test_a_take_misplaces_its_markers(rig, performer, points, animation):
    brief = Animation(animation.weights[:5], animation.names, 60)
    truths = [make_take(performer, brief, points, seed=s, misplacement=2.0)[1] for s in range(10)]
    apart = [truth.points.positions(rig.mesh) for truth in truths]
    inner = np.abs(points.positions(rig.mesh)[:, :2]).max(1) < 50
    shift = np.linalg.norm(apart - points.positions(rig.mesh), axis=2)[:, inner]
    assert np.sqrt((shift**2).mean()) == pytest.approx(2.0, rel=0.2)


def test_noise_and_gaps_are_as_stated(performer, points, animation):
    long = Animation(np.tile(animation.weights, (12, 1)), animation.names, 60)
    take, truth = make_take(performer, long, points, seed=2, noise=0.2, occlusion=0.05, neutral_frames=0)
    assert np.array_equal(take.missing, truth.missing)
    assert np.nanstd(take.positions - truth.positions) == pytest.approx(0.2, rel=0.01)
    assert truth.missing.mean() == pytest.approx(0.05, rel=0.2)
    starts = (np.diff(truth.missing.astype(int), axis=0) == 1).sum() + truth.missing[0].sum()
    assert truth.missing.sum() / starts == pytest.approx(40, rel=0.2)


def test_slip_and_head_have_the_stated_size_and_are_smooth(performer, points, animation):
    _, truth = make_take(performer, animation, points, seed=4, slip=(2.0, 3.0), head=(30.0, 8.0), neutral_frames=12)
    assert np.sqrt((truth.slip[:, :3] ** 2).sum(1).mean()) == pytest.approx(2.0)
    assert np.rad2deg(np.sqrt((truth.slip[:, 3:] ** 2).sum(1).mean())) == pytest.approx(3.0)
    assert np.abs(np.diff(truth.slip[:, :3], axis=0)).max() < 0.5
    head = truth.animation.head
    angle = np.rad2deg(np.linalg.norm(Rotation.from_matrix(head[:, :3, :3]).as_rotvec(), axis=1))
    assert np.sqrt((angle**2).mean()) == pytest.approx(8.0)
    assert np.allclose(head[:12], np.eye(4))
    still, _ = make_take(performer, animation, points, seed=4, slip=(2.0, 3.0), neutral_frames=12)
    assert still.positions.shape == (12 + 15 + 900, 20, 3)


def test_the_animations_own_head_motion_is_applied(performer, points, animation):
    head = np.tile(np.eye(4), (900, 1, 1))
    head[:, :3, 3] = (10, 20, 30)
    moved = Animation(animation.weights, animation.names, 60, head)
    take, truth = make_take(performer, moved, points, seed=0, neutral_frames=5, **PERFECT)
    plain, _ = make_take(performer, animation, points, seed=0, neutral_frames=5, **PERFECT)
    assert np.allclose(take.positions, plain.positions + head[0, :3, 3])
    assert np.array_equal(truth.animation.head, np.repeat(head[:1], len(take.positions), axis=0))


def test_a_seed_is_a_take(performer, points, animation):
    one, two, other = (make_take(performer, animation, points, seed=s)[0].positions for s in (7, 7, 8))
    assert np.array_equal(one, two, equal_nan=True)
    assert not np.array_equal(one, other, equal_nan=True)


def test_a_second_take_keeps_the_markers_where_they_were_glued(performer, points, animation):
    _, first = make_take(performer, animation, points, seed=1)
    _, second = make_take(performer, animation, first.points, seed=2, misplacement=0.0)
    mesh = performer.rig.mesh
    assert np.allclose(second.points.positions(mesh), first.points.positions(mesh))


def test_a_take_of_resisting_skin_keeps_what_was_meant(rig, points, animation):
    stiff = make_performer(rig, seed=3, resistance=1.0)
    take, truth = make_take(stiff, animation, points, seed=0, neutral_frames=0, **PERFECT)
    assert np.array_equal(truth.animation.weights, animation.weights)
    assert np.allclose(take.positions, stiff.sample(points, animation.weights))
    assert np.allclose(take.positions[7], points.matrix(rig.mesh) @ truth.vertices(7), atol=1e-4)
