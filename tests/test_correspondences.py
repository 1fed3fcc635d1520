"""Correspondence tables: every kind of place, and one plain sentence for every mistake."""

import numpy as np
import pytest

from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.io import read_correspondences, write_correspondences
from blendcap.markers.correspondences import resolve


@pytest.fixture
def rig():
    vertices = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [5, 5, 9]])
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    named = SurfacePoints(("30", "tip"), [0, 1], [[0.2, 0.3, 0.5], [0, 0.5, 0.5]])
    return Rig(mesh, np.zeros((1, 5, 3)), ["jawOpen"], points={"landmarks68": named})


def test_every_kind_of_place(rig):
    table = {
        "Chin": 3,
        "Numpy": np.int32(1),
        "Nose": "landmarks68/30",
        "Brow": {"face": 1, "barycentric": [0.25, 0.25, 0.5]},
    }
    points = resolve(rig, table, labels=["Brow", "Chin", "Nose", "Numpy", "Unplaced"])
    assert points.names == tuple(table)
    expected = [[0, 10, 0], [10, 0, 0], [8, 5, 0], [2.5, 7.5, 0]]
    np.testing.assert_allclose(points.positions(rig.mesh), expected)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "empty"),
        ({"Jaw": 1}, "marker 'Jaw'.*does not have"),
        ({"Chin": 5}, "vertex 5, but the rig's are 0 to 4"),
        ({"Chin": -1}, "vertex -1"),
        ({"Chin": 4}, "no face"),
        ({"Chin": True}, "vertex number"),
        ({"Chin": 1.5}, "vertex number"),
        ({"Chin": None}, "vertex number"),
        ({"Chin": "lips/3"}, "no point set 'lips'.*landmarks68"),
        ({"Chin": "landmarks68/99"}, "no point '99'"),
        ({"Chin": "landmarks68"}, "no point ''"),
        ({"Chin": {"face": 2, "barycentric": [1, 0, 0]}}, "face from 0 to 1"),
        ({"Chin": {"barycentric": [1, 0, 0]}}, "face from 0 to 1"),
        ({"Chin": {"face": 0, "barycentric": [1, 0]}}, "three barycentric"),
        ({"Chin": {"face": 0, "barycentric": [1, 1, 0]}}, "three barycentric"),
        ({"Chin": {"face": 0, "barycentric": [2, -1, 0]}}, "three barycentric"),
        ({"Chin": {"face": 0, "barycentric": ["a", "b", "c"]}}, "three barycentric"),
        ({"Chin": {"face": 0, "barycentric": [np.nan, 0, 1]}}, "three barycentric"),
    ],
)
def test_each_mistake_has_its_sentence(rig, table, words):
    with pytest.raises(InputError, match=words):
        resolve(rig, table, labels=["Chin"])


def test_places_that_were_found_can_be_written_and_used_again(rig, tmp_path):
    found = SurfacePoints(("Lip Ö", "Chin"), [1, 0], [[0.125, 0.25, 0.625], [1, 0, 0]])
    write_correspondences(tmp_path / "places.json", found)
    again = resolve(rig, read_correspondences(tmp_path / "places.json"), labels=found.names)
    assert again.names == found.names
    np.testing.assert_array_equal(again.faces, found.faces)
    np.testing.assert_allclose(again.barycentric, found.barycentric, atol=1e-6)


def test_every_place_that_is_written_can_be_read(rig, tmp_path):
    weights = np.random.default_rng(0).dirichlet((1, 1, 1), 500)
    found = SurfacePoints([f"m{i}" for i in range(500)], np.zeros(500, int), weights)
    write_correspondences(tmp_path / "places.json", found)
    again = resolve(rig, read_correspondences(tmp_path / "places.json"))
    np.testing.assert_allclose(again.barycentric, weights, atol=2e-6)
    np.testing.assert_allclose(again.barycentric.sum(1), 1, atol=1e-12)


def test_places_rounded_by_hand_are_taken(rig):
    places = resolve(rig, {"Chin": {"face": 0, "barycentric": [0.3333, 0.3333, 0.3333]}})
    np.testing.assert_allclose(places.barycentric, 1 / 3)
