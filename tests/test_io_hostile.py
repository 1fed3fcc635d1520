"""Files that are damaged or mean harm: one plain sentence, never another error, never half an output."""

import contextlib
import json
import os
import random
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from blendcap.data import Animation, InputError, MarkerTake
from blendcap.io import (
    describe,
    read_animation,
    read_correspondences,
    read_markers,
    read_mesh,
    read_points,
    read_rig,
    write_animation,
    write_markers,
    write_mesh,
    write_rig,
    write_whole,
)
from test_io_gltf import chunks, small_animation, small_rig, two_meshes, write_gltf

GLB_READERS = (read_rig, read_mesh, read_animation, describe)


def refuses(reader, path) -> bool:
    """True if the reader refused with one sentence that names the file; any other error is the test's failure."""
    try:
        reader(path)
    except InputError as error:
        assert path.name in str(error)
        assert "\n" not in str(error)
        return True
    return False


@pytest.fixture
def glb(tmp_path):
    path = tmp_path / "rig.glb"
    write_rig(path, small_rig(), small_animation(small_rig()))
    return path


def test_a_glb_cut_anywhere_is_refused(glb, tmp_path):
    content = glb.read_bytes()
    cut = tmp_path / "cut.glb"
    for end in range(0, len(content), 37):
        cut.write_bytes(content[:end])
        assert all(refuses(reader, cut) for reader in GLB_READERS), end


def test_a_glb_with_anything_in_its_json_raises_nothing_else(glb, tmp_path):
    binary, gltf = chunks(glb)
    values = [
        None,
        -1,
        0,
        1,
        1e300,
        10**30,
        "x",
        "",
        [],
        {},
        [None],
        True,
        3.7,
        "../x",
        5126,
        "VEC3",
        [[1]],
        float("nan"),
    ]
    rng, text, path = random.Random(0), json.dumps(gltf), tmp_path / "fuzzed.glb"
    places = [place for place in every_place(gltf) if place]
    refused = 0
    for _ in range(250):
        fuzzed = json.loads(text)
        for place in rng.sample(places, rng.choice([1, 1, 3])):
            with contextlib.suppress(KeyError, IndexError, TypeError):  # a place inside what was just replaced
                parent = fuzzed
                for key in place[:-1]:
                    parent = parent[key]
                parent[place[-1]] = rng.choice(values)
        body = json.dumps(fuzzed).encode()
        body += b" " * (-len(body) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(body) + len(binary)) + struct.pack("<I4s", len(body), b"JSON")
        path.write_bytes(head + body + struct.pack("<I4s", len(binary), b"BIN\0") + binary)
        refused += sum(refuses(reader, path) for reader in GLB_READERS)
    assert refused > 300


def every_place(value, place=()):
    yield place
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from every_place(inner, (*place, key))


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("accessors", 0, "count"), 10**12),
        (("accessors", 1, "count"), 10**12),
        (("bufferViews", 0, "byteLength"), 10**12),
        (("bufferViews", 0, "byteOffset"), 2**40),
        (("bufferViews", 0, "byteStride"), 2**40),
        (("buffers", 0, "byteLength"), 10**13),
        (("accessors", 1, "sparse"), {"count": 10**12, "indices": {"bufferView": 3, "componentType": 5123},
                                      "values": {"bufferView": 1}}),
    ],
)  # fmt: skip
def test_terabytes_are_refused_before_memory_is_asked_for(tmp_path, place, value):
    gltf, binary = two_meshes()
    path = tmp_path / "huge.gltf"
    write_gltf(path, gltf, binary)
    gltf = json.loads(path.read_text())
    parent = gltf
    for key in place[:-1]:
        parent = parent[key]
    parent[place[-1]] = value
    path.write_text(json.dumps(gltf))
    tracemalloc.start()
    assert refuses(read_rig, path)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_an_accessor_without_data_cannot_ask_for_memory(tmp_path):
    gltf, binary = two_meshes()
    gltf["accessors"][0] = {"componentType": 5126, "count": 10**12, "type": "VEC3"}
    write_gltf(tmp_path / "void.gltf", gltf, binary)
    assert refuses(read_mesh, tmp_path / "void.gltf")


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin", "a/../../secret.bin", "%2e%2e/secret.bin", "/etc/passwd", "file:///etc/passwd",
        "http://example.org/x.bin", "https://example.org/x.bin", "\\\\host\\x", "C:\\x.bin", "link.bin", "..", ".",
        "missing.bin", "data:text/plain,abc", "data:;base64,***",
    ],
)  # fmt: skip
def test_a_buffer_outside_the_folder_is_refused(tmp_path, uri):
    gltf, binary = two_meshes()
    (tmp_path / "secret.bin").write_bytes(binary)
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.bin").symlink_to(tmp_path / "secret.bin")
    gltf["buffers"] = [{"byteLength": len(binary), "uri": uri}]
    (inside / "rig.gltf").write_text(json.dumps(gltf))
    with pytest.raises(InputError):
        read_rig(inside / "rig.gltf")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_positions_that_are_not_numbers_are_refused(tmp_path, bad):
    gltf, binary = two_meshes()
    write_gltf(tmp_path / "nan.gltf", gltf, np.float32(bad).tobytes() + binary[4:])
    assert refuses(read_mesh, tmp_path / "nan.gltf")


@pytest.mark.parametrize(
    "nodes", [[{"children": [0]}], [{"children": [1]}, {"children": [0], "mesh": 0}], [{"mesh": 0, "children": [7]}]]
)
def test_nodes_in_a_circle_are_refused(tmp_path, nodes):
    gltf, binary = two_meshes()
    write_gltf(tmp_path / "circle.gltf", gltf | {"nodes": nodes, "scenes": [{"nodes": [0]}]}, binary)
    assert refuses(read_rig, tmp_path / "circle.gltf")


