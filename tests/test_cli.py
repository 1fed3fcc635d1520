"""The command line: what it answers, and the one sentence with which it refuses."""

import json
import logging
import os
import re
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest

import blendcap
from blendcap import Animation, MarkerTake, Mesh, Rig
from blendcap.cli import main
from blendcap.cli.demo import program
from blendcap.data import Camera, landmarks68
from blendcap.io.cameras import write_cameras

RATE, FRAMES = 60.0, 40
NAMES = ("bumpLeft", "bumpRight", "lift")


@pytest.fixture(scope="module")
def rig() -> Rig:
    """A hilly sheet of 15 by 15 vertices with three shapes: small, but all that a take needs."""
    x, y = np.meshgrid(np.linspace(-70, 70, 15), np.linspace(-90, 90, 15))
    vertices = np.stack([x, y, 60 - x**2 / 100 - y**2 / 200 + x * y / 300], 2).reshape(-1, 3)
    corner = (np.arange(14)[:, None] * 15 + np.arange(14)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 16], 1), np.stack([corner, corner + 16, corner + 15], 1)]
    )
    deltas = np.zeros((3, len(vertices), 3), np.float32)
    for delta, (center, push) in zip(deltas, [(35, (0, 3, 9)), (-35, (0, 3, 9)), (0, (0, 8, 0))], strict=True):
        delta[:] = np.exp(-((vertices[:, :1] - center) ** 2 + vertices[:, 1:2] ** 2) / 900) * push
    return Rig(Mesh(vertices, faces), deltas, NAMES, name="sheet")


@pytest.fixture(scope="module")
def truth() -> Animation:
    time = np.arange(FRAMES) / RATE
    weights = np.stack([np.sin(np.pi * np.clip(f * (time - 0.2), 0, 1)) ** 2 for f in (2, 3, 4)], 1)
    return Animation(weights, NAMES, RATE)


