"""Raw scans: units, orientation, size, and what is no head."""

import numpy as np
import pytest

import masks
from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.modeling.scan_repair import (
    UNITS,
    check_unit,
    clustered,
    ready_scan,
    resized,
    unit_by_face,
    unit_by_landmarks,
)
from blendcap.numerics.surfaces import face_normals

SCAN = masks.scan()


@pytest.mark.parametrize(
    ("unit", "word"), [(1, None), (10, "centimetres"), (25.4, "inches"), (100, "decimetres"), (1000, "metres")]
)
def test_the_unit_is_found_and_said(unit, word):
    ready = ready_scan(SCAN.with_vertices(SCAN.vertices * 1.4 / unit))
    np.testing.assert_allclose(ready.mesh.vertices, SCAN.vertices * 1.4, rtol=1e-12)
    assert ready.unit_mm == unit
    assert ready.notes == (() if word is None else (f"The scan is taken to be in {word}: only then is it as large as a "
                                                    "head.",))  # fmt: skip


def test_a_unit_that_is_given_is_taken():
    ready = ready_scan(SCAN, unit_mm=2.0)
    assert ready.unit_mm == 2.0 and not ready.notes
    np.testing.assert_allclose(ready.mesh.vertices, 2 * SCAN.vertices)


def test_the_size_of_the_face_tells_the_unit():
    for unit in UNITS.values():
        assert unit_by_face(1.1 / unit)[0] == unit  # a face a tenth larger than the template's
    assert unit_by_face(0.95) == (1.0, None)
    unit, said = unit_by_face(1 / 53)
    assert unit == pytest.approx(53) and "scaled by 53 to be as large as the template's" in str(said)


FITS, NOTHING = None, ""  # what is said of a unit: nothing at all, or that no other is better
TEMPLATE = Rig(SCAN, np.zeros((0, len(SCAN.vertices), 3)), ())


def assert_unit_is_held(better, why, *scan):
    """That a scan in its stated unit is refused for a better one, taken as it is, or taken with a word."""
    if better:
        with pytest.raises(InputError, match=rf"{why}, .* --unit {better}\."):
            check_unit(*scan, TEMPLATE)
    else:
        said = check_unit(*scan, TEMPLATE)
        assert said is None if better is FITS else "leave the unit out to have it scaled" in str(said)


@pytest.mark.parametrize(
    ("stated", "size", "better"),
    [
        ("mm", 0.55, FITS), ("cm", 0.75, FITS), ("mm", 1.9, FITS), ("mm", 2.4, NOTHING), ("mm", 0.3, NOTHING),
        ("m", 1000.0, "mm"), ("cm", 10.0, "mm"), ("mm", 0.1, "cm"), ("in", 2.54, "cm"), ("mm", 1 / 25.4, "in"),
    ],
)  # fmt: skip
def test_a_stated_unit_is_held_against_the_face(stated, size, better):
    """With landmarks: `size` is how many times as large as the template's face it is in that unit."""
    points = SurfacePoints.at_vertices(("a", "b", "c", "d"), [0, 200, 400, 600], SCAN)
    pairs = points, size * points.positions(SCAN)
    assert_unit_is_held(better, "its face is .* times as large as the template's", stated, SCAN, pairs)


@pytest.mark.parametrize(
    ("stated", "size", "better"),
    [
        ("mm", 65.0, FITS), ("cm", 1200.0, FITS), ("mm", 55.0, "cm"), ("mm", 5.0, "in"), ("dm", 1400.0, "cm"),
        ("m", 280_000.0, "mm"), ("mm", 0.001, NOTHING), ("m", 1e9, NOTHING),
    ],
)  # fmt: skip
def test_a_stated_unit_is_held_against_the_whole_scan(stated, size, better):
    """Without landmarks: `size` is the longest side in that unit, mm."""
    whole = SCAN.with_vertices(size / np.ptp(SCAN.vertices, axis=0).max() * SCAN.vertices)
    assert_unit_is_held(better, "its head is .* mm long", stated, whole, None)


