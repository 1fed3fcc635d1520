"""The same seed makes the same on every Python and every machine that the tests run on."""

import json

import numpy as np
import pytest

from fingerprints import EXPECTED, fingerprint, made

PICTURES = ("texture", "frame", "film", "photograph")  # levels of 0 to 255: one between two may go either way


@pytest.fixture(scope="module")
def arrays() -> dict[str, np.ndarray]:
    return made()


def test_a_seed_makes_what_it_made_elsewhere(arrays):
    expected = json.loads(EXPECTED.read_text(encoding="utf-8"))
    assert set(arrays) == set(expected)
    for name, values in arrays.items():
        found, wanted = fingerprint(values), expected[name]
        assert found[:2] == wanted[:2], name  # as many numbers, as many of them missing
        assert np.allclose(found[2:], wanted[2:], rtol=0, atol=1e-3 if name in PICTURES else 1e-6), name


def test_the_fingerprint_sees_one_vertex_that_moved_by_a_tenth_of_a_millimetre(arrays):
    vertices = arrays["vertices"].copy()
    vertices[len(vertices) // 2] += 0.1
    away = np.subtract(fingerprint(vertices), fingerprint(arrays["vertices"]))
    assert np.abs(away).max() > 5e-6
