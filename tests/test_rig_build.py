"""`blendcap rig build`: a scan file in, a rig file out, and a sentence for what cannot be used."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import blendcap
import masks
from blendcap.cli import main
from blendcap.cli.progress import Progress
from blendcap.cli.rig_examples import read_examples, refined
from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.modeling.build import build_rig
from blendcap.modeling.examples import asked_for
from blendcap.modeling.landmark_pairs import partners
from blendcap.view.rig_report import doubts, rig_facts

OTHER = {"width": 78.0, "nose": 14.0, "chin": -12.0}
TEMPLATE, PARAMETERS = masks.template()


def a_rig():
    lift = np.zeros((1, len(TEMPLATE.vertices), 3), np.float32)
    lift[0, :, 1] = 8 * np.exp(-(((PARAMETERS - [0, 0.5]) / 0.3) ** 2).sum(1))
    points, _ = masks.landmarks(TEMPLATE, PARAMETERS)
    return Rig(TEMPLATE, lift, ("browInnerUp",), points={"spots": points}, name="mask")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A template, a scan of somebody else and the landmarks on it; the working folder."""
    rig, scan = a_rig(), masks.scan(**OTHER)
    blendcap.write_rig(tmp_path / "mask.npz", rig)
    blendcap.write_mesh(tmp_path / "scan.obj", scan)
    _, places = masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    rows = [int(np.argmin(((scan.vertices - place) ** 2).sum(1))) for place in places]
    table = {f"spots/p{i}": row for i, row in enumerate(rows)}
    (tmp_path / "spots.json").write_text(json.dumps(table), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


BUILD = ("rig", "build", "scan.obj", "-o", "actor.npz", "--template", "mask.npz", "--landmarks", "spots.json")


def test_a_scan_becomes_a_rig_with_the_shapes_of_the_template(folder, capsys):
    assert main([*BUILD, "--json", "--report", "actor.html"]) == 0
    facts = json.loads(capsys.readouterr().out)
    actor = blendcap.read_rig(folder / "actor.npz")
    assert actor.names == ("browInnerUp",)
    turned = Mesh(masks.mask(PARAMETERS, **OTHER), TEMPLATE.faces)
    inner = (np.abs(PARAMETERS) < 0.8).all(1)
    shift = (actor.mesh.vertices - turned.vertices)[inner].mean(0)  # the rig stands where the template stands
    assert np.linalg.norm(actor.mesh.vertices - turned.vertices - shift, axis=1)[inner].mean() < 2
    assert facts["flipped"] == 0 and facts["median_mm"] < 0.3 and facts["unit_mm"] == 1
    page = (folder / "actor.html").read_text(encoding="utf-8")
    assert "http" not in page.replace("http://www.w3.org", "") and page.count("<img") >= 5


@pytest.mark.parametrize(
    ("unit", "word"), [(10, "taken to be in centimetres"), (1000, "taken to be in metres"), (50, "scaled by 4[0-9]")]
)
def test_another_unit_is_converted_and_said(folder, capsys, unit, word):
    scan = masks.scan(**OTHER)
    blendcap.write_mesh(folder / "scan.obj", scan.with_vertices(scan.vertices / unit))
    assert main(BUILD) == 0
    said = capsys.readouterr().out
    assert re.search(word, said) and re.search(rf"unit mm +{unit if unit != 50 else '4[0-9]'}", said.replace(",", ""))
    size = np.ptp(blendcap.read_rig(folder / "actor.npz").mesh.vertices[:, 0])
    assert size == pytest.approx(2 * 78, rel=0.05 if unit != 50 else 0.15)


def test_the_unit_that_a_file_states_is_what_is_said(folder, capsys):
    blendcap.write_mesh(folder / "scan.glb", masks.scan(**OTHER))
    assert main([*BUILD[:2], "scan.glb", *BUILD[3:], "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["unit_mm"] == 1000 and not any("taken to be" in note for note in facts["notes"])


def test_a_unit_guessed_wrongly_is_mended_by_the_face(folder, capsys):
    scan = masks.scan(**OTHER)
    blendcap.write_mesh(folder / "scan.obj", scan.with_vertices(scan.vertices / 50))  # as if in decimetres
    assert main(BUILD[:7]) == 0
    said = capsys.readouterr().out
    assert "taken to be in decimetres" in said and "so the unit was wrong" in said
    size = np.ptp(blendcap.read_rig(folder / "actor.npz").mesh.vertices[:, 0])
    assert size == pytest.approx(np.ptp(TEMPLATE.vertices[:, 0]), rel=0.15)  # "as large": nothing tells the true size


@pytest.mark.parametrize("landmarks", [BUILD[7:], ()])
@pytest.mark.parametrize(
    ("scale", "ending", "unit", "words"),
    [
        (1, ".obj", "m", "With the scan in metres its (face|head) is [0-9.e+]+ (mm|times).* say --unit mm."),
        (1, ".obj", "dm", "say --unit mm"),
        (0.1, ".obj", "mm", "With the scan in millimetres its .* say --unit cm"),
        (0.001, ".obj", "cm", "say --unit m."),
        (1000, ".glb", None, "With the scan in metres its .* say --unit mm"),
    ],
)
def test_a_wrong_unit_is_refused_before_the_work(folder, capsys, monkeypatch, landmarks, scale, ending, unit, words):
    monkeypatch.setattr("blendcap.modeling.build.build_rig", lambda *_, **__: pytest.fail("the work began"))
    scan = blendcap.read_mesh(folder / "scan.obj", "mm")
    blendcap.write_mesh(folder / f"scan{ending}", scan.with_vertices(scan.vertices * scale))
    given = () if unit is None else ("--unit", unit)
    assert main([*BUILD[:2], f"scan{ending}", *BUILD[3:7], *landmarks, *given]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert re.search(words, said[-1])


def test_a_unit_that_is_given_counts_more_than_that_of_the_file(folder, capsys, monkeypatch):
    def build(base, scan, *_, **__):
        sizes.append(np.ptp(scan.vertices[:, 0]))
        raise InputError("enough")

    sizes = []
    monkeypatch.setattr("blendcap.modeling.build.build_rig", build)
    scan = blendcap.read_mesh(folder / "scan.obj", "mm")
    blendcap.write_mesh(folder / "scan.glb", scan.with_vertices(scan.vertices * 100))  # centimetres, said to be metres
    assert main([*BUILD[:2], "scan.glb", *BUILD[3:], "--unit", "cm"]) == 1
    assert sizes == [pytest.approx(156, rel=0.02)]


@pytest.mark.parametrize("share", [0.15, 0.45, 0.62, 0.9])
def test_a_file_that_was_cut_short_is_one_sentence(folder, capsys, share):
    content = (folder / "scan.obj").read_bytes()
    (folder / "scan.obj").write_bytes(content[: int(share * len(content))])
    assert main([*BUILD[:7]]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("blendcap: ") and ("scan.obj" in said[-1] or "the file was cut short" in said[-1])


def test_inward_normals_are_turned_and_said(folder, capsys):
    scan = masks.scan(**OTHER)
    blendcap.write_mesh(folder / "scan.obj", Mesh(scan.vertices, scan.faces[:, ::-1]))
    assert main(BUILD) == 0
    assert "turned round" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda scan: Mesh(np.concatenate([scan.vertices, scan.vertices + np.array([300, 0, 0])]),
                           np.concatenate([scan.faces, scan.faces + len(scan.vertices)])), "two separate surfaces"),
        (lambda scan: scan.with_vertices(scan.vertices * [9, 9, 1.2]), "whole body"),
    ],
)  # fmt: skip
def test_what_is_no_head_is_one_sentence_and_no_file(folder, capsys, change, words):
    blendcap.write_mesh(folder / "scan.obj", change(masks.scan(**OTHER)))
    assert main(BUILD) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert words in said[-1] and said[-1].startswith("blendcap: ")
    assert not (folder / "actor.npz").exists()


def test_a_landmark_that_the_template_lacks_is_named(folder, capsys):
    (folder / "spots.json").write_text('{"ear_tip": 5, "spots/p0": 6, "spots/p1": 7}', encoding="utf-8")
    assert main(BUILD) == 1
    assert "no point named 'ear_tip'; its points are spots (p0, p1, p2 ...)" in capsys.readouterr().err


def test_two_landmarks_are_too_few(folder, capsys):
    (folder / "spots.json").write_text('{"spots/p0": 6, "spots/p1": 7}', encoding="utf-8")
    assert main(BUILD) == 1
    assert "Only 2 landmarks are given; give at least three, or none." in capsys.readouterr().err


def test_an_output_that_is_no_rig_is_refused_before_the_work(folder, capsys):
    assert main([*BUILD[:4], "actor.obj", *BUILD[5:]]) == 1
    assert "its ending must be one of .glb, .npz" in capsys.readouterr().err


def smiling(amount):
    """The person of the scan with the brow lifted, as another scan sees it."""
    parameters, faces = masks.sheet(49, 57, jitter=0.3, seed=7)
    lift = np.exp(-(((parameters - [0, 0.5]) / 0.3) ** 2).sum(1))
    return Mesh(masks.mask(parameters, **OTHER) + np.array([0, amount, 0]) * lift[:, None], faces)


@pytest.mark.slow
def test_examples_that_are_named_after_shapes_refine_them(folder):
    (folder / "more").mkdir()
    blendcap.write_mesh(folder / "more" / "browInnerUp.obj", smiling(12.0))
    assert main([*BUILD, "--json"]) == 0
    plain = blendcap.read_rig(folder / "actor.npz")
    assert main([*BUILD, "--json", "--examples", "more"]) == 0
    refined = blendcap.read_rig(folder / "actor.npz")
    assert refined.names == plain.names
    np.testing.assert_allclose(refined.mesh.vertices, plain.mesh.vertices, atol=1e-6)
    assert np.abs(refined.deltas - plain.deltas).max() > 0.1


@pytest.mark.parametrize(("make", "words"), [(False, "no such folder"), (True, "holds no scans")])
def test_a_folder_without_examples_is_said(folder, capsys, make, words):
    if make:
        (folder / "more").mkdir()
    assert main([*BUILD, "--examples", "more"]) == 1
    assert words in capsys.readouterr().err


def test_a_bad_example_is_refused_before_the_work(folder, capsys, monkeypatch):
    (folder / "more").mkdir()
    blendcap.write_mesh(folder / "more" / "browInnerUp.obj", masks.scan(**OTHER))
    body = masks.scan(**OTHER)
    blendcap.write_mesh(folder / "more" / "walk.obj", body.with_vertices(body.vertices * [9, 9, 1.2]))
    monkeypatch.setattr("blendcap.modeling.build.build_rig", lambda *_, **__: pytest.fail("the work began"))
    assert main([*BUILD, "--examples", "more"]) == 1
    said = capsys.readouterr().err
    assert "walk.obj cannot be used" in said and "whole body" in said


@pytest.mark.parametrize(
    ("order", "words"),
    [([0, 1, 3, 2, 5, 4, 6, 7, 8, 10, 9, 11], "left and right are swapped"),
     ([0, 1, 3, 2, 4, 5, 6, 7, 8, 9, 10, 11], "The landmarks spots/p2 and spots/p3 lie where each other should"),
     ([5, 9, 0, 11, 1, 2, 10, 3, 4, 6, 8, 7], "do not fit the template: ")],
)  # fmt: skip
def test_landmarks_on_the_wrong_places_are_refused_before_the_work(folder, capsys, monkeypatch, order, words):
    monkeypatch.setattr("blendcap.modeling.build.build_rig", lambda *_, **__: pytest.fail("the work began"))
    table = json.loads((folder / "spots.json").read_text(encoding="utf-8"))
    names, rows = list(table), list(table.values())
    wrong = dict(zip(names, [rows[k] for k in order], strict=True))
    (folder / "spots.json").write_text(json.dumps(wrong), encoding="utf-8")
    assert main(BUILD) == 1
    assert words in capsys.readouterr().err


def test_doubts_say_which_level_moved_and_where_triangles_are_folded():
    rig = a_rig()
    rig = replace(rig, regions={"lips": TEMPLATE.faces[0], "upper": np.arange(len(TEMPLATE.vertices))})
    scan, pairs = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    built = build_rig(rig, scan, pairs)
    assert not doubts(built, rig_facts(built, rig))
    levels = list(built.registration.levels)
    levels[1] = replace(levels[1], converged=False, change=0.15, steps=60)
    bad = replace(built, registration=replace(built.registration, levels=tuple(levels), flipped=np.array([0, 9])))
    facts = rig_facts(bad, rig)
    assert facts["flipped_in"] == {"lips": 1, "upper": 1}
    levels[-1] = replace(levels[-1], matched=0.41)
    bad = replace(bad, registration=replace(bad.registration, levels=tuple(levels)))
    folds, lacks, moved = doubts(bad, facts)
    assert "Only 41% of the skin has a place on the scan" in lacks
    assert "2 triangles are folded over (1 in lips, 1 in upper)" in folds
    assert "At stiffness 6.5, which is only a start" in moved and "0.15 mm a step after 60 steps" in moved


def test_names_of_files_are_weights():
    rig = a_rig()
    np.testing.assert_array_equal(asked_for(rig, ["browInnerUp", "BrowInnerUp"]), [[1], [1]])
    assert asked_for(rig, ["browInnerUp", "scan7"]) is None


def test_points_are_paired_by_name():
    rig = a_rig()
    points = partners(rig, ["p3", "spots/p0"])
    np.testing.assert_array_equal(points.faces, rig.points["spots"].faces[[3, 0]])
    other = SurfacePoints(("p3",), [0], [[1, 0, 0]])
    two = Rig(rig.mesh, rig.deltas, rig.names, points={**rig.points, "more": other})
    with pytest.raises(InputError, match="write the set too, as in spots/p3"):
        partners(two, ["p3"])
    assert partners(two, ["more/p3"]).faces[0] == 0


def test_what_is_wrong_with_an_example_is_said(tmp_path, monkeypatch, caplog):
    """Registration and refinement are left out: what matters is that the finding of landmarks does not fail unheard."""
    rig = Rig(flat_head(), np.zeros((1, 4, 3), np.float32), ("jawOpen",))
    blendcap.write_mesh(tmp_path / "jawOpen.obj", rig.mesh)
    monkeypatch.setattr("blendcap.modeling.landmark_pairs.find_pairs", lambda *_: (None, ["No landmarks were found."]))
    ready = type("Ready", (), {"mesh": rig.mesh, "unit_mm": 1.0, "notes": ["Its normals were turned."]})
    monkeypatch.setattr("blendcap.modeling.scan_repair.ready_scan", lambda *_: ready)
    monkeypatch.setattr("blendcap.modeling.build.register_example", lambda *_: rig.mesh)
    monkeypatch.setattr("blendcap.refine_rig", lambda rig, *_: rig, raising=False)
    given = read_examples([tmp_path / "jawOpen.obj"], None, 1.0, rig, Progress(quiet=True))
    assert refined(rig, given, 1.0, Progress(quiet=True)) is rig
    assert "jawOpen.obj: No landmarks were found." in caplog.text
    assert "jawOpen.obj: Its normals were turned." in caplog.text


def flat_head() -> Mesh:
    """Two triangles the size of a head."""
    return Mesh(np.array([[0.0, 0, 0], [150, 0, 0], [150, 200, 0], [0, 200, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
