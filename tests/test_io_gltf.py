"""GLB: round trips, what a scene may look like, and Khronos' own validator."""

import base64
import json
import logging
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blendcap import mannequin
from blendcap.data import Animation, InputError, Mesh, Rig, SurfacePoints, triangulate
from blendcap.io import describe, read_animation, read_mesh, read_rig, write_animation, write_mesh, write_rig
from blendcap.io.gltf import open_document
from blendcap.rendering import tangents_of

CACHE = Path.home() / ".cache" / "blendcap-tests" / "gltf-validator"
VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
(async () => { for (const file of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
  console.log(JSON.stringify(report.issues));
} })()
"""


def small_rig(seed=0, *, polygons=True, seam=True) -> Rig:
    """A grid of quads with a uv seam, four shapes and every field that a rig has."""
    rng = np.random.default_rng(seed)
    quads = np.array([[r * 4 + c, r * 4 + c + 1, r * 4 + c + 5, r * 4 + c + 4] for r in range(3) for c in range(3)])
    mixed = np.vstack([quads[:-1], [[10, 11, 15, -1]]])
    vertices = rng.normal(size=(16, 3)) * 80
    uv = rng.random((18 if seam else 16, 2))
    uv_polygons = mixed.copy()
    if seam:
        uv_polygons[0, 1] = 16
        uv_polygons[4, 2] = 17
    mesh = Mesh(vertices, triangulate(mixed), mixed if polygons else None, uv, triangulate(uv_polygons))
    deltas = rng.normal(size=(4, 16, 3)).astype(np.float32) * (np.arange(16) < 5)[:, None]
    deltas[2] = rng.normal(size=(16, 3))  # dense
    deltas[3] = 0
    return Rig(
        mesh,
        deltas,
        ("jawOpen", "eyeBlinkLeft", "eyeBlinkRight", "still"),
        bounds=[[0, 1], [0, 1.5], [-1, 1], [0, 1]],
        mirror=[0, 2, 1, 3],
        combinations={"still": ("jawOpen",)},
        points={"two": SurfacePoints(("a", "b"), [0, 3], [[0.2, 0.3, 0.5], [1, 0, 0]])},
        regions={"lips": [1, 2, 3]},
        contacts={"lips": [[0, 1], [4, 7]]},
        name="small",
    )


def small_animation(rig: Rig, frames=7, rate=30.0) -> Animation:
    rng = np.random.default_rng(1)
    head = np.tile(np.eye(4), (frames, 1, 1))
    head[:, :3, :3] = Rotation.from_rotvec(rng.normal(size=(frames, 3)) * 3).as_matrix()
    head[:, :3, 3] = rng.normal(size=(frames, 3)) * 30
    return Animation(rng.random((frames, len(rig.names))), rig.names, rate, head)


def assert_same_rig(one: Rig, other: Rig, tolerance: float) -> None:
    assert one.names == other.names
    np.testing.assert_allclose(one.mesh.vertices, other.mesh.vertices, atol=tolerance)
    np.testing.assert_allclose(one.deltas, other.deltas, atol=max(tolerance, 1.01e-4 if tolerance else 0))
    np.testing.assert_array_equal(one.mesh.faces, other.mesh.faces)
    assert (one.mesh.polygons is None) == (other.mesh.polygons is None)
    if one.mesh.polygons is not None:
        np.testing.assert_array_equal(one.mesh.polygons, other.mesh.polygons)
    np.testing.assert_allclose(one.mesh.uv[one.mesh.uv_faces], other.mesh.uv[other.mesh.uv_faces], atol=1e-6)
    np.testing.assert_array_equal(one.bounds, other.bounds)
    np.testing.assert_array_equal(one.mirror, other.mirror)
    assert one.combinations == other.combinations
    assert one.name == other.name
    for key in one.points:
        np.testing.assert_allclose(
            one.points[key].positions(one.mesh), other.points[key].positions(other.mesh), atol=1e-4
        )
    for key in one.regions:
        np.testing.assert_array_equal(one.regions[key], other.regions[key])
    for key in one.contacts:
        np.testing.assert_array_equal(one.contacts[key], other.contacts[key])


@pytest.mark.parametrize("seam", [True, False])
@pytest.mark.parametrize("polygons", [True, False])
def test_rig_survives_a_round_trip(tmp_path, seam, polygons):
    rig = small_rig(seam=seam, polygons=polygons)
    write_rig(tmp_path / "rig.glb", rig)
    assert_same_rig(rig, read_rig(tmp_path / "rig.glb"), 1e-5)


def test_npz_rig_is_exact(tmp_path):
    rig = small_rig()
    write_rig(tmp_path / "rig.npz", rig)
    assert_same_rig(rig, read_rig(tmp_path / "rig.npz"), 0)


def test_texture_survives(tmp_path):
    rig = small_rig()
    mesh = replace(rig.mesh, texture=np.random.default_rng(0).integers(0, 255, (8, 5, 3), dtype=np.uint8))
    write_mesh(tmp_path / "mesh.glb", mesh)
    np.testing.assert_array_equal(read_mesh(tmp_path / "mesh.glb").texture, mesh.texture)


def test_normal_map_survives(tmp_path):
    rig, rng = small_rig(), np.random.default_rng(0)
    bumps, wrinkle = (rng.integers(0, 255, (8, 5, 3), dtype=np.uint8) for _ in range(2))
    mesh = replace(rig.mesh, normal_map=bumps)  # with no texture beside it
    write_mesh(tmp_path / "mesh.glb", mesh)
    back = read_mesh(tmp_path / "mesh.glb")
    np.testing.assert_array_equal(back.normal_map, bumps)
    assert back.texture is None
    rig = replace(rig, mesh=replace(mesh, texture=wrinkle), normal_maps={rig.names[1]: wrinkle})
    for name in ("rig.glb", "rig.npz"):
        write_rig(tmp_path / name, rig)
        back = read_rig(tmp_path / name)
        np.testing.assert_array_equal(back.mesh.normal_map, bumps)
        np.testing.assert_array_equal(back.mesh.texture, wrinkle)
    assert list(back.normal_maps) == [rig.names[1]]
    np.testing.assert_array_equal(back.normal_maps[rig.names[1]], wrinkle)


def test_tangents_are_those_of_the_renderer(tmp_path):
    rig = mannequin()
    mesh = replace(rig.mesh, normal_map=np.full((4, 4, 3), 128, dtype=np.uint8))
    write_mesh(tmp_path / "mesh.glb", mesh)
    document = open_document(tmp_path / "mesh.glb")
    primitive = document.json["meshes"][0]["primitives"][0]
    stored, normals = (document.accessor(primitive["attributes"][name]) for name in ("TANGENT", "NORMAL"))
    corners = document.accessor(primitive["indices"])[:, 0].astype(int).reshape(-1, 3)
    ours = tangents_of(mesh)
    along = ours.directions[ours.faces]
    along -= (along * normals[corners]).sum(2, keepdims=True) * normals[corners]
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-12)
    assert np.abs((stored[corners, :3] * normals[corners]).sum(2)).max() < 1e-5
    assert np.mean((along * stored[corners, :3]).sum(2) > 0.98) > 0.99
    assert np.mean(stored[corners, 3] == ours.signs[:, None]) > 0.99  # but where the chart folds


def test_a_scaled_normal_texture_is_read_as_it_is_meant(tmp_path):
    bumps = np.full((4, 4, 3), (128 + 70, 128 - 40, 128 + 97), dtype=np.uint8)
    write_mesh(tmp_path / "mesh.glb", replace(small_rig().mesh, normal_map=bumps))
    binary, gltf = chunks(tmp_path / "mesh.glb")
    gltf["materials"][0]["normalTexture"]["scale"] = 0.5
    write_gltf(tmp_path / "half.gltf", gltf, binary)
    x, y, z = np.moveaxis(read_mesh(tmp_path / "half.gltf").normal_map.astype(float) - 128, 2, 0)
    assert (x / z)[0, 0] == pytest.approx(0.5 * 70 / 97, abs=0.02)
    assert (y / z)[0, 0] == pytest.approx(-0.5 * 40 / 97, abs=0.02)


def test_animation_with_head_motion_survives(tmp_path):
    rig = small_rig()
    animation = small_animation(rig)
    write_animation(tmp_path / "take.glb", animation, rig)
    back = read_animation(tmp_path / "take.glb")
    assert back.names == animation.names
    assert back.rate == animation.rate
    np.testing.assert_allclose(back.weights, animation.weights, atol=1e-6)
    np.testing.assert_allclose(back.head, animation.head, atol=2e-5)
    np.testing.assert_allclose(back.times, animation.times, atol=1e-6)
    # the rig in the same file stands where it stood, whatever the head does
    np.testing.assert_allclose(read_rig(tmp_path / "take.glb").mesh.vertices, rig.mesh.vertices, atol=1e-5)


def test_quaternions_of_a_long_turn_never_jump(tmp_path):
    rig = small_rig()
    head = np.tile(np.eye(4), (40, 1, 1))
    head[:, :3, :3] = Rotation.from_rotvec(np.arange(40)[:, None] * [0, 0.4, 0]).as_matrix()  # more than two full turns
    write_rig(tmp_path / "a.glb", rig, Animation(np.zeros((40, 4)), rig.names, 30.0, head))
    binary, gltf = chunks(tmp_path / "a.glb")
    accessor = gltf["accessors"][gltf["animations"][0]["samplers"][2]["output"]]
    start = gltf["bufferViews"][accessor["bufferView"]]["byteOffset"]
    quaternions = np.frombuffer(binary, "<f4", 160, start).reshape(40, 4)
    assert (np.einsum("tk,tk->t", quaternions[1:], quaternions[:-1]) > 0).all()


def test_a_head_pose_that_is_unknown_is_held(tmp_path):
    rig, first = small_rig(), small_animation(small_rig())
    head = first.head.copy()
    head[[0, 3, 4]] = np.nan
    write_rig(tmp_path / "a.glb", rig, Animation(first.weights, first.names, 30.0, head))
    back = read_animation(tmp_path / "a.glb")
    np.testing.assert_allclose(back.head, first.head[[1, 1, 2, 2, 2, 5, 6]], atol=2e-5)


def test_unknown_weights_are_bridged_with_a_warning(tmp_path, caplog):
    rig = small_rig()
    weights = np.tile([0.0, 0.2, 0.4, np.nan], (5, 1)) * np.arange(5)[:, None]
    weights[2, 1] = np.nan
    with caplog.at_level(logging.WARNING):
        write_rig(tmp_path / "a.glb", rig, Animation(weights, rig.names, 30.0))
    assert "bridged" in caplog.text
    back = read_animation(tmp_path / "a.glb")
    np.testing.assert_allclose(back.weights[:, 1], 0.2 * np.arange(5), atol=1e-6)
    np.testing.assert_array_equal(back.weights[:, 3], 0)


def test_shapes_that_the_rig_lacks_are_refused(tmp_path):
    rig = small_rig()
    with pytest.raises(InputError, match="noSuchShape"):
        write_rig(tmp_path / "a.glb", rig, Animation([[1.0]], ("noSuchShape",), 30.0))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="give the rig"):
        write_animation(tmp_path / "a.glb", small_animation(rig))


def chunks(path: Path) -> tuple[bytes, dict]:
    content = path.read_bytes()
    (size,) = struct.unpack_from("<I", content, 12)
    return content[28 + size :], json.loads(content[20 : 20 + size])


def write_gltf(path: Path, gltf: dict, binary: bytes) -> None:
    gltf = gltf | {"buffers": [{"byteLength": len(binary), "uri": "data:;base64," + base64.b64encode(binary).decode()}]}
    path.write_text(json.dumps(gltf))


def two_meshes() -> tuple[dict, bytes]:
    """Two triangles as two meshes under a turned, scaled node; both have `smile`, one has `frown` too."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    smile = np.array([[0, 0, 1], [0, 0, 0], [0, 0, 0]], "<f4")
    frown = np.array([[0, 0, 0], [0, 2, 0], [0, 0, 0]], "<f4")
    binary = positions.tobytes() + smile.tobytes() + frown.tobytes() + np.array([0, 1, 2, 0], "<u2").tobytes()
    views = [{"buffer": 0, "byteOffset": 36 * i, "byteLength": 36} for i in range(3)]
    views.append({"buffer": 0, "byteOffset": 108, "byteLength": 6})
    vec3 = {"componentType": 5126, "count": 3, "type": "VEC3"}
    accessors = [vec3 | {"bufferView": i} for i in range(3)]
    accessors.append({"bufferView": 3, "componentType": 5123, "count": 3, "type": "SCALAR"})
    smiling = {"attributes": {"POSITION": 0}, "indices": 3, "targets": [{"POSITION": 1}]}
    both = {"attributes": {"POSITION": 0}, "targets": [{"POSITION": 2}, {"POSITION": 1}]}
    half = np.sqrt(0.5)
    gltf = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"children": [1, 2], "rotation": [0, 0, half, half], "scale": [2, 2, 2]},
            {"mesh": 0},
            {"mesh": 1, "translation": [1, 0, 0]},
        ],
        "meshes": [
            {"primitives": [smiling], "extras": {"targetNames": ["smile"]}},
            {"primitives": [both], "extras": {"targetNames": ["frown", "smile"]}},
        ],
        "accessors": accessors,
        "bufferViews": views,
    }
    return gltf, binary


