"""Landmarks on the wrong places: refused whatever their number, and right ones never."""

import logging
from functools import cache

import numpy as np
import pytest

import blendcap
from blendcap.data import InputError, SurfacePoints
from blendcap.modeling.landmark_checks import _mirrored_surface, check_landmarks
from blendcap.modeling.landmark_names import rig_landmarks
from blendcap.modeling.landmark_pairs import find_pairs
from blendcap.numerics.similarity import apply

RIG = blendcap.mannequin(shapes=52)
ALL = rig_landmarks(RIG)
EYES = {"eye_outer_right": "eye_outer_left", "eye_inner_right": "eye_inner_left"}
MOUTH = {"lip_corner_right": "lip_corner_left"}
FIVE = ("eye_outer_right", "eye_outer_left", "nose_tip", "lip_corner_right", "lip_corner_left")
THREE = ("eye_inner_right", "eye_inner_left", "lip_corner_left")
SEVEN = (*FIVE, *list(EYES.items())[1])
ELEVEN = (*SEVEN, "lip_top", "lip_bottom", "lips_upper_3", "lips_upper_7")
ALONG = {f"lips_upper_{k}": f"lips_upper_{10 - k}" for k in range(1, 5)}


@cache
def mesh_of(person):
    return blendcap.mannequin(person, 52).mesh


def check(names, exchanged, person=5, noise=1.0, seed=0, off=(0, 0.0)):
    """Landmarks of one mannequin on another, turned and in another size; the exchanged ones at each other's place.

    `off` is how many lie off, anywhere, by how many mm.
    """
    rng, points, other = np.random.default_rng(seed), ALL.select(list(names)), mesh_of(person)
    both = {**exchanged, **{b: a for a, b in exchanged.items()}}
    taken = ALL.select([both.get(name, name) for name in names])
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    there = taken.positions(other) + rng.normal(0, noise, (len(names), 3))
    away = rng.normal(size=(off[0], 3))
    there[rng.choice(len(names), off[0], replace=False)] += off[1] * away / np.linalg.norm(away, axis=1, keepdims=True)
    motion = turn, np.ones(3), 0.1
    scan = other.with_vertices(apply(other.vertices, *motion))
    check_landmarks(names, points.positions(RIG.mesh), apply(there, *motion), RIG.mesh, scan)


@pytest.mark.parametrize("names", [FIVE, FIVE[:3], THREE, ALL.names])
def test_right_landmarks_pass_without_a_word(names, caplog):
    with caplog.at_level(logging.WARNING):
        for person in range(1, 4):
            check(names, {}, person, seed=person)
    assert not caplog.records


@pytest.mark.parametrize("names", [
    FIVE, FIVE[:3], (FIVE[0], FIVE[1], *FIVE[3:]), (*EYES, *EYES.values(), "nose_tip"), (*EYES, *EYES.values(), *MOUTH),
])  # fmt: skip
def test_sides_that_are_all_swapped_are_refused(names):
    """Also where half a turn lays the points themselves onto their mirror image, as three points always do."""
    for person in range(1, 4):
        with pytest.raises(InputError, match="left and right are swapped"):
            check(names, {**EYES, **MOUTH}, person, seed=person)


@pytest.mark.parametrize(("rows", "swapped"), [([0, 1, 2], False), ([1, 0, 2], True), ([1, 0, 4, 3], True)])
def test_the_surface_around_tells_what_few_landmarks_do_not(rows, swapped):
    points = ALL.select([FIVE[row] for row in sorted(rows)])
    for person in range(1, 4):
        there = ALL.select([FIVE[row] for row in rows]).positions(mesh_of(person))
        assert _mirrored_surface(points.positions(RIG.mesh), there, RIG.mesh, mesh_of(person)) == swapped


@pytest.mark.parametrize(
    ("names", "exchanged", "said"),
    [
        (FIVE, {"eye_outer_right": "eye_outer_left"}, "eye_outer_right and eye_outer_left lie where each other"),
        (FIVE, MOUTH, "lip_corner_right and lip_corner_left lie"),
        (THREE, EYES, "The landmarks eye_inner_right and eye_inner_left lie"),
        (SEVEN, EYES, "the template, but for lip_corner_right and lip_corner_left: left"),
        (ELEVEN, EYES, "eye_outer_right and eye_outer_left, eye_inner_right and eye_inner"),
        (ALL.names, MOUTH, "The landmarks lip_corner_right and lip_corner_left lie"),
        (ALL.names, {**EYES, **MOUTH}, "and eye_outer_left, eye_inner_right and eye_inner_left, lip_corner_right and"),
        (ALL.names, {"lip_top": "nose_tip"}, "The landmarks nose_tip and lip_top lie"),
        (ALL.names, ALONG, r"lips_upper_1 and lips_upper_9, .* \(1 more\) lie"),
    ],
)  # fmt: skip
def test_exchanged_landmarks_are_named(names, exchanged, said):
    for person in range(1, 4):
        with pytest.raises(InputError, match=said):
            check(names, exchanged, person, seed=person)


@pytest.mark.parametrize(("names", "off", "seeds"), [
    (FIVE[:3], (1, 80.0), (2, 3)), (FIVE, (2, 40.0), (0, 1, 3)), (FIVE, (5, 80.0), range(4)),
    (FIVE, (3, 60.0), range(4)), ((*EYES, *EYES.values(), "nose_tip"), (2, 40.0), range(4)),
    (ELEVEN, (6, 80.0), range(4)),
])  # fmt: skip
def test_landmarks_anywhere_are_neither_swapped_nor_exchanged_but_wrong(names, off, seeds):
    """And the three that lie farthest are named."""
    for seed in seeds:
        with pytest.raises(InputError, match=r"do not fit the template: [1-9]\d* of") as refused:
            check(names, {}, 1, seed=seed, off=off)
        assert 1 <= str(refused.value).count(" mm)") <= 3