@pytest.fixture
def folder(tmp_path, rig, truth, monkeypatch) -> Path:
    """A folder with a rig, a take, an animation and a correspondence file that fit each other; the working folder."""
    vertices = np.arange(0, 225, 9)
    labels = [f"m{v}" for v in vertices]
    take = MarkerTake(rig.pose(truth.weights)[:, vertices], labels, RATE)
    blendcap.write_rig(tmp_path / "rig.glb", rig)
    blendcap.write_markers(tmp_path / "take.c3d", take)
    blendcap.write_animation(tmp_path / "truth.csv", truth)
    places = {label: int(v) for label, v in zip(labels, vertices, strict=True)}
    (tmp_path / "places.json").write_text(json.dumps(places), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


SOLVE = ("solve", "take.c3d", "--rig", "rig.glb", "--correspondences", "places.json", "-o", "out.csv")


def changed(arguments: tuple[str, ...], **changes: str) -> list[str]:
    """The arguments with some of them replaced: changed(SOLVE, take="x.c3d")."""
    names = {"take": "take.c3d", "rig": "rig.glb", "places": "places.json", "out": "out.csv"}
    return [next((changes[n] for n, a in names.items() if a == argument and n in changes), argument)
            for argument in arguments]  # fmt: skip


# Refusals. Each case spoils one thing in the folder and returns the arguments; the sentence is what the user reads.


def missing_file(folder, rig, truth):
    return changed(SOLVE, take="nowhere.c3d"), "Cannot read nowhere.c3d: there is no such file; check the path."


def missing_rig(folder, rig, truth):
    return changed(SOLVE, rig="nowhere.glb"), "Cannot read nowhere.glb: there is no such file; check the path."


def truncated_glb(folder, rig, truth):
    content = (folder / "rig.glb").read_bytes()
    (folder / "cut.glb").write_bytes(content[: len(content) // 2])
    return ["info", "cut.glb"], "Cannot read cut.glb: The GLB is cut short: it declares 17880 bytes and has 8940."


def obj_with_other_topology(folder, rig, truth):
    shapes = folder / "shapes"
    shapes.mkdir()
    blendcap.write_mesh(shapes / "neutral.obj", rig.mesh)
    blendcap.write_mesh(shapes / "bump.obj", Mesh(rig.mesh.vertices[:-1], rig.mesh.faces[:100]))
    sentence = (
        "shapes/bump.obj has 224 vertices, but neutral.obj has 225; every shape needs the topology of the neutral."
    )
    return ["rig", "convert", "shapes", "new.glb"], sentence


def c3d_that_is_none(folder, rig, truth):
    content = bytearray((folder / "take.c3d").read_bytes())
    content[512:1024] = bytes(512)
    (folder / "bad.c3d").write_bytes(content)
    sentence = "Cannot read bad.c3d: it is a C3D of an unknown machine; export it again as Intel C3D."
    return changed(SOLVE, take="bad.c3d"), sentence


def empty_take(folder, rig, truth):
    (folder / "empty.csv").write_text("# rate: 60\n# unit: mm\nframe,time,a_x,a_y,a_z\n", encoding="utf-8")
    return changed(SOLVE, take="empty.csv"), "Cannot read empty.csv: it has a header, but no rows."


def all_missing_marker(folder, rig, truth):
    take = blendcap.read_markers(folder / "take.c3d")
    positions = take.positions.copy()
    positions[:, 4] = np.nan
    blendcap.write_markers(folder / "gone.c3d", replace(take, positions=positions))
    sentence = "The marker 'm36' is missing in every frame; take it out of the correspondences or repair the take."
    return changed(SOLVE, take="gone.c3d"), sentence


def nan_frame(folder, rig, truth):
    weights = truth.weights.copy()
    weights[7] = np.nan
    blendcap.write_animation(folder / "gap.csv", replace(truth, weights=weights))
    sentence = "The answer has no weight for 'bumpLeft' in frame 7; fill or cut the gap."
    return ["evaluate", "gap.csv", "truth.csv", "--rig", "rig.glb"], sentence


def unknown_label(folder, rig, truth):
    (folder / "odd.json").write_text('{"m0": 0, "m9": 9, "m18": 18, "noseTip": 4}', encoding="utf-8")
    sentence = (
        "The correspondences name the marker 'noseTip', which the take does not have; it has m0, m9, m18, m27, "
        "m36, m45, m54, m63 ..."
    )
    return changed(SOLVE, places="odd.json"), sentence


def unknown_place(folder, rig, truth):
    (folder / "odd.json").write_text('{"m0": 0, "m9": 9, "m18": "landmarks68/30"}', encoding="utf-8")
    sentence = (
        "The rig 'sheet' has no points 'landmarks68'; write the vertex numbers of the 68 landmarks into "
        'landmarks68.json, {"0": 1234, "1": 1250, ..., "67": 4321}, and give them to it: '
        "blendcap rig convert RIG OUT.glb --points landmarks68.json."
    )
    return changed(SOLVE, places="odd.json"), sentence


def vertex_that_is_none(folder, rig, truth):
    (folder / "odd.json").write_text('{"m0": 0, "m9": 9, "m18": 225}', encoding="utf-8")
    sentence = (
        "The correspondences put marker 'm18' on vertex 225, but the rig's are 0 to 224; use the vertex numbers "
        "of the rig file as it is read."
    )
    return changed(SOLVE, places="odd.json"), sentence


def correspondences_that_are_no_json(folder, rig, truth):
    (folder / "odd.json").write_text('{"m0": 0', encoding="utf-8")
    sentence = "Cannot read odd.json: it is not valid JSON (Expecting ',' delimiter: line 1 column 9 (char 8))."
    return changed(SOLVE, places="odd.json"), sentence


def rate_zero(folder, rig, truth):
    text = (folder / "truth.csv").read_text(encoding="utf-8")
    (folder / "still.csv").write_text(text.replace("# rate: 60", "# rate: 0"), encoding="utf-8")
    sentence = "The rate of still.csv must be a positive number of frames a second, but is '0'; state the true rate."
    return ["convert", "still.csv", "new.npz"], sentence


def unknown_shape(folder, rig, truth):
    blendcap.write_animation(folder / "other.csv", replace(truth, names=("bumpLeft", "bumpRight", "jawOpen")))
    sentence = (
        "The animation moves the shape 'jawOpen', for which there is no place; rename it, or convert with --partial "
        "(partial=True) to leave such shapes out."
    )
    return ["convert", "other.csv", "new.glb", "--rig", "rig.glb"], sentence


def unknown_shape_to_evaluate(folder, rig, truth):
    blendcap.write_animation(folder / "other.csv", replace(truth, names=("bumpLeft", "bumpRight", "jawOpen")))
    sentence = (
        "The answer has a shape 'jawOpen' that the rig 'sheet' lacks; rename or remove it, or write it in the rig's "
        "shapes first: blendcap convert IN OUT --rig RIG."
    )
    return ["evaluate", "other.csv", "truth.csv", "--rig", "rig.glb"], sentence


def no_such_folder(folder, rig, truth):
    sentence = "Cannot write away/out.csv: the folder away does not exist; create it first."
    return changed(SOLVE, out="away/out.csv"), sentence


def output_is_a_folder(folder, rig, truth):
    (folder / "out.csv").mkdir()
    return list(SOLVE), "Cannot write out.csv: it is a folder; name a file inside it."


def unknown_ending(folder, rig, truth):
    return changed(SOLVE, out="out.xyz"), "Cannot write out.xyz: its ending must be one of .csv, .glb, .npz."


def unknown_ending_of_the_second_output(folder, rig, truth):
    return [*SOLVE, "-o", "out.xyz"], "Cannot write out.xyz: its ending must be one of .csv, .glb, .npz."


def rig_of_unknown_ending(folder, rig, truth):
    (folder / "rig.fbx").write_bytes(b"Kaydara FBX Binary  \x00")
    sentence = (
        "rig.fbx has an ending that is not known: mesh .obj, .ply, .stl, .glb, .gltf; rig .glb, .gltf, .npz; "
        "markers .c3d, .trc, .csv; animation .csv, .npz, .glb, .gltf; video .mp4, .mov, .m4v, .mkv, .avi, .webm, .gif; "
        "cameras and places .json. A rig may be a folder of .obj too."
    )
    return ["info", "rig.fbx"], sentence


def glb(path: Path, gltf: dict, binary: bytes = b"") -> None:
    text = json.dumps({"asset": {"version": "2.0"}, **gltf}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def scene(buffer: dict, view: dict, count: int) -> dict:
    return {
        "buffers": [buffer],
        "bufferViews": [{"buffer": 0, **view}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }


def buffer_outside_its_folder(folder, rig, truth):
    (folder / "inside").mkdir()
    (folder / "secret").write_bytes(bytes(36))
    glb(folder / "inside" / "odd.glb", scene({"byteLength": 36, "uri": "../secret"}, {"byteLength": 36}, 3))
    sentence = (
        "Cannot read inside/odd.glb: The glTF points to '../secret', outside its own folder; put the file beside "
        "it or export a GLB."
    )
    return ["info", "inside/odd.glb"], sentence


def terabytes_of_buffer(folder, rig, truth):
    glb(folder / "odd.glb", scene({"byteLength": 12 * 10**12}, {"byteLength": 36}, 3), bytes(36))
    sentence = (
        "Cannot read odd.glb: The glTF declares a buffer of 12000000000000 bytes, but it has 36; the file is cut short."
    )
    return ["info", "odd.glb"], sentence


def terabytes_of_view(folder, rig, truth):
    glb(folder / "odd.glb", scene({"byteLength": 36}, {"byteLength": 12 * 10**12}, 10**12), bytes(36))
    sentence = (
        "Cannot read odd.glb: The glTF's buffer view 0 ends at byte 12000000000000, but its buffer has 36; the "
        "file is cut short or damaged."
    )
    return ["info", "odd.glb"], sentence


def terabytes_of_vertices(folder, rig, truth):
    glb(folder / "odd.glb", scene({"byteLength": 36}, {"byteLength": 36}, 10**12), bytes(36))
    sentence = (
        "Cannot read odd.glb: The glTF asks for 1000000000000 elements (12000000000000 bytes) from buffer view "
        "0, which has 36 bytes; the file is cut short or damaged."
    )
    return ["info", "odd.glb"], sentence


def negative_smoothness(folder, rig, truth):
    return [*SOLVE, "--smoothness", "-1"], "The setting smoothness must be a number that is not negative, but is -1.0."


def beta_without_its_method(folder, rig, truth):
    return [*SOLVE, "--beta", "0.3"], "--beta belongs to --method paper, not to learned; leave it out."


def coupling_without_its_method(folder, rig, truth):
    return [*SOLVE, "--coupling", "1"], "--coupling belongs to --method paper, not to learned; leave it out."


def misspelt_stable_marker(folder, rig, truth):
    arguments = [*SOLVE, "--stable", "m0", "--stable", "m99x", "--stable", "m18"]
    return arguments, "--stable names the marker 'm99x', which the take does not have; do you mean 'm99'?"


def unknown_stable_marker(folder, rig, truth):
    sentence = (
        "--stable names the marker 'helmet', which the take does not have; there are m0, m9, m18, m27, m36, m45, m54, "
        "m63, m72, m81, m90, m99 and 13 more."
    )
    return [*SOLVE, "--stable", "helmet"], sentence


def stable_marker_without_a_place(folder, rig, truth):
    (folder / "few.json").write_text('{"m0": 0, "m9": 9, "m18": 18, "m27": 27}', encoding="utf-8")
    sentence = "--stable names the marker 'm36', which has no correspondence; there are m0, m9, m18, m27."
    return [*changed(SOLVE, places="few.json"), "--stable", "m0", "--stable", "m36"], sentence


def too_few_stable_markers(folder, rig, truth):
    return [*SOLVE, "--stable", "m0"], "--stable names only 1; to find the head takes at least three markers."


def stable_markers_of_a_head_that_is_kept(folder, rig, truth):
    sentence = "--stable says how to remove the head's motion, and --head keep not to; choose one."
    return [*SOLVE, "--stable", "m0", "--head", "keep"], sentence


def glb_that_is_none(folder, rig, truth):
    (folder / "rig.glb").write_bytes((folder / "take.c3d").read_bytes())
    return ["info", "rig.glb"], "Cannot read rig.glb: it is no GLB, whatever its name says; export it again."


def folder_without_a_rig(folder, rig, truth):
    (folder / "empty").mkdir()
    sentence = "empty is a folder without .obj files; put neutral.obj and one .obj a shape there."
    return changed(SOLVE, rig="empty"), sentence


def output_that_is_an_input(folder, rig, truth):
    blendcap.write_markers(folder / "take.csv", blendcap.read_markers(folder / "take.c3d"))
    sentence = "Cannot write take.csv: it is an input too, and would be lost; choose another name."
    return changed(SOLVE, take="take.csv", out="take.csv"), sentence


def places_that_are_an_input(folder, rig, truth):
    sentence = "Cannot write places.json: it is an input too, and would be lost; choose another name."
    return [*SOLVE, "--write-places", os.path.join(".", "places.json")], sentence


def output_under_a_file(folder, rig, truth):
    return changed(SOLVE, out="rig.glb/out.csv"), "Cannot write rig.glb/out.csv: rig.glb is a file; name a folder."


def demo_in_a_file(folder, rig, truth):
    return ["demo", "--out", "rig.glb"], "Cannot write to rig.glb: it is a file; name a folder."


def csv_of_another_program(folder, rig, truth):
    (folder / "motive.csv").write_text(
        "Format Version,1.23,Take Name,One,Capture Frame Rate,120,Export Frame Rate,120\n"
    )
    sentence = "Cannot read motive.csv: it is a CSV of OptiTrack Motive; export the take as C3D."
    return changed(SOLVE, take="motive.csv"), sentence


def semicolons(folder, rig, truth):
    (folder / "semi.csv").write_text("frame;time;a_x;a_y;a_z\n0;0;1,5;2;3\n")
    sentence = "Cannot read semi.csv: its cells are parted by semicolons; export it with commas and points."
    return ["info", "semi.csv"], sentence


def landmarks_on_a_template_without_any(folder, rig, truth):
    (folder / "scan.json").write_text('{"30": 4, "36": 17, "45": 30}')
    arguments = ["rig", "build", "rig.glb", "-o", "new.glb", "--template", "rig.glb", "--landmarks", "scan.json"]
    return arguments, unknown_place(folder, rig, truth)[1]


REFUSALS = [landmarks_on_a_template_without_any, csv_of_another_program, semicolons,
            glb_that_is_none, folder_without_a_rig, output_that_is_an_input, places_that_are_an_input,
            output_under_a_file, demo_in_a_file,
            misspelt_stable_marker, unknown_stable_marker, stable_marker_without_a_place, too_few_stable_markers,
            stable_markers_of_a_head_that_is_kept,
            missing_file, missing_rig, truncated_glb, obj_with_other_topology, c3d_that_is_none, empty_take,
            all_missing_marker, nan_frame, unknown_label, unknown_place, vertex_that_is_none,
            correspondences_that_are_no_json, rate_zero, unknown_shape, unknown_shape_to_evaluate, no_such_folder,
            output_is_a_folder, unknown_ending, unknown_ending_of_the_second_output, rig_of_unknown_ending,
            buffer_outside_its_folder, terabytes_of_buffer,
            terabytes_of_view, terabytes_of_vertices, negative_smoothness, beta_without_its_method,
            coupling_without_its_method]  # fmt: skip


@pytest.mark.parametrize("spoil", REFUSALS)
def test_bad_input_gets_one_plain_sentence_and_leaves_nothing_behind(spoil, folder, rig, truth, capsys):
    arguments, sentence = spoil(folder, rig, truth)
    before = sorted(folder.rglob("*"))
    assert main(arguments) == 1
    assert capsys.readouterr().err == f"blendcap: {sentence}\n"
    assert sorted(folder.rglob("*")) == before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_write_permission_is_refused_before_the_work(folder, capsys):
    (folder / "locked").mkdir(mode=0o500)
    assert main(changed(SOLVE, out="locked/out.csv")) == 1
    assert "locked" in capsys.readouterr().err


# Answers


def test_solve_answers_in_json_and_in_every_file_that_was_asked_for(folder, truth, capsys):
    assert main([*SOLVE, "-o", "out.glb", "-o", "out.npz", "--json"]) == 0
    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert {"frames", "rate", "rms_mm", "rms_mm_per_marker", "max_kkt", "converged", "seconds"} <= set(answer)
    assert answer["frames"] == FRAMES and answer["rate"] == RATE and answer["converged"] is True
    assert answer["max_kkt"] < 1e-9 and set(answer["rms_mm_per_marker"]) == {f"m{v}" for v in range(0, 225, 9)}
    assert answer["files"] == ["out.csv", "out.glb", "out.npz"]
    files = [blendcap.read_animation(folder / name) for name in answer["files"]]
    for animation in files:
        assert animation.rate == pytest.approx(RATE) and animation.names == NAMES
        np.testing.assert_allclose(animation.weights, files[2].weights, atol=1e-5)
    assert np.abs(files[2].weights - truth.weights).mean() < 0.02


def test_a_marker_that_is_left_out_is_said(folder, capsys):
    places = json.loads((folder / "places.json").read_text(encoding="utf-8"))
    del places["m9"], places["m99"]
    (folder / "places.json").write_text(json.dumps(places), encoding="utf-8")
    assert main([*SOLVE, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["left_out"] == ["m9", "m99"]
    assert main([*SOLVE]) == 0
    assert re.search(r"left out +2: m9, m99", capsys.readouterr().out)


@pytest.mark.parametrize(("unit", "span"), [("cm", "1800"), ("m", "180000"), ("mm", "")])
def test_a_take_that_is_no_face_in_its_unit_is_warned_of_before_it_is_bound(folder, capsys, unit, span):
    main([*SOLVE, "--unit", unit])
    said = capsys.readouterr()
    assert ("which is no face: if its unit is wrong, say --unit" in said.err) == bool(span)
    if span:
        assert f"span {span} mm" in said.err.splitlines()[0]


def test_places_that_a_solve_found_serve_the_next_one(folder, truth, capsys):
    assert main([*SOLVE, "--write-places", "found.json"]) == 0
    found = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    assert list(found) == [f"m{v}" for v in range(0, 225, 9)] and set(found["m0"]) == {"face", "barycentric"}
    assert main(changed(SOLVE, places="found.json", out="again.csv")) == 0
    again = blendcap.read_animation(folder / "again.csv")
    assert np.abs(again.weights - truth.weights).mean() < 0.02
    assert main([*SOLVE, "--write-places", "found.txt"]) == 1
    assert "ending must be one of .json" in capsys.readouterr().err


def test_evaluate_of_the_truth_is_without_error(folder, capsys):
    assert main(["evaluate", "truth.csv", "truth.csv", "--rig", "rig.glb", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert {"vertex_rmse_mm", "by_region_mm", "weight_mae", "roughness_ratio", "sparsity"} <= set(answer)
    assert answer["vertex_rmse_mm"] == 0 and answer["weight_mae"] == 0 and answer["roughness_ratio"] == 1


@pytest.mark.parametrize(("share", "said"), [(0.1, "0.2: of the difference between left and right is lost"),
                                             (-0.1, "-0.2: the sides differ more than they did")])  # fmt: skip
def test_evaluate_says_what_the_leak_is(folder, rig, truth, capsys, share, said):
    blendcap.write_rig(folder / "rig.glb", replace(rig, mirror=[1, 0, 2]))
    mixed = (1 - share) * truth.weights + share * truth.weights[:, [1, 0, 2]]
    blendcap.write_animation(folder / "mixed.csv", replace(truth, weights=mixed))
    assert main(["evaluate", "mixed.csv", "truth.csv", "--rig", "rig.glb"]) == 0
    assert re.search(rf"leak +{said}\n", capsys.readouterr().out)


def test_info_says_what_a_rig_a_take_and_an_animation_hold(folder, capsys):
    answers = []
    for name in ("rig.glb", "take.c3d", "truth.csv"):
        assert main(["info", name, "--json"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    rig, take, animation = answers
    assert rig["kind"] == "rig" and rig["vertices"] == 225 and rig["faces"] == 392 and rig["shapes"] == list(NAMES)
    assert rig["unit"] == "mm"
    assert take["kind"] == "markers" and take["frames"] == FRAMES and take["rate"] == RATE
    assert len(take["markers"]) == 25 and take["missing"] == 0 and take["filled"] == {}
    assert animation["kind"] == "animation" and animation["frames"] == FRAMES and animation["shapes"] == list(NAMES)


def test_info_speaks_to_people_in_lines(folder, capsys):
    assert main(["info", "rig.glb"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split() == ["vertices", "225"] for line in lines)
    assert any("bumpLeft, bumpRight, lift" in line for line in lines)
    assert any(re.fullmatch(r"size      140 x 180 x \S+ mm \(x, y, z\)", line) for line in lines)
    assert main(["info", "take.c3d"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "unit       mm, as the file says" in lines and "missing    0 % of the samples" in lines
    assert "seconds    0.6667" in lines and "have gaps  none" in lines and "filled     none" in lines
    camera = Camera([[80, 0, 32], [0, 80, 24], [0, 0, 1]], np.eye(4))
    write_cameras("c.json", {"upper": (camera, (64, 48)), "lower": (camera, (32, 24))})
    assert main(["info", "c.json"]) == 0
    assert "cameras  2: upper (64 x 48 pixels), lower (32 x 24 pixels)" in capsys.readouterr().out


def test_info_says_that_filled_gaps_are_told_by_frames(folder, monkeypatch, capsys):
    monkeypatch.setattr("blendcap.cli.info._filled", lambda _: {"filled": {"m3": [(4, 9), (12, 15)]}})
    assert main(["info", "take.c3d"]) == 0
    assert "filled     2: m3 frames 4 to 9, m3 frames 12 to 15" in capsys.readouterr().out


def test_of_the_markers_alone_beside_a_hybrid_solve_nothing_is_warned(folder, monkeypatch, capsys):
    blendcap.write_animation("curves.csv", blendcap.read_animation("truth.csv").select(["lift"]))
    solves, solve = [], blendcap.solve

    def warned(*given, patches=None, **options):
        logging.getLogger("blendcap.markers.solve").warning("seen by no marker, %s", "hybrid" if patches else "alone")
        solves.append(patches is not None)
        return solve(*given, patches=patches, **options)

    monkeypatch.setattr(blendcap, "solve", warned)
    common = ["solve", "take.c3d", "--rig", "rig.glb", "-o", "both.csv"]
    assert main([*common, "--patches", "curves.csv", "--report", "both.html"]) == 0
    said = capsys.readouterr().err
    assert solves == [True, False] and "no marker, hybrid" in said and "no marker, alone" not in said
    assert "What the paint changed" in Path("both.html").read_text(encoding="utf-8")
    assert main(common) == 0
    assert "no marker, alone" in capsys.readouterr().err  # a solve of markers alone warns as ever


def test_an_offset_without_patches_is_refused(folder, capsys):
    assert main(["solve", "take.c3d", "--rig", "rig.glb", "--patches-offset", "0.5", "-o", "off.csv"]) == 1
    assert "--patches-offset says when the curves of --patches begin" in capsys.readouterr().err
    assert not Path("off.csv").exists()


def test_info_prints_every_name_wrapped_to_the_terminal(folder, rig, monkeypatch, capsys):
    names = [f"shapeWithALongName{k}" for k in range(140)]
    blendcap.write_rig("many.npz", replace(rig, deltas=np.zeros((140, 225, 3)), names=names, bounds=None, mirror=None))
    monkeypatch.setenv("COLUMNS", "72")
    assert main(["info", "many.npz"]) == 0
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines())) <= 72
    assert "140: " + ", ".join(names) in " ".join(said.split())


def test_info_says_which_markers_have_gaps_and_in_which_unit_the_file_is(folder, capsys):
    take = blendcap.read_markers("take.c3d")
    positions = take.positions.copy()
    positions[20:30, 3] = positions[5, 7] = np.nan
    blendcap.write_markers("gaps.c3d", replace(take, positions=positions))
    content = (folder / "gaps.c3d").read_bytes()
    place = content.index(b"mm", content.index(b"UNITS"))
    (folder / "none.c3d").write_bytes(content[:place] + b"  " + content[place + 2 :])
    (folder / "cm.c3d").write_bytes(content[:place] + b"cm" + content[place + 2 :])
    answers = []
    for name in ("gaps.c3d", "cm.c3d", "none.c3d"):
        assert main(["info", name, "--json"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert [answer["file_unit"] for answer in answers] == ["mm", "cm", None]
    assert [answer["unit"] for answer in answers] == ["mm", "mm", None]
    span = np.ptp(positions[0], axis=0)
    for answer, scale in zip(answers, (1, 10, 1), strict=True):
        np.testing.assert_allclose(answer["size"], scale * span, rtol=1e-2)  # ten frames, of which the last ones move
        assert answer["missing_of_marker"] == {"m27": 0.25, "m63": 0.025}
    assert main(["info", "none.c3d"]) == 0
    said = capsys.readouterr().out
    assert "the file says none; give --unit here and to solve" in said and "2: m27 25%, m63 2.5%" in said
    assert main(["solve", "none.c3d", *SOLVE[2:]]) == 1
    assert "none.c3d does not say the unit of its lengths; say the unit yourself: mm, cm" in capsys.readouterr().err


def test_info_takes_another_unit_than_that_of_the_file(folder, rig, capsys):
    blendcap.write_mesh(folder / "face.obj", rig.mesh)
    for name, scale in (("rig.glb", 1 / 100), ("face.obj", 10), ("take.c3d", 10)):
        assert main(["info", name, "--json"]) == 0
        stated = json.loads(capsys.readouterr().out)
        assert main(["info", name, "--unit", "cm", "--json"]) == 0
        given = json.loads(capsys.readouterr().out)
        np.testing.assert_allclose(given["size"], np.multiply(scale, stated["size"]), rtol=1e-3, atol=1e-3)
        assert given["unit"] == "mm"
    assert main(["info", "take.c3d", "--unit", "cm"]) == 0
    assert "cm, as you say; the file says mm" in capsys.readouterr().out
    assert main(["info", "truth.csv", "--unit", "cm"]) == 1
    assert "truth.csv holds no lengths that --unit" in capsys.readouterr().err


def test_info_of_a_marker_that_is_never_seen_and_of_weights_that_are_unknown(folder, capsys):
    take = blendcap.read_markers("take.c3d")
    positions = np.full_like(take.positions, np.nan)
    blendcap.write_markers("gone.c3d", replace(take, positions=positions))
    animation = blendcap.read_animation("truth.csv")
    weights = animation.weights.copy()
    weights[:, 0] = np.nan
    blendcap.write_animation("gaps.csv", replace(animation, weights=weights))
    assert main(["info", "gone.c3d"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"size +none", said) and "25: m0 100%, m9 100%" in said
    assert main(["info", "gaps.csv"]) == 0
    said = capsys.readouterr().out
    assert "33.3 % of the samples" in said and re.search(r"seconds +0\.6667", said)


@pytest.mark.parametrize("command", ["solve", "facs train", "facs predict", "rig build", "rig convert", "view", "info"])
def test_no_help_shows_an_empty_default(capsys, command):
    assert main([*command.split(), "--help"]) == 0
    assert "()" not in capsys.readouterr().out


def test_the_help_of_solve_names_the_defaults(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    assert main(["solve", "--help"]) == 0
    said = " ".join(re.sub(r"[^\x20-\x7e]", " ", capsys.readouterr().out).split())  # a narrow console wraps lines
    settings = blendcap.SolveSettings()
    for name in ("smoothness", "beta", "coupling", "influence", "curve-error"):
        option = re.search(rf"--{name} (.*?) --", said)
        assert option
        default = re.search(r"([\d.]+)[^.;]*if not given", option[1])
        assert default and float(default[1]) == getattr(settings, name.replace("-", "_"))


def test_convert_keeps_the_animation(folder, truth, capsys):
    assert main(["convert", "truth.csv", "new.glb", "--rig", "rig.glb"]) == 0
    assert main(["convert", "new.glb", "new.npz"]) == 0
    back = blendcap.read_animation(folder / "new.npz")
    assert back.names == truth.names and back.rate == pytest.approx(truth.rate)
    np.testing.assert_allclose(back.weights, truth.weights, atol=1e-6)


def test_rig_convert_keeps_the_rig(folder, rig):
    assert main(["rig", "convert", "rig.glb", "new.npz"]) == 0
    back = blendcap.read_rig(folder / "new.npz")
    assert back.names == rig.names
    np.testing.assert_allclose(back.deltas, rig.deltas, atol=1e-4)


def test_doctor_finds_this_installation_well(capsys):
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert blendcap.__version__ in said and "All is well." in said and "!!" not in said


def test_doctor_says_what_is_wrong_and_fails(capsys, monkeypatch):
    monkeypatch.setitem(vars(blendcap), "solve_box", lambda *_: 1 / 0)
    assert main(["doctor"]) == 1
    said = capsys.readouterr().out
    assert "!! solver" in said and "ZeroDivisionError" in said and "All is well." not in said


# The frame around the commands


@pytest.mark.parametrize(
    "arguments", [["sovle"], ["solve"], ["info"], [*SOLVE, "--smoothness", "much"], ["info", "--x", "y"]]
)
def test_wrong_usage_exits_with_two(folder, arguments, capsys):
    assert main(arguments) == 2
    assert capsys.readouterr().err


def test_the_version_and_the_help(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == blendcap.__version__
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(command in said for command in ("demo", "doctor", "info", "solve", "convert", "evaluate", "rig"))


def test_what_nobody_foresaw_is_still_one_sentence(folder, capsys, monkeypatch):
    def broken(path, unit, **_):
        raise RuntimeError("first line\nsecond line")

    monkeypatch.setattr("blendcap.io.describe", broken)
    assert main(["info", "rig.glb"]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "RuntimeError: first line second line" in error and "--debug" in error
    with pytest.raises(RuntimeError):
        main(["--debug", "info", "rig.glb"])


def test_an_interrupt_is_clean(folder, capsys, monkeypatch):
    def interrupted(path, *args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("blendcap.io.describe", interrupted)
    assert main(["info", "rig.glb"]) == 130
    assert capsys.readouterr().err == "blendcap: stopped; no file was left half-written.\n"


def test_as_a_program_with_its_exit_code_and_a_clean_standard_output(folder):
    def run(*arguments: str) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", "blendcap", *arguments]
        return subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
        )

    good = run("info", "rig.glb", "--json")
    assert (good.returncode, good.stderr) == (0, "") and json.loads(good.stdout)["kind"] == "rig"
    bad = run("info", "nowhere.glb")
    assert bad.returncode == 1 and bad.stdout == "" and bad.stderr.count("\n") == 1
    assert run("bogus").returncode == 2


@pytest.mark.parametrize(
    ("called", "found", "said"),
    [
        ("/a/blendcap/__main__.py", None, "python -m blendcap"),
        (os.path.join(os.getcwd(), ".venv", "bin", "blendcap"), None, os.path.join(".venv", "bin", "blendcap")),
        ("/a/blendcap/__main__.py", "/usr/bin/blendcap", "blendcap"),
    ],
)
def test_the_demo_names_a_command_that_can_be_called(monkeypatch, called, found, said):
    monkeypatch.setattr("sys.argv", [called])
    monkeypatch.setattr("shutil.which", lambda name: found)
    assert program() == said


def test_the_c3d_of_this_test_is_one_that_other_programs_read(folder):
    other = ezc3d.c3d(str(folder / "take.c3d"))
    assert other["data"]["points"].shape == (4, 25, FRAMES)


def test_rig_convert_gives_a_rig_its_landmarks(folder, rig, capsys):
    places = {str(i): int(rig.mesh.faces[i, 1]) for i in reversed(range(68))}  # their order in the file is free
    (folder / "landmarks68.json").write_text(json.dumps(places))
    assert main(["rig", "convert", "rig.glb", "new.glb", "--points", "landmarks68.json"]) == 0
    back = landmarks68(blendcap.read_rig(folder / "new.glb"))
    there = rig.mesh.vertices[rig.mesh.faces[:68, 1]]
    np.testing.assert_allclose(back.positions(rig.mesh), there, atol=1e-3)
    (folder / "landmarks68.json").write_text(json.dumps(places | {"30": 0}).replace('"31"', '"nose"'))
    assert main(["rig", "convert", "rig.glb", "other.glb", "--points", "landmarks68.json"]) == 1
    said = capsys.readouterr().err
    assert "has no point '31' in 'landmarks68'" in said and '{"0": 1234, ' in said and "rig convert RIG" in said
    (folder / "landmarks68.json").write_text('{"30": 99999999}')
    assert main(["rig", "convert", "rig.glb", "other.glb", "--points", "landmarks68.json"]) == 1
    assert "vertex 99999999" in capsys.readouterr().err and not (folder / "other.glb").exists()


def test_rig_convert_takes_another_unit_than_that_of_the_file(folder, rig, capsys):
    blendcap.write_rig(
        "large.glb", replace(rig, mesh=rig.mesh.with_vertices(100 * rig.mesh.vertices), deltas=100 * rig.deltas)
    )
    assert main(["info", "large.glb"]) == 0
    assert "no head: it may be in another unit: say which by unit= or --unit" in capsys.readouterr().err
    assert main(["rig", "convert", "large.glb", "mended.npz", "--unit", "cm"]) == 0
    assert not capsys.readouterr().err
    back = blendcap.read_rig("mended.npz")
    np.testing.assert_allclose(back.mesh.vertices, rig.mesh.vertices, atol=1e-3)
    np.testing.assert_allclose(back.deltas, rig.deltas, atol=1e-3)
    np.testing.assert_allclose(blendcap.read_rig("mended.npz", "in").deltas, 25.4 * rig.deltas, atol=1e-2)


def test_rig_convert_keeps_what_live_link_face_can_hold(folder, rig, capsys):
    names = ("browInnerUp_L", "visemeAA", "browInnerUp_R", "jawOpen")
    blendcap.write_rig("many.npz", Rig(rig.mesh, rig.deltas[[0, 2, 1, 2]], names))
    assert main(["rig", "convert", "many.npz", "few.npz", "--shapes", "arkit"]) == 0
    few = blendcap.read_rig("few.npz")
    assert few.names == ("browInnerUp_L", "browInnerUp_R", "jawOpen")
    np.testing.assert_array_equal(few.deltas, rig.deltas[[0, 1, 2]])
    assert main(["rig", "convert", "rig.glb", "none.npz", "--shapes", "arkit"]) == 1
    assert "has none of the 52 shapes of ARKit, but bumpLeft, bumpRight, lift; keep all" in capsys.readouterr().err


def test_the_longest_gap_is_a_choice():
    from blendcap.cli.solve import Choices

    assert Choices().settings() == blendcap.SolveSettings()
    assert Choices(longest_gap=2.0).settings() == blendcap.SolveSettings(longest_gap=2.0)
