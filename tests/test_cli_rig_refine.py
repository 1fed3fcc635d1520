"""blendcap rig refine: from files to a better rig, what it says, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import blendcap
from blendcap.cli.app import main
from blendcap.io import write_correspondences, write_tracks
from stage import motion, scene
from test_personal import tracked


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A rig, a take of someone else, where its markers sit, and two cameras' tracks."""
    place, whole = tmp_path_factory.mktemp("refine"), scene(motion(), strength=1.0, noise=0.1)
    blendcap.write_rig(place / "rig.npz", whole.rig)
    blendcap.write_markers(place / "take.c3d", whole.take)
    write_correspondences(place / "places.json", whole.binding.points)
    write_tracks(place / "tracks.npz", tracked(whole))
    return place


@pytest.fixture(autouse=True)
def inside(folder, monkeypatch):
    monkeypatch.chdir(folder)


REFINE = ["rig", "refine", "take.c3d", "--rig", "rig.npz", "--correspondences", "places.json", "--head", "keep"]


def test_the_refined_rig_solves_the_take_better(folder, capsys):
    assert main([*REFINE, "--tracks", "tracks.npz", "-o", "own.npz", "--picture", "own.png", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["files"] == ["own.npz", "own.png"] and answer["converged"] and answer["foretold"] > 0.1
    given, own = (blendcap.read_rig(name) for name in ("rig.npz", "own.npz"))
    changes = np.linalg.norm(own.deltas - given.deltas, axis=2).max(1)
    np.testing.assert_allclose([answer["changes_mm"][name] for name in own.names], changes, atol=1e-5)
    with Image.open("own.png") as image:
        assert image.width == 1280
    rms = []
    for rig in ("rig.npz", "own.npz"):
        solve = ["solve", "take.c3d", "--rig", rig, "--correspondences", "places.json", "--head", "keep"]
        assert main([*solve, "--tracks", "tracks.npz", "-o", "out.npz", "--json"]) == 0
        rms.append(json.loads(capsys.readouterr().out)["track_rms_mm"])
    assert rms[1] < 0.95 * rms[0]


def test_it_speaks_to_people_in_lines(folder, capsys):
    assert main([*REFINE, "-o", "own.glb"]) == 0
    said, warned = capsys.readouterr()
    assert "points tell how the shapes differ, and a few hundred are needed" in " ".join(warned.split())
    assert blendcap.read_rig("own.glb").name == "own"  # a report on it says which rig it is
    assert "Refine 19 shapes by" in said and "largest changes mm" in said and "wrote" in said and "own.glb" in said


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (["-o", "own.csv"], "Cannot write own.csv: its ending must be one of .glb, .npz."),
        (["-o", "rig.npz"], "Cannot write rig.npz: it is an input too, and would be lost; choose another name."),
        (["-o", "own.npz", "--picture", "own.jpg"], "Cannot write own.jpg: its ending must be one of .png."),
        (["-o", "own.npz", "--method", "live"],
         "A rig is refined by a whole take, and the live solve looks at the past only; choose another."),
        (["-o", "own.npz", "--patches-offset", "1"],
         "--patches-offset says when the curves of --patches begin; give these, or leave it out."),
    ],
)  # fmt: skip
def test_bad_input_gets_one_plain_sentence_and_leaves_nothing_behind(folder, capsys, change, sentence):
    before = sorted(folder.rglob("*"))
    assert main([*REFINE, *change]) == 1
    assert capsys.readouterr().err == f"blendcap: {sentence}\n"
    assert sorted(folder.rglob("*")) == before


def test_a_take_that_is_too_short_is_refused(folder, capsys):
    take = blendcap.read_markers("take.c3d")
    blendcap.write_markers("short.csv", type(take)(take.positions[:48], take.names, take.rate))
    assert main(["rig", "refine", "short.csv", *REFINE[3:], "-o", "none.npz"]) == 1
    assert "to refine a rig takes 8 s" in capsys.readouterr().err and not Path("none.npz").exists()
