"""Looking at rigs and animations: pictures, films, and the film of the performance beside."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from blendcap import Animation, Mesh, Rig, read_animation, read_video, write_animation, write_rig
from blendcap.cli import main
from blendcap.cli.films import thin_film, writes
from blendcap.io import write_video
from blendcap.view.beside_film import pictures_at
from blendcap.view.sheet import _described, _halves, _letters, contact_sheet, reach
from blendcap.view.still import still
from sheet import sheet_rig

RATE = 25.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder, rig = tmp_path_factory.mktemp("view"), sheet_rig()
    weights = np.zeros((10, len(rig.names)))
    weights[6] = 0.5
    write_rig(folder / "face.npz", rig)
    write_animation(folder / "take.csv", Animation(weights, rig.names, RATE))
    steps = (np.full((40, 60, 3), 6 * t, np.uint8) for t in range(40))
    write_video(folder / "film.mp4", steps, 2 * RATE, (60, 40), loss=1)
    return folder


@pytest.fixture(autouse=True)
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)


def pixels(path):
    return np.array(Image.open(path).convert("RGB"))


def test_a_rig_by_itself_is_its_contact_sheet(capsys):
    assert main(["view", "face.npz"]) == 0
    assert capsys.readouterr().out.endswith("Open face.png.\n")
    np.testing.assert_array_equal(pixels("face.png"), contact_sheet(sheet_rig()))


def test_a_shape_is_shown_with_those_that_it_needs():
    rig = sheet_rig()
    deltas = np.concatenate([rig.deltas[:2], rig.deltas[:1]])
    alone = Rig(rig.mesh, deltas, ("jawOpen", "browInnerUp", "mouthClose"))
    told = replace(alone, combinations={"mouthClose": ("jawOpen",)})
    np.testing.assert_array_equal(contact_sheet(alone, cell=60), contact_sheet(told, cell=60))


def test_a_name_that_nobody_gave_costs_no_file(folder, capsys):
    (folder / "there.png").write_text("mine")
    write_rig(folder / "there.npz", sheet_rig())
    assert main(["view", "there.npz"]) == 1
    assert "there.png is there already; name the file to write, with -o there.png" in capsys.readouterr().err
    assert (folder / "there.png").read_text() == "mine"
    assert main(["view", "there.npz", "-o", "there.png"]) == 0
    assert pixels("there.png").any()


def test_a_sheet_has_the_form_of_a_screen_and_names_that_fit():
    count = 140
    rig = Rig(sheet_rig().mesh, np.zeros((count, len(sheet_rig().mesh.vertices), 3)), [f"s{k}" for k in range(count)])
    height, width = contact_sheet(rig, cell=20).shape[:2]
    assert 1.4 < width / height < 1.8
    assert _halves("mouthFunnelLowerLeft") == ["mouthFunnel", "LowerLeft"]
    assert _halves("visemeAA") == ["viseme", "AA"] and _halves("lift") == ["lift"]
    assert _halves("brow_inner.L") == ["brow", "_inner.L"]
    cell = np.zeros((288, 240, 3), np.uint8)
    one, two = _letters(["mouthFunnelLowerLeft"], cell, 0.67), _letters(_halves("mouthFunnelLowerLeft"), cell, 0.67)
    assert one < 15 and two >= 20
    described = _described(cell.copy(), "mouthFunnelLowerLeft", 10.7)
    assert not described[:, 170:].any() and described[215:235].any()  # a second line, and nothing beside it


@pytest.mark.parametrize(("rate", "shown"), [(24, 24), (29.97, 29.97), (30.5, 30.5), (40, 20), (50, 25), (59.94, 29.97),
                                             (60, 30), (120, 30), (240, 30)])  # fmt: skip
def test_a_film_has_at_most_thirty_pictures_a_second_in_real_time(rate, shown):
    animation = Animation(np.zeros((240, 1)), ("jawOpen",), rate)
    film = thin_film(animation)
    assert film.rate(animation) == pytest.approx(shown)
    assert film.count(animation) / film.rate(animation) == pytest.approx(240 / rate, abs=1 / shown)
    assert ("real time" in writes(Path("a.mp4"), film, animation)) == (film.every > 1)


@pytest.mark.parametrize(("asked", "shown"), [(["--frame", "0"], 0.0), ([], 0.5)])
def test_a_picture_of_an_animation_is_the_frame_asked_for_or_the_farthest(asked, shown):
    assert main(["view", "face.npz", "take.csv", "-o", "frame.png", *asked]) == 0
    rig = sheet_rig()
    np.testing.assert_array_equal(pixels("frame.png"), still(rig, np.full(len(rig.names), shown)))


def test_an_animation_becomes_a_film_at_its_rate(capsys):
    assert main(["view", "face.npz", "take.csv"]) == 0
    film = read_video("take.mp4")
    assert (film.count, film.rate) == (10, RATE)


def test_the_film_beside_shows_the_same_moment():
    assert main(["view", "face.npz", "take.csv", "--video", "film.mp4", "--offset", "0.2", "-o", "both.mp4"]) == 0
    both = read_video("both.mp4")
    assert both.count == 10
    left = [picture[:, : both.size[1]].mean() for picture in both.frames()]
    np.testing.assert_allclose(left, 6 * (10 + 2 * np.arange(10)), atol=3)


def test_where_the_film_has_no_picture_it_is_black():
    means = [picture.mean() for picture in pictures_at(read_video("film.mp4"), np.array([-1, 0, 5, 5, 39, 40]))]
    np.testing.assert_allclose(means, [0, 0, 30, 30, 234, 0], atol=2)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["take.csv", "--frame", "10", "-o", "x.png"], "There is no frame 10; the animation has the frames 0 to 9."),
        (["--frame", "1"], "--frame picks a frame of an animation"),
        (["take.csv", "--frame", "1", "-o", "x.mp4"], "--frame picks a frame of an animation for a .png"),
        (["--video", "film.mp4"], "--video is shown beside an animation"),
        (["take.csv", "--offset", "2"], "--offset says when the animation begins in a film"),
        (["-o", "x.mp4"], "its ending must be one of .png"),
        (["take.csv", "-o", "x.html"], "its ending must be one of .png, .mp4, .gif"),
        (["take.csv", "--video", "film.mp4", "--offset", "9", "-o", "x.mp4"], "has no picture of the animation"),
        (["take.csv", "--video", "film.mp4", "-o", "film.mp4"], "it is an input too, and would be lost"),
        (["take.csv", "--video", "face.npz", "-o", "x.mp4"], "holds no video"),
    ],
)
def test_what_does_not_go_together_is_one_sentence(folder, capsys, arguments, sentence):
    assert main(["view", "face.npz", *arguments]) == 1
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1
    assert not list(folder.glob("x.*"))


def test_the_frame_that_is_shown_is_said(capsys):
    assert main(["view", "face.npz", "take.csv", "-o", "frame.png"]) == 0
    said = capsys.readouterr().out
    assert said.endswith("Open frame.png: frame 6 of 0 to 9, 0.24 s, the farthest from neutral.\n")
    assert main(["view", "face.npz", "take.csv", "-o", "frame.png", "--frame", "2"]) == 0
    assert capsys.readouterr().out.endswith("Open frame.png: frame 2 of 0 to 9, 0.08 s.\n")


def test_unknown_weights_are_said_and_not_drawn_in_silence(folder, capsys):
    animation = read_animation("take.csv")
    weights = animation.weights.copy()
    weights[3:6, :2] = np.nan
    weights[8] = np.nan
    write_animation(folder / "gaps.csv", replace(animation, weights=weights))
    unknown = {
        ("gaps.mp4",): "Weights of all shapes are unknown in 4 frames from 3 to 8; the pictures show them at rest.",
        ("one.png", "--frame", "4"): f"Weights of 2 shapes ({', '.join(animation.names[:2])}) are unknown in frame 4;",
        ("none.png", "--frame", "7"): "",
    }
    for arguments, sentence in unknown.items():
        assert main(["view", "face.npz", "gaps.csv", "-o", *arguments]) == 0
        said = capsys.readouterr().err
        assert sentence in said and said.count("warning") == bool(sentence)


def test_a_cell_is_redder_where_its_shape_moves_the_face():
    rig, cell = sheet_rig(), 200
    sheet = contact_sheet(rig, columns=1, cell=cell).reshape(-1, round(1.2 * cell), cell, 3).astype(int)
    small = sheet[3:, -72:, -60:]  # of each shape
    for name, red in zip(rig.names, small[..., 0] - small[..., 1] > 60, strict=True):
        columns = np.flatnonzero(red.any(0))
        assert len(columns), name
        if name.startswith(("brow", "mouthSmile")) and name.endswith(("Left", "Right")):
            assert (columns.mean() > 30) == name.endswith("Left")  # the subject's left is to the right


def test_a_cell_is_filled_by_what_moves_and_not_by_the_skull():
    rig = sheet_rig()
    skull = np.array([[-300.0, 400, -300], [300, 400, -300], [0, -400, -300]])
    mesh = Mesh(np.concatenate([rig.mesh.vertices, skull]), rig.mesh.faces)
    larger = Rig(mesh, np.pad(rig.deltas, ((0, 0), (0, 3), (0, 0))), rig.names)
    np.testing.assert_array_equal(reach(larger), reach(rig))
    lowest = (rig.mesh.vertices + rig.deltas[rig.index("jawOpen")])[:, 1].min()
    assert reach(rig)[:, 1].min() <= lowest + 3 and reach(rig)[:, 0].max() < rig.mesh.vertices[:, 0].max()
