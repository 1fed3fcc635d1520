"""Automatic places: true ones recovered on other faces, from any position, and on the real cloud."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blendcap.data import InputError, MarkerTake, Mesh, Rig
from blendcap.markers.front import front_of
from blendcap.markers.places import confidence, find_places, lay_on
from blendcap.synthetic.mannequin import mannequin

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "animface" / "correspondences.json"


@pytest.fixture(scope="module")
def rig():
    return mannequin(shapes=52)


@pytest.fixture(scope="module")
def other_face(rig):
    """Where the rig's markers sit on another person, mm."""
    return rig.points["markers50"].positions(mannequin(4, shapes=52).mesh)


@pytest.fixture(scope="module")
def true(rig):
    """Where they sit on the rig, mm."""
    return rig.points["markers50"].positions(rig.mesh)


def somewhere(positions, seed):
    """The cloud in the space of some capture volume, with noise."""
    rng = np.random.default_rng(seed)
    turned = positions @ Rotation.random(random_state=seed).as_matrix().T
    return turned + rng.normal(0, 400, 3) + rng.normal(0, 0.2, positions.shape)


def upside_down(positions):
    return positions * [-1, -1, 1]


def back_to_front(positions):
    return positions * [-1, 1, -1]


def as_take(positions):
    return MarkerTake(positions[None], [f"m{i}" for i in range(len(positions))], 60)


@pytest.mark.parametrize("put", [upside_down, back_to_front, lambda p: somewhere(p, 1), lambda p: somewhere(p, 2)])
def test_places_on_another_face_are_recovered_from_any_position(rig, other_face, true, put):
    found = find_places(rig, as_take(put(other_face))).positions(rig.mesh)
    error = np.linalg.norm(found - true, axis=1)
    assert np.median(error) < 5
    assert error.max() < 15
    sided = np.abs(true[:, 0]) > 10
    assert (np.sign(found[sided, 0]) == np.sign(true[sided, 0])).all()


@pytest.mark.parametrize("part", [np.less, np.greater_equal])
def test_half_a_face_is_found(rig, other_face, true, part):
    half = part(true[:, 1], np.median(true[:, 1]))
    found = find_places(rig, as_take(somewhere(other_face[half], 3))).positions(rig.mesh)
    assert np.median(np.linalg.norm(found - true[half], axis=1)) < 8


def test_the_answer_does_not_depend_on_where_the_take_stands(rig, other_face):
    front = front_of(rig)
    answers = [lay_on(front, upside_down(other_face))[0].positions, lay_on(front, other_face + 1000)[0].positions]
    # Not exactly: the skin is searched by the centers of its triangles, which lie 2 to 4 mm apart.
    assert np.linalg.norm(answers[0] - answers[1], axis=1).max() < 2


def test_the_placement_is_the_similarity_it_says(rig, other_face):
    placed = lay_on(front_of(rig), somewhere(other_face, 5))
    best = placed[0]
    moved = best.scale * somewhere(other_face, 5) @ best.rotation.T + best.translation
    np.testing.assert_allclose(moved, best.positions, atol=1e-9)
    assert np.linalg.det(best.rotation) == pytest.approx(1)
    assert [p.cost for p in placed] == sorted(p.cost for p in placed)
    assert 0.3 < confidence(placed) < 1


@pytest.mark.parametrize("take", ["Eyebrows", "Jaw"])
def test_the_real_markers_are_found_where_a_person_put_them(data, take):
    from blendcap.io import read_markers, read_rig

    rig = read_rig(data("rigs/ict_face_head.glb"))
    table = json.loads(EXAMPLE.read_text())
    found = find_places(rig, read_markers(data(f"markers/animface_{take}.c3d")))
    places = found.positions(rig.mesh)
    error = np.linalg.norm(places - rig.mesh.vertices[[table[name] for name in found.names]], axis=1)
    assert np.median(error) < 7
    assert error.max() < 16
    for name, place in zip(found.names, places, strict=True):
        if name[0] in "LR" and name[1:4] in ("eye", "che"):
            assert (place[0] > 0) == (name[0] == "L")


def test_the_example_table_fits_the_real_cloud(data):
    from blendcap.io import read_correspondences, read_markers, read_rig
    from blendcap.markers.cleaning import neutral_frame
    from blendcap.markers.correspondences import resolve
    from blendcap.numerics.similarity import align, apply

    rig = read_rig(data("rigs/ict_face_head.glb"))
    for name in ("Eyebrows", "Jaw"):
        take = read_markers(data(f"markers/animface_{name}.c3d"))
        points = resolve(rig, read_correspondences(EXAMPLE), take.names)
        assert points.names == take.names
        places, neutral = points.positions(rig.mesh), neutral_frame(take)
        fit = align(neutral, places)
        off = np.linalg.norm(apply(neutral, *fit) - places, axis=1)
        assert np.median(off) < 4
        assert off.max() < 8
        assert 0.9 < fit[2] < 1.1


def test_a_cloud_without_features_is_warned_of(rig, caplog):
    x, y = np.meshgrid(np.linspace(-20, 20, 4), np.linspace(-20, 20, 4))
    flat = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    with caplog.at_level(logging.WARNING):
        find_places(rig, as_take(flat))
    assert "check their places" in caplog.text


def test_markers_that_the_neutral_misses_get_no_place(rig, other_face):
    positions = np.tile(other_face, (20, 1, 1))
    positions[:15, 3] = np.nan
    take = MarkerTake(positions, [f"m{i}" for i in range(len(other_face))], 60)
    assert find_places(rig, take).names == tuple(name for name in take.names if name != "m3")
    assert find_places(rig, take, frame=15).names == take.names  # a neutral that sees it


def test_trajectories_that_nobody_labeled_get_no_place(rig, other_face):
    names = [f"m{i}" for i in range(len(other_face))]
    ghosts = np.vstack([other_face, 2 * other_face[:2]])
    assert find_places(rig, MarkerTake(ghosts[None], [*names, "*1", "*2"], 60)).names == tuple(names)


def test_too_few_markers_are_refused(rig, other_face):
    with pytest.raises(InputError, match="at least 8"):
        find_places(rig, as_take(other_face[:7]))


def test_a_rig_that_faces_away_is_refused():
    sheet = Mesh(np.array([[0.0, 0, 0], [0, 10, 0], [10, 0, 0]]), np.array([[0, 1, 2]]))
    still = Rig(sheet, np.zeros((1, 3, 3)), ["jawOpen"])
    with pytest.raises(InputError, match="front"):
        front_of(still)


def test_the_front_leaves_out_the_back_of_the_head_and_the_inside_of_the_mouth(rig):
    front = front_of(rig)
    corners = rig.mesh.faces[front.faces]
    behind = rig.mesh.vertices[:, 2].min()
    middle = 0.5 * (behind + rig.mesh.vertices[:, 2].max())
    assert (front.points[:, 2] > middle).mean() > 0.75
    assert front.normals[:, 2].min() > -0.5  # also from below, where a camera sees the nape
    hidden = np.intersect1d(rig.regions["teeth"], corners)
    assert len(hidden) < 0.05 * len(rig.regions["teeth"])
    np.testing.assert_allclose(np.linalg.norm(front.normals, axis=1), 1)