def test_meshes_are_placed_and_their_targets_joined_by_name(tmp_path):
    write_gltf(tmp_path / "two.gltf", *two_meshes())
    rig = read_rig(tmp_path / "two.gltf")
    # a quarter turn about z and a doubling: x -> 2y, y -> -2x; metres become millimetres
    np.testing.assert_allclose(rig.mesh.vertices[:3], [[0, 0, 0], [0, 2000, 0], [-2000, 0, 0]], atol=1e-3)
    np.testing.assert_allclose(rig.mesh.vertices[3], [0, 2000, 0], atol=1e-3)
    assert rig.names == ("smile", "frown")
    np.testing.assert_allclose(rig.deltas[0][[0, 3]], [[0, 0, 2000]] * 2, atol=1e-3)
    np.testing.assert_allclose(rig.deltas[1][4], [-4000, 0, 0], atol=1e-3)
    assert np.count_nonzero(np.abs(rig.deltas[1]).max(1) > 1e-3) == 1
    np.testing.assert_array_equal(rig.mesh.faces, [[0, 1, 2], [3, 4, 5]])


def test_the_node_of_a_skinned_mesh_moves_nothing(tmp_path):
    gltf, binary = two_meshes()
    gltf["nodes"][1]["skin"] = 0
    write_gltf(tmp_path / "skin.gltf", gltf, binary)
    rig = read_rig(tmp_path / "skin.gltf")
    np.testing.assert_allclose(rig.mesh.vertices[:3], [[0, 0, 0], [1000, 0, 0], [0, 1000, 0]], atol=1e-3)
    np.testing.assert_allclose(rig.mesh.vertices[3], [0, 2000, 0], atol=1e-3)