@pytest.mark.parametrize(("size", "changed"), [(0.85, False), (1.2, False), (0.75, True), (1.3, True)])
def test_a_guessed_unit_that_gives_no_face_is_mended(size, changed):
    ready = ready_scan(SCAN, unit_mm=2.0)
    other = resized(ready, size)
    assert (other is not ready) == changed
    if changed:
        np.testing.assert_allclose(other.mesh.vertices, ready.mesh.vertices / size)
        assert other.unit_mm == pytest.approx(2 / size) and "so the unit was wrong" in other.notes[-1]


def test_two_landmarks_tell_no_unit():
    points = SurfacePoints.at_vertices(("a", "b", "c"), [0, 200, 400], SCAN)
    assert unit_by_landmarks((points.select(["a", "b"]), np.eye(3)[:2]), TEMPLATE) == (None, None)
    assert unit_by_landmarks(None, TEMPLATE) == (None, None)
    assert unit_by_landmarks((points, points.positions(SCAN) / 10), TEMPLATE)[0] == 10


def test_triangles_that_face_inwards_are_turned():
    ready = ready_scan(Mesh(SCAN.vertices, SCAN.faces[:, ::-1]))
    np.testing.assert_array_equal(np.sort(ready.mesh.faces, 1), np.sort(SCAN.faces, 1))
    agree = (face_normals(SCAN.vertices, SCAN.faces) * face_normals(ready.mesh.vertices, ready.mesh.faces)).sum(1)
    assert (agree > 0).all()
    assert "turned round" in ready.notes[0]


def test_degenerate_triangles_are_left_out():
    extra = np.array([[0, 0, 1], [5, 5, 5]])
    ready = ready_scan(Mesh(SCAN.vertices, np.concatenate([extra, SCAN.faces])))
    np.testing.assert_array_equal(ready.mesh.faces, SCAN.faces)
    assert ready.notes == ("2 degenerate triangles are left out.",)
    with pytest.raises(InputError, match="no triangle with an area"):
        ready_scan(Mesh(SCAN.vertices, extra))


def beside(mesh, shift):
    count = len(mesh.vertices)
    return Mesh(
        np.concatenate([mesh.vertices, mesh.vertices + shift]), np.concatenate([mesh.faces, mesh.faces + count])
    )


@pytest.mark.parametrize(
    ("scan", "words"),
    [
        (beside(SCAN, [250.0, 0, 0]), "two separate surfaces .* save each to a file of its own"),
        (SCAN.with_vertices(SCAN.vertices * [9, 9, 1.2]), "as a whole body is; cut it to the head and neck"),
        (SCAN.with_vertices(SCAN.vertices * 1e5), "no head in mm, cm, inches, dm or m"),
    ],
)
def test_what_is_no_head_is_refused(scan, words):
    with pytest.raises(InputError, match=words):
        ready_scan(scan)


def test_small_pieces_and_an_inner_shell_are_no_second_face():
    assert not ready_scan(beside(SCAN, [0.0, 0, -5])).notes


@pytest.mark.parametrize("most", [300, 1000])
def test_clustering_keeps_the_surface_and_its_turn(most):
    vertices, faces = clustered(SCAN.vertices, SCAN.faces, most)
    assert most / 3 < len(faces) <= most
    whole, joined = (face_normals(v, f) for v, f in ((SCAN.vertices, SCAN.faces), (vertices, faces)))
    assert np.linalg.norm(joined, axis=1).sum() == pytest.approx(np.linalg.norm(whole, axis=1).sum(), rel=0.25)
    np.testing.assert_allclose(joined.sum(0), whole.sum(0), rtol=0.35, atol=0.02 * np.abs(whole.sum(0)).max())
    assert len(np.unique(faces)) == len(vertices)


def test_a_scan_of_too_many_triangles_is_joined_and_said(monkeypatch):
    monkeypatch.setattr("blendcap.modeling.scan_repair.MOST", 1500)
    ready = ready_scan(SCAN)
    assert len(ready.mesh.faces) <= 1500
    assert f"{len(SCAN.faces):,} triangles are joined to {len(ready.mesh.faces):,}" in ready.notes[0]
