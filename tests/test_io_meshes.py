"""Meshes and rigs of OBJ files, scans, and the ICT-FaceKit."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from blendcap.data import InputError, Mesh, triangulate
from blendcap.io import describe, read_mesh, read_rig, write_mesh
from blendcap.io.ict import _PARTS, NEUTRAL, _regions, read_ict_pack
from test_io_gltf import small_rig

CUBE = """# a comment
mtllib none.mtl
v 0 0 0 1 0 0
v 100 0 0
v 100 100 0
v 0 100 0
v 0 0 100
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
g side
f 1/1/1 2/2/1 3/3/1 4/1/1
f -5//1 -4//1 -1//1
"""


def test_obj_keeps_order_polygons_and_reads_negative_indices(tmp_path):
    (tmp_path / "a.obj").write_text(CUBE)
    mesh = read_mesh(tmp_path / "a.obj")
    np.testing.assert_array_equal(mesh.polygons, [[0, 1, 2, 3], [0, 1, 4, -1]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 4]])
    np.testing.assert_array_equal(mesh.vertices[2], [100, 100, 0])
    assert mesh.uv is None  # the second face has none
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.obj", unit="cm").vertices[2], [1000, 1000, 0])


@pytest.mark.parametrize(
    ("end", "words"),
    [("v 0 0", "'v' number 5 has fewer than 3 numbers, and ends the file: the file was cut short; export it again"),
     ("vt 0 0", "holds no surface .* it was cut short"),
     ("f -5//1 -4", "face number 2 has fewer than 3 corners, and is the last: the file was cut short")],
)  # fmt: skip
def test_an_obj_that_was_cut_short_says_so(tmp_path, end, words):
    (tmp_path / "a.obj").write_text(CUBE[: CUBE.rindex(end) + len(end)])
    with pytest.raises(InputError, match=words):
        read_mesh(tmp_path / "a.obj")


def test_a_broken_line_within_an_obj_is_named(tmp_path):
    for line, words in (
        ("v 100 0 0", "'v' number 2 has fewer than 3 numbers."),
        ("f 1/1/1 2/2/1 3", "face number 1 .*; remove it"),
    ):
        (tmp_path / "a.obj").write_text(CUBE.replace(line, line[:3]))
        with pytest.raises(InputError, match=words):
            read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize("polygons", [True, False])
def test_obj_survives_a_round_trip(tmp_path, polygons):
    mesh = small_rig(polygons=polygons).mesh
    write_mesh(tmp_path / "a.obj", mesh)
    back = read_mesh(tmp_path / "a.obj")
    np.testing.assert_allclose(back.vertices, mesh.vertices, rtol=1e-8)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    np.testing.assert_array_equal(back.uv_faces, mesh.uv_faces)
    np.testing.assert_allclose(back.uv, mesh.uv, rtol=1e-8)
    if polygons:
        np.testing.assert_array_equal(back.polygons, mesh.polygons)


def test_polygons_of_any_size_survive(tmp_path):
    polygons = np.array([[0, 1, 2, 3, 4, 5], [5, 6, 0, -1, -1, -1], [6, 5, 4, 3, 2, -1]])
    mesh = Mesh(np.random.default_rng(0).normal(size=(7, 3)) * 100, triangulate(polygons), polygons)
    write_mesh(tmp_path / "a.obj", mesh)
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.obj").polygons, polygons)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "entry 9 of 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "count from 1"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -9 1 2\n", "entry 9 of 3"),
        ("v 0 0 0\nv 1 0 0\nf 1 2\n", "fewer than 3 corners"),
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "number 2 has fewer than 3 numbers"),
        ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN"),
        ("v 0 0 x\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "damaged"),
        ("v 0 0 0\n", "no surface"),
    ],
)
def test_bad_obj(tmp_path, text, message):
    (tmp_path / "bad.obj").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(tmp_path / "bad.obj")
    assert "bad.obj" in str(caught.value)


@pytest.mark.parametrize("ending", [".ply", ".stl"])
def test_scans_survive_a_round_trip(tmp_path, ending):
    mesh = small_rig().mesh
    write_mesh(tmp_path / f"a{ending}", mesh)
    back = read_mesh(tmp_path / f"a{ending}")
    assert len(back.vertices) == 16
    np.testing.assert_allclose(back.vertices[back.faces], mesh.vertices[mesh.faces], atol=1e-4)


def test_a_mesh_that_is_no_head_is_remarked_on(tmp_path, caplog):
    write_mesh(tmp_path / "a.obj", replace(small_rig().mesh, vertices=np.eye(16, 3)))
    with caplog.at_level(logging.WARNING):
        read_mesh(tmp_path / "a.obj")
    assert "another unit" in caplog.text


def folder_of(rig, path, neutral="neutral.obj"):
    path.mkdir()
    write_mesh(path / neutral, rig.mesh)
    for name, delta in zip(rig.names, rig.deltas, strict=True):
        write_mesh(path / f"{name}.obj", rig.mesh.with_vertices(rig.mesh.vertices + delta))


def test_a_folder_of_obj_is_a_rig(tmp_path):
    rig = small_rig()
    folder_of(rig, tmp_path / "rig")
    back = read_rig(tmp_path / "rig")
    order = [back.index(name) for name in rig.names]
    np.testing.assert_allclose(back.deltas[order], rig.deltas, atol=1e-4)
    np.testing.assert_array_equal(back.mesh.polygons, rig.mesh.polygons)
    assert back.names[back.mirror[back.index("eyeBlinkLeft")]] == "eyeBlinkRight"
    assert describe(tmp_path / "rig")["kind"] == "rig"


def test_shapes_of_another_topology_are_refused(tmp_path):
    rig = small_rig()
    folder_of(rig, tmp_path / "rig")
    flipped = Mesh(rig.mesh.vertices, rig.mesh.faces[:, ::-1])
    write_mesh(tmp_path / "rig" / "flipped.obj", flipped)
    with pytest.raises(InputError, match=r"flipped\.obj has other faces"):
        read_rig(tmp_path / "rig")
    (tmp_path / "rig" / "flipped.obj").write_text(CUBE)
    with pytest.raises(InputError, match=r"flipped\.obj has 5 vertices, but neutral\.obj has 16"):
        read_rig(tmp_path / "rig")


def test_a_folder_needs_one_neutral_and_a_shape(tmp_path):
    rig = small_rig()
    folder_of(rig, tmp_path / "rig", "first.obj")
    with pytest.raises(InputError, match=r"exactly one neutral\.obj"):
        read_rig(tmp_path / "rig")
    (tmp_path / "alone").mkdir()
    write_mesh(tmp_path / "alone" / "neutral.obj", rig.mesh)
    with pytest.raises(InputError, match="no shapes"):
        read_rig(tmp_path / "alone")


def test_the_original_ict_folder_is_in_centimetres_and_skips_identities(tmp_path):
    rig = small_rig()
    folder_of(rig, tmp_path / "FaceXModel", NEUTRAL)
    write_mesh(tmp_path / "FaceXModel" / "identity000.obj", rig.mesh)
    (tmp_path / "FaceXModel" / "vertex_indices.json").write_text('{"idx_to_landmark_verts": [3, 1, 2]}')
    back = read_rig(tmp_path / "FaceXModel")
    assert sorted(back.names) == sorted(rig.names)
    np.testing.assert_allclose(back.mesh.vertices, 10 * rig.mesh.vertices, rtol=1e-7)
    np.testing.assert_allclose(back.deltas[back.index("jawOpen")], 10 * rig.deltas[0], atol=1e-3)
    np.testing.assert_allclose(back.points["landmarks3"].positions(back.mesh), back.mesh.vertices[[3, 1, 2]])


def assert_regions_are_those_of_the_folder(pack):
    parts = _regions({name: np.arange(first, last + 1) for name, (first, last) in _PARTS.items()})
    assert set(parts) == set(pack.regions) - {"narrow_face"}
    for name, vertices in parts.items():
        np.testing.assert_array_equal(vertices, pack.regions[name])


def test_the_real_ict_pack(data):
    path = data("rigs/ict_facekit.npz")
    rig = read_rig(path)
    assert (len(rig.mesh.vertices), len(rig.names)) == (26719, 57)
    assert 200 < np.ptp(rig.mesh.vertices[:, 1]) < 400  # a head in mm
    marks = rig.points["landmarks68"].positions(rig.mesh)
    assert marks[36, 0] < 0 < marks[45, 0]  # landmark 36 is the outer corner of the right eye, and left is +x
    assert marks[30, 2] > marks[[36, 45, 48, 54], 2].max()  # the tip of the nose is in front
    assert marks[27, 1] > marks[33, 1] > marks[8, 1]
    left = rig.deltas[rig.index("eyeBlink_L")]
    assert rig.mesh.vertices[np.abs(left).max(1) > 1, 0].min() > 0
    assert rig.names[rig.mirror[rig.index("jawLeft")]] == "jawRight"
    assert set(rig.regions["eyes"]) == set(range(21451, 24591))
    assert_regions_are_those_of_the_folder(rig)
    person = read_ict_pack(path, np.array([1.0, -1.0]))
    assert 0.5 < np.abs(person.mesh.vertices - rig.mesh.vertices).max() < 100
    with pytest.raises(InputError, match="up to 100 coefficients"):
        read_ict_pack(path, np.zeros(101))


def test_the_real_scan(data):
    assert len(read_mesh(data("scans/LeePerrySmith/LeePerrySmith.obj"), unit="cm").vertices) == 9223
    with pytest.raises(InputError, match="Draco"):
        read_mesh(data("scans/LeePerrySmith/LeePerrySmith.glb"))


def textured(path):
    texture = np.random.default_rng(0).integers(0, 256, (8, 4, 3), dtype=np.uint8)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    mesh = Mesh(100 * np.eye(4, 3), triangulate(np.array([[0, 1, 2, 3]])), uv=uv, texture=texture)
    write_mesh(path, mesh)
    return mesh


def test_an_obj_keeps_its_texture(tmp_path):
    mesh = textured(tmp_path / "a.obj")
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.obj").texture, mesh.texture)
    (tmp_path / "maps").mkdir()
    (tmp_path / "a_color.png").rename(tmp_path / "maps" / "skin color.png")
    (tmp_path / "a.mtl").write_text("newmtl other\nmap_Kd b.png\nnewmtl skin\nKd 1 1 1\nmap_Kd maps\\skin color.png\n")
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.obj").texture, mesh.texture)


@pytest.mark.parametrize(
    ("material", "words"),
    [
        ("newmtl skin\nmap_Kd gone.png\n", "gone.png, which is not beside it"),
        ("newmtl skin\nmap_Kd ../outside.png\n", "outside.png, which is not beside it"),
        ("newmtl skin\nmap_Kd a.mtl\n", "a.mtl, which is not beside it or no picture"),
        (None, "materials a.mtl, which are not beside it"),
    ],
)
def test_a_texture_that_is_not_there_is_named(tmp_path, caplog, material, words):
    (tmp_path / "scan").mkdir()
    textured(tmp_path / "scan" / "a.obj")
    (tmp_path / "scan" / "a_color.png").rename(tmp_path / "outside.png")
    (tmp_path / "scan" / "a.mtl").unlink() if material is None else (tmp_path / "scan" / "a.mtl").write_text(material)
    with caplog.at_level(logging.WARNING):
        assert read_mesh(tmp_path / "scan" / "a.obj").texture is None
    assert words in caplog.text


def test_several_textures_are_refused_in_words(tmp_path, caplog):
    textured(tmp_path / "a.obj")
    text = (tmp_path / "a.obj").read_text().replace("usemtl skin", "usemtl skin\nusemtl hair")
    (tmp_path / "a.obj").write_text(text)
    (tmp_path / "a.mtl").write_text("newmtl skin\nmap_Kd a_color.png\nnewmtl hair\nmap_Kd hair.png\n")
    with caplog.at_level(logging.WARNING):
        assert read_mesh(tmp_path / "a.obj").texture is None
    assert "uses 2 textures" in caplog.text