def test_buffers_beside_the_file_and_primitives_that_share_vertices(tmp_path):
    gltf, binary = two_meshes()
    first = gltf["meshes"][0]["primitives"]
    first.append(dict(first[0]))
    (tmp_path / "my data.bin").write_bytes(binary)
    gltf["buffers"] = [{"byteLength": len(binary), "uri": "my%20data.bin"}]
    (tmp_path / "two.gltf").write_text(json.dumps(gltf))
    rig = read_rig(tmp_path / "two.gltf")
    assert len(rig.mesh.vertices) == 6
    assert len(rig.mesh.faces) == 3


@pytest.mark.parametrize(("mode", "faces"), [(5, [[0, 1, 2], [1, 3, 2]]), (6, [[0, 1, 2], [0, 2, 3]])])
def test_strips_and_fans_become_triangles(tmp_path, mode, faces):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "<f4")
    gltf = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}],
    }
    write_gltf(tmp_path / "strip.gltf", gltf, positions.tobytes())
    np.testing.assert_array_equal(read_mesh(tmp_path / "strip.gltf").faces, faces)


@pytest.mark.parametrize(
    ("extension", "word"),
    [
        ("KHR_draco_mesh_compression", "Draco"),
        ("EXT_meshopt_compression", "meshopt"),
        ("KHR_mesh_quantization", "quantised"),
    ],
)
def test_compression_is_refused_by_name(tmp_path, extension, word):
    gltf, binary = two_meshes()
    write_gltf(tmp_path / "a.gltf", gltf | {"extensionsRequired": [extension]}, binary)
    with pytest.raises(InputError, match=f"{word}.*{extension}.*export without"):
        read_rig(tmp_path / "a.gltf")