ALL_READERS = {
    ".glb": read_rig, ".gltf": read_rig, ".obj": read_mesh, ".ply": read_mesh, ".stl": read_mesh, ".npz": read_rig,
    ".c3d": read_markers, ".trc": read_markers, ".csv": read_animation, ".json": read_correspondences,
}  # fmt: skip


@pytest.mark.parametrize("ending", ALL_READERS)
def test_empty_garbage_missing_and_folder(tmp_path, ending):
    path, reader = tmp_path / f"file{ending}", ALL_READERS[ending]
    assert refuses(reader, path)
    path.write_bytes(b"")
    assert refuses(reader, path)
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    assert refuses(reader, path)
    path.write_text("hello, world\n" * 50)
    assert refuses(reader, path)
    folder = tmp_path / f"folder{ending}"
    folder.mkdir()
    assert refuses(reader, folder)


def test_unknown_endings_name_the_known_ones(tmp_path):
    path = tmp_path / "rig.fbx"
    path.write_bytes(b"x")
    with pytest.raises(InputError, match=r"\.glb, \.gltf, \.npz or a folder of OBJ"):
        read_rig(path)
    with pytest.raises(InputError, match=r"\.csv, \.npz, \.glb"):
        write_animation(path, Animation([[1.0]], ("a",), 30.0))
    with pytest.raises(InputError, match=r"\.c3d, \.trc, \.csv"):
        describe(path)


def test_archives_never_load_pickles_nor_trust_sizes(tmp_path):
    np.savez(tmp_path / "pickle.npz", meta=np.array({"kind": "rig"}, dtype=object))
    with pytest.raises(InputError, match="never loaded"):
        read_rig(tmp_path / "pickle.npz")
    header = np.lib.format.magic(1, 0)
    text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    text += b" " * (64 - (len(header) + 3 + len(text)) % 64) + b"\n"
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as archive:
        archive.writestr("weights.npy", header + struct.pack("<H", len(text)) + text)
    with pytest.raises(InputError, match="save it again"):
        read_animation(tmp_path / "huge.npz")


def test_a_damaged_archive_is_refused(tmp_path):
    write_rig(tmp_path / "rig.npz", small_rig())
    refused = 0
    content, rng = (tmp_path / "rig.npz").read_bytes(), random.Random(0)
    for _ in range(120):
        damaged = bytearray(content)
        for _ in range(5):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        (tmp_path / "damaged.npz").write_bytes(damaged[: rng.choice([len(damaged), rng.randrange(len(damaged))])])
        refused += refuses(read_rig, tmp_path / "damaged.npz")
    assert refused > 100  # a byte of the zip directory that nobody reads may be anything


def test_a_damaged_c3d_is_refused_or_read(tmp_path):
    rng, take = random.Random(0), MarkerTake(np.ones((5, 2, 3)), ("a", "b"), 60.0)
    write_markers(tmp_path / "take.c3d", take)
    content = (tmp_path / "take.c3d").read_bytes()
    refused = 0
    for k in range(400):
        damaged = bytearray(content)
        for _ in range(rng.choice([1, 3])):
            damaged[rng.randrange(len(damaged))] = rng.choice([0, 1, 127, 128, 255])
        (tmp_path / "damaged.c3d").write_bytes(damaged[: rng.randrange(len(damaged))] if k % 4 == 0 else damaged)
        refused += refuses(read_markers, tmp_path / "damaged.c3d")
    assert refused > 50


def outputs():
    rig, take = small_rig(), MarkerTake(np.ones((2, 1, 3)), ("a",), 60.0)
    animation = Animation(np.ones((2, 1)), ("jawOpen",), 30.0)
    return {
        "rig.glb": lambda path: write_rig(path, rig),
        "rig.npz": lambda path: write_rig(path, rig),
        "mesh.obj": lambda path: write_mesh(path, rig.mesh),
        "mesh.ply": lambda path: write_mesh(path, rig.mesh),
        "take.c3d": lambda path: write_markers(path, take),
        "take.trc": lambda path: write_markers(path, take),
        "take.csv": lambda path: write_markers(path, take),
        "a.csv": lambda path: write_animation(path, animation),
        "a.livelink.csv": lambda path: write_animation(path, animation),
        "a.npz": lambda path: write_animation(path, animation),
    }


@pytest.mark.parametrize("name", outputs())
def test_an_output_that_cannot_be_written_leaves_nothing(tmp_path, name):
    write = outputs()[name]
    with pytest.raises(InputError, match="does not exist"):
        write(tmp_path / "nowhere" / name)
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write(tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == [name]


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_rights(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="rights"):
        write_rig(tmp_path / "rig.glb", small_rig())


def test_what_fails_half_way_leaves_the_old_file(tmp_path):
    path = tmp_path / "take.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), write_whole(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    with pytest.raises(InputError, match="No space left"), write_whole(path) as temporary:
        temporary.write_text("half")
        raise OSError(28, "No space left on device")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["take.txt"]


def test_points_and_correspondences_are_checked(tmp_path):
    path = tmp_path / "points.json"
    for bad in ("[]", "{}", '{"points": []}', '{"points": [{"name": "a"}]}', '{"points": 3}', "[" * 100_000):
        path.write_text(bad)
        assert refuses(read_points, path)
    point = '{"face": 1, "barycentric": %s}'
    for bad in ("-1", "1.5", "true", "null", '""', '{"face": 1}', point % "[1, 1, 1]", point % '["x", 1, 0]'):
        path.write_text(f'{{"a": {bad}}}')
        with pytest.raises(InputError, match="'a'"):
            read_correspondences(path)