@pytest.mark.parametrize(("names", "one", "other", "away"), [
    (FIVE, "eye_outer_left", "nose_tip", [80, 0, 0]), (FIVE, "lip_corner_left", "nose_tip", [0, -80, 0]),
    (FIVE, "nose_tip", "lip_corner_right", [0, 60, 30]),
])  # fmt: skip
def test_one_that_lies_at_the_place_of_another_is_not_exchanged_with_it(names, one, other, away):
    """The other lies elsewhere: to exchange them would help the fit, but is not what happened."""
    points, scan = ALL.select(list(names)), mesh_of(2)
    there = points.positions(scan)
    i, j = names.index(one), names.index(other)
    there[i], there[j] = there[j], there[j] + away
    with pytest.raises(InputError, match="do not fit the template"):
        check_landmarks(names, points.positions(RIG.mesh), there, RIG.mesh, scan)


@pytest.mark.parametrize(("names", "off", "seeds"), [(SEVEN, (2, 40.0), (1, 2, 3)), (FIVE[:3], (1, 80.0), (0, 1))])
def test_few_that_are_off_are_a_warning(caplog, names, off, seeds):
    for seed in seeds:
        check(names, {}, 1, seed=seed, off=off)
        assert "Landmarks that lie far from where the others put them" in caplog.records[-1].message
    assert len(caplog.records) == len(seeds)


def test_landmarks_on_a_line_are_said_to_be_and_sides_that_are_swapped_there_refused(caplog):
    """Of four corners of eyes: half a turn lays them onto their mirror image, an upside-down face."""
    for person in range(1, 4):
        check((*EYES, *EYES.values()), {}, person, seed=person)
        assert "nearly on a line" in caplog.records[-1].message
        with pytest.raises(InputError, match="left and right are swapped"):
            check((*EYES, *EYES.values()), EYES, person, seed=person)
    assert len(caplog.records) == 3


def test_one_landmark_that_is_off_is_a_warning(caplog):
    names = (*FIVE, "lip_top", "lip_bottom", "between_eyes")
    points, mesh = ALL.select(list(names)), RIG.mesh
    here = points.positions(mesh)
    there = here.copy()
    there[2] += [0, 40, 0]
    check_landmarks(names, here, there, mesh, mesh)
    assert "Landmarks that lie far from where the others put them: nose_tip (" in caplog.text


@pytest.mark.parametrize(("wrong", "kept"), [((), 66), (("nose_tip",), 65), (("eye_outer_left", "nose_tip"), 46)])
def test_what_was_found_where_the_others_do_not_put_it_is_left_out(monkeypatch, wrong, kept):
    """With the lines that were traced from there. What the user gave stays, with a warning."""
    moved = [list(ALL.names).index("lip_corner_right") if name in wrong else row for row, name in enumerate(ALL.names)]
    found = SurfacePoints(ALL.names, ALL.faces[moved], ALL.barycentric[moved])
    monkeypatch.setattr("blendcap.modeling.landmark_pairs.find_landmarks", lambda _: found)
    pairs, notes = find_pairs(RIG.mesh, RIG)
    assert pairs is not None and len(pairs[1]) == kept
    np.testing.assert_allclose(pairs[0].positions(RIG.mesh), pairs[1])
    assert [all(name in note for name in wrong) for note in notes] == [True] * bool(wrong)
    assert [", with lines that end there" in note for note in notes] == [kept == 46] * bool(wrong)


def test_landmarks_that_were_found_all_over_are_not_used(monkeypatch):
    order = np.random.default_rng(3).permutation(len(ALL.names))
    found = SurfacePoints(ALL.names, ALL.faces[order], ALL.barycentric[order])
    monkeypatch.setattr("blendcap.modeling.landmark_pairs.find_landmarks", lambda _: found)
    pairs, notes = find_pairs(RIG.mesh, RIG)
    assert pairs is None and "contradict each other" in notes[0]


@pytest.mark.parametrize(("names", "wrong", "used"), [
    (SEVEN, {"nose_tip": "eye_outer_left", "lip_corner_left": "eye_outer_right"}, True),
    (FIVE, {"nose_tip": "eye_outer_left", "lip_corner_left": "eye_outer_right"}, False), (FIVE[:2], {}, False),
])  # fmt: skip
def test_those_that_were_found_are_used_if_most_agree(monkeypatch, names, wrong, used):
    rows = [ALL.names.index(wrong.get(name, name)) for name in names]
    found = SurfacePoints(names, ALL.faces[rows], ALL.barycentric[rows])
    monkeypatch.setattr("blendcap.modeling.landmark_pairs.find_landmarks", lambda _: found)
    pairs, notes = find_pairs(RIG.mesh, RIG)
    assert (pairs is not None) == used and len(notes) == 1
    assert pairs is None or set(pairs[0].names) == set(names) - set(wrong)


def test_of_three_landmarks_that_were_found_none_may_be_left_out(monkeypatch):
    few = ALL.select(list(FIVE[:3]))
    rows = [ALL.names.index(name) for name in (FIVE[0], FIVE[1], "lip_corner_right")]
    found = SurfacePoints(few.names, ALL.faces[rows], ALL.barycentric[rows])
    monkeypatch.setattr("blendcap.modeling.landmark_pairs.find_landmarks", lambda _: found)
    pairs, notes = find_pairs(RIG.mesh, RIG)
    assert pairs is None and "contradict each other" in notes[0]