def test_notes_for_other_vertices_are_left_out(tmp_path, caplog):
    write_rig(tmp_path / "rig.glb", small_rig(seam=False))
    binary, gltf = chunks(tmp_path / "rig.glb")
    notes = json.loads(gltf["meshes"][0]["extras"]["blendcap"])
    gltf["meshes"][0]["extras"]["blendcap"] = json.dumps(notes | {"vertices": 99})
    write_gltf(tmp_path / "edited.gltf", gltf, binary)
    rig = read_rig(tmp_path / "edited.gltf")
    assert rig.points == {}
    assert "99 vertices" in caplog.text
    np.testing.assert_array_equal(rig.mirror, [0, 2, 1, 3])  # from the names, then


def test_describe_tells_rig_from_mesh(tmp_path):
    rig = small_rig()
    write_rig(tmp_path / "rig.glb", rig)
    write_mesh(tmp_path / "mesh.glb", rig.mesh)
    facts = describe(tmp_path / "rig.glb")
    assert facts["kind"] == "rig"
    assert (facts["vertices"], facts["faces"], facts["unit"]) == (16, 17, "mm")
    assert facts["shapes"] == list(rig.names)
    assert describe(tmp_path / "mesh.glb")["kind"] == "mesh"
    with pytest.raises(InputError, match="no morph targets"):
        read_rig(tmp_path / "mesh.glb")


def test_the_real_head(data):
    path = data("rigs/ict_face_head.glb")
    rig = read_rig(path)
    assert (len(rig.mesh.vertices), len(rig.names)) == (11657, 57)
    pack, kept = (
        read_rig(data("rigs/ict_facekit.npz")),
        np.load(data("rigs/ict_face_head_vertexmap.npz"))["gltf_to_ict"],
    )
    np.testing.assert_allclose(rig.mesh.vertices, pack.mesh.vertices[kept], atol=1e-3)
    jaw, other = rig.index("jawOpen"), pack.index("jawOpen")
    np.testing.assert_allclose(rig.deltas[jaw], pack.deltas[other][kept], atol=1e-3)
    assert rig.names[rig.mirror[rig.index("eyeBlinkLeft")]] == "eyeBlinkRight"


@pytest.fixture(scope="module")
def validator():
    """Khronos' validator, installed once through npm into a cache of its own."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("needs node and npm for Khronos' glTF validator")
    if not (CACHE / "node_modules" / "gltf-validator").exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        command = [
            "npm",
            "install",
            "--silent",
            "--no-audit",
            "--no-fund",
            "--prefix",
            str(CACHE),
            "gltf-validator@2.0.0-dev.3.10",
        ]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=120)
        except (subprocess.SubprocessError, OSError) as error:
            pytest.skip(f"npm could not install gltf-validator: {error}")

    def validate(path: Path) -> dict:
        script = CACHE / "validate.js"
        script.write_text(VALIDATE)
        done = subprocess.run(["node", str(script), str(path)], check=True, capture_output=True, text=True, timeout=120)
        return json.loads(done.stdout)

    return validate


def test_khronos_validator_finds_no_error(validator, tmp_path):
    rig = small_rig()
    picture = np.full((4, 4, 3), 128, np.uint8)
    textured = replace(rig, mesh=replace(rig.mesh, texture=picture, normal_map=picture))
    write_rig(tmp_path / "rig.glb", textured, small_animation(rig))
    issues = validator(tmp_path / "rig.glb")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
    binary, gltf = chunks(tmp_path / "rig.glb")
    gltf["accessors"][0]["max"][0] += 1  # and it would have found one
    write_gltf(tmp_path / "wrong.gltf", gltf, binary)
    assert validator(tmp_path / "wrong.gltf")["numErrors"] > 0


def test_khronos_validator_accepts_the_real_head(validator, data, tmp_path):
    rig = read_rig(data("rigs/ict_face_head.glb"))
    write_rig(tmp_path / "head.glb", rig, small_animation(rig))
    issues = validator(tmp_path / "head.glb")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
