"""From head-camera video to curves: train on one take, predict another, solve with it; and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import blendcap
from blendcap.cli import main
from blendcap.cli.facs import _lesson
from blendcap.cli.facs_inputs import Filmed, Footage, _check_films, blocks
from blendcap.cli.facs_inputs import stage as read_stage
from blendcap.cli.film_time import weights_at_frames
from blendcap.cli.left_out import left_out_in_words
from blendcap.cli.progress import Progress
from blendcap.data import Camera, InputError, landmarks68
from blendcap.data.names import ARKIT52
from blendcap.io import read_video, write_video
from blendcap.io.cameras import read_cameras, write_cameras
from blendcap.io.models import read_model, write_model
from blendcap.io.turns import read_turns
from blendcap.makeup.classifier import PatchClassifier, RegionModel
from blendcap.makeup.lesson import Lesson
from blendcap.makeup.packing import KIND, VERSION, pack, unpack
from blendcap.makeup.patches import Patches
from blendcap.makeup.setup import HOLD, Setup, _hidden, locate
from blendcap.makeup.stabilization import held
from blendcap.makeup.training import train_classifier
from blendcap.makeup.units import Region
from blendcap.modeling.rays import RayTarget
from blendcap.numerics.resampling import at_times
from blendcap.numerics.similarity import apply
from blendcap.rendering.camera import look_at, project
from blendcap.synthetic.exercises import action_units
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import make_take
from blendcap.view.camera_tiles import TILE
from blendcap.view.patches_film import write_patches_picture
from toy_makeup import REGION, perform

RATE, SIZE = 15.0, (480, 360)
UNITS = ("1+2", "45")
REST = RegionModel(
    Region("brows", (), ("AU4",)), np.zeros((1, 0), dtype=np.float32), np.zeros(1), np.zeros((0, 2), dtype=int),
    np.zeros(2), np.ones((0, 2)), np.zeros(1), np.ones((1, 2)),
)  # fmt: skip
LIDS = ("eyeBlinkLeft", "eyeBlinkRight")


@pytest.fixture(scope="module")
def rig():
    return blendcap.mannequin(1, shapes=52)


@pytest.fixture(scope="module")
def stage(rig, tmp_path_factory) -> Path:
    """A folder with a training take and another one of the same person, filmed by two head cameras."""
    folder = tmp_path_factory.mktemp("stage")
    performer = make_performer(rig, seed=1)
    helmet = mount_head_camera(performer.rig, seed=1, size=SIZE)
    upper = dict(list(zip(helmet.names, helmet.cameras, strict=True)))
    write_cameras(folder / "cameras.json", {name: (camera, SIZE) for name, camera in upper.items()})
    blendcap.write_rig(folder / "rig.glb", rig)
    makeup, worn = draw_makeup(performer.rig, seed=1), rig.points["markers50"]
    places = {name: f"markers50/{name}" for name in worn.names}
    (folder / "places.json").write_text(json.dumps(places), encoding="utf-8")
    for name, repeats, seed in (("lesson", 2, 0), ("test", 1, 5)):
        exercise = action_units(rig, UNITS, rate=RATE, repeats=repeats, seed=seed)
        take, truth = make_take(performer, exercise.animation, worn, seed=2, misplacement=0.0, slip=(1.0, 1.0))
        lead = len(take.positions) - len(exercise.animation.weights)
        blendcap.write_markers(folder / f"{name}.c3d", take)
        blendcap.write_animation(folder / f"{name}.truth.csv", truth.animation)
        rows = [f"{(a + lead) / RATE},{(b + lead) / RATE},AU{unit}" for unit, a, b, _ in exercise.turns]
        (folder / f"{name}.turns.csv").write_text("start,end,unit\n" + "\n".join(rows) + "\n", encoding="utf-8")
        for shot in film_head(truth, helmet, seed=seed, makeup=makeup):
            write_video(folder / f"{name}.{shot.name}.mp4", shot.frames(), RATE, SIZE, loss=8)
    return folder


def staged(films: list, setup: Setup) -> SimpleNamespace:
    """A stage of ready parts."""
    return SimpleNamespace(films=films, setup=lambda _: setup, rig=SimpleNamespace(name="toy", names=ARKIT52))


def videos(folder: Path, name: str) -> list[str]:
    return [str(folder / f"{name}.{camera}.mp4") for camera in read_cameras(folder / "cameras.json")]


def arguments(folder: Path, name: str) -> list[str]:
    return [*videos(folder, name), "--cameras", str(folder / "cameras.json"), "--take", str(folder / f"{name}.c3d"),
            "--rig", str(folder / "rig.glb"), "--correspondences", str(folder / "places.json")]  # fmt: skip


@pytest.mark.slow
def test_videos_that_changed_places_are_told_by_their_pictures(stage, tmp_path, caplog):
    films = [Path(video) for video in videos(stage, "test")]
    unnamed = [shutil.copy(film, tmp_path / f"{k}.mp4") for k, film in enumerate(films)]
    footage = Filmed(cameras=stage / "cameras.json", rig=stage / "rig.glb", correspondences=stage / "places.json")
    read_stage(unnamed, stage / "test.c3d", footage)
    assert "shows the markers where" not in caplog.text
    read_stage(unnamed[::-1], stage / "test.c3d", footage)
    assert caplog.text.count("shows the markers where") == len(films)


@pytest.mark.slow
def test_curves_from_video_make_the_solve_better(stage, rig, capsys):
    model, curves, film = (str(stage / name) for name in ("model.npz", "curves.csv", "overlay.mp4"))
    places = ["--correspondences", str(stage / "places.json"), "--head", "keep"]
    weights = str(stage / "lesson.weights.npz")
    assert main(["solve", str(stage / "lesson.c3d"), "--rig", str(stage / "rig.glb"), *places, "-o", weights]) == 0
    turns = ["--turns", str(stage / "lesson.turns.csv"), "--weights", weights]
    capsys.readouterr()
    assert main(["facs", "train", *arguments(stage, "lesson"), *turns, "-o", model, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["units"] == ["AU1", "AU2L", "AU2R", "AU45L", "AU45R"] and answer["left_out"]["eyes"]["unit"] > 0.9
    picture = str(stage / "overlay.png")
    shown = ["--overlay", film, "--picture", picture]
    assert main(["facs", "predict", *arguments(stage, "test"), "--model", model, "-o", curves, *shown]) == 0
    assert read_video(film).count == read_video(videos(stage, "test")[0]).count
    with Image.open(picture) as image:
        assert image.width == 960
    told, truth = blendcap.read_animation(curves), blendcap.read_animation(stage / "test.truth.csv")
    both = truth.select(told.names)
    blink = told.names.index("eyeBlinkLeft")
    assert np.corrcoef(told.weights[:, blink], both.weights[:, blink])[0, 1] > 0.9
    take, late = blendcap.read_markers(stage / "test.c3d"), 7 / (2 * RATE)
    doubled = at_times(take.positions, RATE, np.arange(2 * len(take.positions)) / (2 * RATE) - late)
    blendcap.write_markers(stage / "fast.c3d", replace(take, positions=doubled, rate=2 * RATE, residuals=None))
    fast = [str(stage / "fast.c3d") if word.endswith("test.c3d") else word for word in arguments(stage, "test")]
    again = ["--model", model, "-o", str(stage / "again.csv"), "--offset", str(late)]
    assert main(["facs", "predict", *fast, *again]) == 1  # the last frames are after the take
    assert "reaches from" in capsys.readouterr().err
    doubled = at_times(take.positions, RATE, np.arange(2 * len(take.positions) + 7) / (2 * RATE) - late)
    blendcap.write_markers(stage / "fast.c3d", replace(take, positions=doubled, rate=2 * RATE, residuals=None))
    assert main(["facs", "predict", *fast, *again]) == 0
    np.testing.assert_allclose(blendcap.read_animation(stage / "again.csv").weights, told.weights, atol=0.02)

    capsys.readouterr()
    worn, (_, deltas) = rig.points["markers50"], rig.select(LIDS).sample(rig.points["markers50"])
    still = [name for name, far in zip(worn.names, np.linalg.norm(deltas, axis=2).max(0), strict=True) if far < 1]
    (stage / "bare.json").write_text(json.dumps({name: f"markers50/{name}" for name in still}), encoding="utf-8")
    solve = ["solve", str(stage / "test.c3d"), "--rig", str(stage / "rig.glb"), "--correspondences",
             str(stage / "bare.json"), "--head", "keep"]  # fmt: skip
    assert main([*solve, "-o", str(stage / "alone.npz")]) == 0
    capsys.readouterr()
    assert main([*solve, "--patches", curves, "-o", str(stage / "hybrid.npz"), "--json"]) == 0
    conflict = json.loads(capsys.readouterr().out)["conflict"]
    assert len(conflict["frames"]) == len(conflict["worst_shape"]) == len(truth.weights)
    assert set(conflict["worst_shape"]) <= {*told.names, None} and 0 < max(conflict["frames"]) < 1
    assert {name for name, apart in conflict["shapes"].items() if apart > 0} <= set(told.names)
    true, errors = truth.select(LIDS).weights, []
    for name in ("alone.npz", "hybrid.npz"):
        answer = blendcap.read_animation(stage / name).select(LIDS)
        errors.append(np.sqrt(((answer.weights - true) ** 2).mean()))
    assert errors[1] < 0.5 * errors[0]  # no marker sees the lids


@pytest.mark.slow
def test_paint_that_is_followed_makes_the_solve_better(stage, rig, capsys):
    """No lesson, no machine: the paint itself, from the command line."""
    bare, tracks, picture = (str(stage / name) for name in ("still.json", "tracks.npz", "tracks.png"))
    worn, (_, deltas) = rig.points["markers50"], rig.select(LIDS).sample(rig.points["markers50"])
    still = [name for name, far in zip(worn.names, np.linalg.norm(deltas, axis=2).max(0), strict=True) if far < 1]
    Path(bare).write_text(json.dumps({name: f"markers50/{name}" for name in still}), encoding="utf-8")
    known = ["--rig", str(stage / "rig.glb"), "--correspondences", bare]
    filmed = [*videos(stage, "test"), "--cameras", str(stage / "cameras.json"), "--take", str(stage / "test.c3d")]
    capsys.readouterr()
    assert main(["facs", "track", *filmed, *known, "-o", tracks, "--picture", picture, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert len(answer["points_per_camera"]) == 4 and min(answer["points_per_camera"]) > 50 and answer["found"] > 0.85
    with Image.open(picture) as image:
        assert image.size == (960, 720)
    solve = ["solve", str(stage / "test.c3d"), *known, "--head", "keep", "--json"]
    assert main([*solve, "-o", str(stage / "without.npz")]) == 0
    assert "track_rms_mm" not in json.loads(capsys.readouterr().out)
    report = str(stage / "tracks.html")
    assert main([*solve, "--tracks", tracks, "-o", str(stage / "with.npz"), "--report", report]) == 0
    assert json.loads(capsys.readouterr().out)["track_rms_mm"] < 0.3
    page = Path(report).read_text(encoding="utf-8")
    assert "What the paint changed" in page and "RMS of the tracks" in page and "what the patches say" not in page
    true = blendcap.read_animation(stage / "test.truth.csv").select(LIDS).weights
    errors = [np.sqrt(((blendcap.read_animation(stage / name).select(LIDS).weights - true) ** 2).mean())
              for name in ("without.npz", "with.npz")]  # fmt: skip
    assert errors[1] < 0.5 * errors[0]
    assert main([*solve, "--tracks", str(stage / "lesson.turns.csv"), "-o", str(stage / "none.npz")]) == 1
    assert "lesson.turns.csv" in capsys.readouterr().err and not (stage / "none.npz").exists()


def test_outputs_of_tracks_are_tried_before_the_work(tmp_path, capsys):
    needed = [word for option in ("--cameras", "--rig", "--take") for word in (option, "unused")]
    for words, sentence in (
        (["-o", str(tmp_path / "t.csv")], "its ending must be one of .npz"),
        (["-o", str(tmp_path / "t.npz"), "--overlay", str(tmp_path / "t.gif")], "its ending must be one of .mp4"),
        (["-o", str(tmp_path / "no" / "t.npz")], "does not exist"),
    ):
        assert main(["facs", "track", "unused.mp4", *needed, *words]) == 1
        assert sentence in capsys.readouterr().err


@pytest.fixture
def weak(tmp_path, monkeypatch):
    """Arguments of a prediction from ready patches by a machine that tells a blink as 0.8; the machine, the patches."""
    lesson, shown, _ = perform(repetitions=3)
    region = REGION._replace(units=("AU45", "AU4", "AU9"))
    named = Lesson(np.where(shown.units == "AU1+2", "AU45", shown.units), shown.repetitions)
    trained = train_classifier(lesson, named, regions=[region])
    (model,) = trained.models
    model = replace(model, weights=0.8 * model.weights, offsets=0.8 * model.offsets, scales=np.ones((3, 2)))
    machine = replace(trained, models=[model])
    write_model(tmp_path / "m.npz", KIND, VERSION, *pack(machine))
    monkeypatch.setattr("blendcap.cli.facs.stage", lambda *_: staged([], Setup({}, [], [])))
    monkeypatch.setattr("blendcap.cli.facs.blocks", lambda *_: iter([lesson]))
    needed = [word for option in ("--cameras", "--rig", "--take") for word in (option, "unused")]
    return ["facs", "predict", "unused.mp4", *needed, "--model", str(tmp_path / "m.npz")], machine, lesson


def test_options_of_a_prediction_reach_the_curves(weak, tmp_path, capsys):
    command, machine, patches = weak
    told = []
    for words, choices in (
        ([], {}),
        (["--blinks-as-told"], {"full_blinks": False}),
        (["--shown-only"], {"everywhere": False}),
    ):
        capsys.readouterr()
        assert main([*command, "-o", str(tmp_path / "c.npz"), "--json", *words]) == 0
        told.append(blendcap.read_animation(tmp_path / "c.npz"))
        right = blendcap.classify(machine, patches, **choices)
        np.testing.assert_allclose(told[-1].weights, right.weights, atol=1e-6)
        np.testing.assert_allclose(told[-1].confidence, right.confidence, atol=1e-6)
    trust = json.loads(capsys.readouterr().out)["trusted"]
    assert trust == pytest.approx(dict(zip(told[-1].names, told[-1].confidence.mean(0), strict=True)), abs=1e-6)
    default, as_told, quiet = told
    lids = default.names.index("eyeBlinkLeft")
    assert default.weights[:, lids].max() > 0.93 and 0.7 < as_told.weights[:, lids].max() < 0.85
    assert quiet.confidence[0].max() < 0.05 < default.confidence[0].max()


def test_predictions_do_not_overwrite_what_they_read_and_say_which_shapes_the_rig_lacks(weak, tmp_path, capsys):
    command, *_ = weak
    model = tmp_path / "m.npz"
    before = model.read_bytes()
    assert main([*command, "-o", str(model)]) == 1
    assert "it is an input too" in capsys.readouterr().err and model.read_bytes() == before
    units = unpack(*read_model(model, KIND, VERSION)).units
    table = tmp_path / "t.json"
    table.write_text(json.dumps({unit: {"tail": 1.0} for unit in units}), encoding="utf-8")
    assert main([*command, "-o", str(tmp_path / "c.npz"), "--table", str(table)]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "The rig 'toy' has no shape for what these units move" in said and f"tail ({units[0]})" in said
    for weight in (0, -1, float("nan"), float("inf")):
        table.write_text(json.dumps({"AU4": {"browDownLeft": weight}}), encoding="utf-8")
        assert main([*command, "-o", str(tmp_path / "c.npz"), "--table", str(table)]) == 1
        said = " ".join(capsys.readouterr().err.split())
        assert 'their weights above 0, such as {"AU4": {"browLower_L": 1.0}}; leave' in said


def test_the_threshold_reaches_the_patches_and_wrong_turns_and_features_do_not(tmp_path, monkeypatch, capsys):
    film = SimpleNamespace(count=3, size=SIZE, rate=RATE, frames=lambda grey: iter([]))
    monkeypatch.setattr("blendcap.cli.facs.stage", lambda *_: staged([film], Setup({}, [np.zeros((0, 2))], [])))
    (tmp_path / "t.csv").write_text("start,end,unit\n0,0.2,AU4\n", encoding="utf-8")
    (tmp_path / "late.csv").write_text("start,end,unit\n0,3,AU4\n", encoding="utf-8")
    common = [word for option in ("--cameras", "--rig", "--take") for word in (option, "unused")]
    common += ["-o", str(tmp_path / "o.npz"), "--threshold", "-1"]
    assert main(["facs", "train", "v.mp4", *common, "--turns", str(tmp_path / "late.csv")]) == 1
    said = capsys.readouterr()
    assert "ends after the lesson, which lasts until 0.2 s" in said.err and "Cut the patches" not in said.out + said.err
    (tmp_path / "foreign.csv").write_text("start,end,unit\n0,0.2,AU99\n", encoding="utf-8")
    assert main(["facs", "train", "v.mp4", *common, "--turns", str(tmp_path / "foreign.csv")]) == 1
    said = capsys.readouterr()
    assert "it shows AU99." in said.err and "Cut the patches" not in said.out + said.err
    assert main(["facs", "train", "v.mp4", *common, "--turns", str(tmp_path / "t.csv")]) == 1
    said = capsys.readouterr()
    assert "shows each unit only once" in said.err and "Cut the patches" not in said.out + said.err
    (tmp_path / "t.csv").write_text("start,end,unit\n0,0.08,AU4\n0.1,0.2,AU4\n", encoding="utf-8")
    strange = blendcap.Animation(np.ones((3, 1)), ("tail",), RATE)
    blendcap.write_animation(tmp_path / "w.npz", strange)
    weighed = ["--turns", str(tmp_path / "t.csv"), "--weights", str(tmp_path / "w.npz")]
    assert main(["facs", "train", "v.mp4", *common, *weighed]) == 1
    said = capsys.readouterr()
    assert "tell of none of its units (AU4L, AU4R)" in said.err and "Cut the patches" not in said.out + said.err
    lost = [*common[:-4], "-o", weighed[-1]]
    assert main(["facs", "train", "v.mp4", *lost, *weighed]) == 1
    assert "w.npz: it is an input too" in capsys.readouterr().err
    assert main(["facs", "train", "v.mp4", *common, "--turns", "unused", "--warps", "-1"]) == 1
    assert "--warps is -1, but must be 0 or more" in capsys.readouterr().err
    assert main(["facs", "train", "v.mp4", *common, "--turns", "unused", "--features", "gabbor"]) == 1
    assert "The features 'gabbor' are unknown" in capsys.readouterr().err
    assert main(["facs", "train", "v.mp4", *common, "--turns", str(tmp_path / "t.csv")]) == 1
    assert "The threshold of paint is -1, but must be 0 or more" in capsys.readouterr().err
    write_model(tmp_path / "m.npz", KIND, VERSION, *pack(PatchClassifier([REST], {})))
    assert main(["facs", "predict", "v.mp4", *common, "--model", str(tmp_path / "m.npz")]) == 1
    assert "The threshold of paint is -1, but must be 0 or more" in capsys.readouterr().err


@pytest.mark.parametrize(("lost", "said"), [(0, False), (3, False), (4, True)])
def test_lost_still_points_are_said(monkeypatch, caplog, lost, said):
    sure = np.ones(30)
    sure[10 : 10 + lost] = 0.4
    cut = [Patches({}, RATE, part, {}) for part in np.split(sure, 2)]
    monkeypatch.setattr("blendcap.makeup.patches.each_block", lambda *_, **__: iter(cut))
    film = SimpleNamespace(count=30, size=SIZE, rate=RATE, frames=lambda grey: iter([]))
    assert len(list(blocks([film], Setup({}, [], []), None, Progress(quiet=True)))) == 2  # pyright: ignore[reportArgumentType]
    assert (f"In {lost} of 30 frames half of the markers that hold the picture still" in caplog.text) == said


def test_a_trained_machine_says_its_shares_in_words():
    scores = {"unit": 0.99, "unit, all frames": 0.9, "unit and intensity": 0.5}
    answers, frames = ("rest", "AU4"), np.array([[98, 2], [1, 9]])
    eyes = replace(REST, region=REST.region._replace(name="eyes"), scores=scores, answers=answers, confusion=frames)
    mouth = replace(eyes, region=eyes.region._replace(name="mouth"), scores=scores | {"unit": 0.25}, answers=())
    assert left_out_in_words(PatchClassifier([eyes, mouth], {})) == {
        "left_out": "eyes 99% of the clear frames told right, 90% of all, 50% with the intensity, within 0.25; "
        "mouth 25% of the clear frames told right, 90% of all, 50% with the intensity, within 0.25",
        "mixed_up": "AU4 told as rest in 1 of 10 frames",  # 2 % of the frames of rest are no more than 2 %
    }
    right = replace(eyes, confusion=np.diag([98, 9]))
    assert left_out_in_words(PatchClassifier([right], {}))["mixed_up"] == "no unit in more than 2% of its frames"
    assert left_out_in_words(PatchClassifier([mouth], {}))["mixed_up"] == "not counted; train anew"


def test_cameras_come_back_from_their_file(tmp_path):
    camera = Camera([[500, 0, 320], [0, 510, 240], [0, 0, 1]], look_at([10, 20, 300], [0, 0, 0]), [0.1, 0.2, 0, 0, 0.3])
    write_cameras(tmp_path / "c.json", {"left": (camera, (640, 480))})
    ((name, (again, size)),) = read_cameras(tmp_path / "c.json").items()
    assert (name, size) == ("left", (640, 480))
    for part in ("intrinsics", "pose", "distortion"):
        np.testing.assert_array_equal(getattr(again, part), getattr(camera, part))


def test_cameras_may_stand_in_metres(tmp_path):
    camera = Camera([[500, 0, 320], [0, 510, 240], [0, 0, 1]], look_at([10, 20, 300], [0, 0, 0]))
    write_cameras(tmp_path / "c.json", {"left": (camera, (640, 480))})
    content = json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))
    for row in content["cameras"][0]["pose"][:3]:
        row[3] /= 1000
    (tmp_path / "c.json").write_text(json.dumps(content | {"unit": "m"}), encoding="utf-8")
    np.testing.assert_allclose(read_cameras(tmp_path / "c.json")["left"][0].pose, camera.pose)


def test_videos_in_another_order_than_the_cameras_are_refused():
    camera = Camera([[500, 0, 320], [0, 510, 240], [0, 0, 1]], look_at([10, 20, 300], [0, 0, 0]))
    cameras = {name: (camera, SIZE) for name in ("upper_right", "upper_left")}
    films = [SimpleNamespace(path=Path(f"take.{name}.mp4"), size=SIZE, rate=RATE, count=9) for name in cameras]
    _check_films(films, cameras)
    with pytest.raises(
        InputError, match=r"take\.upper_left\.mp4 stands where .* 'upper_right' should.*the cameras: upper_r"
    ):
        _check_films(films[::-1], cameras)


def test_showings_are_told_from_the_take_also_if_the_film_begins_later(tmp_path, monkeypatch):
    film = SimpleNamespace(count=30, size=SIZE, rate=RATE)
    monkeypatch.setattr("blendcap.cli.facs.stage", lambda *_: staged([film], Setup({}, [], [])))
    (tmp_path / "t.csv").write_text("start,end,unit\n2,2.2,AU4\n", encoding="utf-8")
    footage = Footage(Path(), Path(), offset=1.0)
    _, _, lesson = _lesson([], Path(), tmp_path / "t.csv", None, footage, Progress(quiet=True))
    assert np.flatnonzero(lesson.units == "AU4").tolist() == [15, 16, 17]


def test_a_take_is_told_at_the_frames_of_its_film():
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(size=(9, 2, 3)), axis=0)
    path[4, 1] = np.nan
    between = (path[:-1] + path[1:]) / 2
    fast = np.empty((17, 2, 3))
    fast[::2], fast[1::2] = path, between
    take = blendcap.MarkerTake(np.concatenate([np.zeros((5, 2, 3)), fast]), ("a", "b"), 2 * RATE)
    film = SimpleNamespace(path=Path("v.mp4"), rate=RATE, count=9)
    told = Footage(Path(), Path(), offset=5 / (2 * RATE)).take_of(film, take)
    assert told.rate == RATE
    np.testing.assert_allclose(told.positions, path)
    with pytest.raises(InputError, match=r"has 9 frames at 15 a second, but the take 22 at 30; say by --offset how"):
        Footage(Path(), Path()).take_of(film, take)
    with pytest.raises(InputError, match=r"With --offset 9 v\.mp4 reaches from 9\.00 to 9\.53 s of the take"):
        Footage(Path(), Path(), offset=9.0).take_of(film, take)
    with pytest.raises(InputError, match="cut both to the same frames, at the rate of the film"):
        Filmed(Path(), Path()).take_of(film, take)
    solved = blendcap.Animation(take.positions[:, 0], ("x", "y", "z"), 2 * RATE, confidence=np.ones((22, 3)))
    weights = weights_at_frames(film, solved, 5 / (2 * RATE))  # pyright: ignore[reportArgumentType]
    assert weights.rate == RATE and weights.confidence is not None
    np.testing.assert_allclose(weights.weights, path[:, 0])
    for late in (0.0, 1.0):  # too long without an offset, and too short
        with pytest.raises(
            InputError, match=r"The weights last 0\.73 s, but the lesson's film ends at [01]\.60 s; give"
        ):
            weights_at_frames(film, solved, late)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="With --offset nan"):
        Footage(Path(), Path(), offset=float("nan")).take_of(film, take)
    nearly = blendcap.Animation(path[:, 0], ("x", "y", "z"), 0.999 * RATE)  # as 29.97 is to 30: frame by frame
    assert weights_at_frames(film, nearly, 0.0) is nearly  # pyright: ignore[reportArgumentType]
    same = blendcap.MarkerTake(path, ("a", "b"), RATE)
    assert Footage(Path(), Path()).take_of(film, same) is same is Filmed(Path(), Path()).take_of(film, same)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (
            '{"cameras": [{"name": "a", "size": [4, 4], "intrinsics": [], "pose": []}], "unit": "ell"}',
            "'ell', which is",
        ),
        ('{"cameras": []}', 'list "cameras" that is not empty'),
        ('{"cameras": [{"name": "a", "size": [0, 4], "intrinsics": [], "pose": []}]}', "0 x 4 pixels, which cannot be"),
        ('{"cameras": [{"name": "a", "size": [4, 4]}]}', "intrinsics"),
    ],
)
def test_camera_files_that_are_wrong_are_refused(tmp_path, content, sentence):
    (tmp_path / "c.json").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_cameras(tmp_path / "c.json")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("start,stop,unit\n0,1,AU4\n", "no column 'end'"),
        ("start,end,unit\n2,1,AU4\n", "Row 1 of .* is from 2 to 1 s; a showing must take time"),
        ("start,end,unit\n", "row|showing"),
    ],
)
def test_turns_that_are_wrong_are_refused(tmp_path, content, sentence):
    (tmp_path / "t.csv").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_turns(tmp_path / "t.csv")


def test_turns_are_read_in_order(tmp_path):
    (tmp_path / "t.csv").write_text("start,end,unit,note\n0.5,1.5,AU4,weak\n2,3,AU1+2,\n", encoding="utf-8")
    assert read_turns(tmp_path / "t.csv") == [(0.5, 1.5, "AU4"), (2.0, 3.0, "AU1+2")]


@pytest.fixture
def bound(rig):
    worn = rig.points["markers50"]
    take, _ = make_take(
        make_performer(rig, seed=1, strength=0.0), blendcap.Animation(np.zeros((3, len(rig.names))), rig.names, 30.0),
        worn, seed=0, noise=0.0, misplacement=0.0, slip=(0.0, 0.0), occlusion=0.0,
    )  # fmt: skip
    return take, blendcap.bind(rig, take, worn, method="given")


def test_patches_and_dots_are_found_by_the_markers(rig, bound):
    take, binding = bound
    helmet = mount_head_camera(rig, seed=1)
    stable = [n for n in take.names if np.abs(rig.sample(rig.points["markers50"].select([n]))[1]).max() < 3][:12]
    setup = locate(rig, take, binding, helmet.cameras, [helmet.size] * 4, stable)
    assert {camera for camera, _ in setup.places.values()} <= {0, 1, 2, 3} and "eye_left" in setup.places
    assert helmet.names[setup.places["eye_left"][0]].endswith("left")
    for camera, dots, anchors in zip(helmet.cameras, setup.dots, setup.anchors, strict=True):
        pixels, _ = project(take.positions[0], camera)
        np.testing.assert_allclose(dots[0], pixels, atol=1e-9)
        for anchor in anchors:
            assert np.linalg.norm(pixels - anchor, axis=1).min() < 1e-6
    with pytest.raises(InputError, match="stable marker 'nobody' is not bound"):
        locate(rig, take, binding, helmet.cameras, [helmet.size] * 4, ["nobody"])
    with pytest.raises(InputError, match=r"sees \d of the stable markers"):
        locate(rig, take, binding, helmet.cameras, [helmet.size] * 4, stable[:1])


def test_without_names_the_head_s_pose_holds_the_pictures_still(rig, bound):
    take, binding = bound
    helmet = mount_head_camera(rig, seed=1)
    weights = np.zeros((4, len(rig.names)))
    weights[1:, rig.index("jawOpen")], weights[2:, rig.index("browInnerUp")] = 0.5, 1.0
    rest, deltas = rig.sample(binding.points)
    turns = Rotation.from_rotvec([[0, 0, 0], [0.02, 0, 0], [0, -0.03, 0.02], [0.01, 0.02, 0.03]]).as_matrix()
    shifts = np.array([[0, 0, 0], [1.0, 2, 0], [-2, 0, 3], [0, 4, 0]])
    moved = apply(binding.to_take(rest + np.tensordot(weights, deltas, axes=1)), turns, shifts)
    moved[1, :5], moved[3] = np.nan, np.nan  # gaps, and a frame in which nothing is seen
    whole = replace(take, positions=moved)
    setup = locate(rig, whole, binding, helmet.cameras, [helmet.size] * 4)
    head = apply(binding.to_take(landmarks68(rig).positions(rig.mesh)[list(HOLD)]), turns, shifts)
    for camera, anchors in zip(helmet.cameras, setup.anchors, strict=True):
        true, _ = project(head, camera)
        assert np.isnan(anchors[3]).all()
        assert np.abs(anchors[:3] - true[:3]).max() < 0.5 < np.abs(true[1:3] - true[0]).max()
        stabilizer = held(np.zeros((480, 640), np.uint8), anchors)
        ways = [stabilizer.follow(np.zeros((480, 640), np.uint8)) for _ in range(4)]
        assert [sure for _, sure in ways] == [1, 1, 1, 0]
        np.testing.assert_array_equal(ways[3][0], ways[2][0])  # the last known place
        for (matrix, _), there in zip(ways[:3], anchors[:3], strict=True):
            assert np.std(anchors[0] @ matrix[:, :2].T + matrix[:, 2] - there) < 2  # a head is not flat


def test_a_first_frame_without_markers_holds_no_picture_still(rig, bound):
    take, binding = bound
    helmet = mount_head_camera(rig, seed=1)
    blind = take.positions.copy()
    blind[0, 2:] = np.nan
    with pytest.raises(InputError, match="first frame has fewer than 3 of the markers"):
        locate(rig, replace(take, positions=blind), binding, helmet.cameras, [helmet.size] * 4)


def test_the_dot_of_a_missing_marker_is_still_in_the_picture(rig, bound):
    take, binding = bound
    helmet = mount_head_camera(rig, seed=1)
    sizes = [helmet.size] * 4
    whole = locate(rig, take, binding, helmet.cameras, sizes).dots[0]
    holed = take.positions.copy()
    holed[1, 3] = holed[2, 4] = holed[:, 5] = np.nan
    dots = locate(rig, replace(take, positions=holed), binding, helmet.cameras, sizes).dots[0]
    np.testing.assert_allclose(dots[:, :5], whole[:, :5], atol=1e-9)  # the face keeps still
    assert np.isnan(dots[:, 5]).all()


def test_a_marker_behind_the_nose_holds_no_picture_still(rig, bound, monkeypatch):
    take, binding = bound
    nose = landmarks68(rig).select(("30",)).positions(rig.mesh)[0]
    places = binding.points.positions(rig.mesh)
    eye, there = binding.to_take(nose + np.array([260.0, 0, 40])), binding.to_take(nose)
    side = Camera([[400, 0, 320], [0, 400, 240], [0, 0, 1]], look_at(eye, there))
    face = RayTarget(binding.to_take(rig.mesh.vertices), rig.mesh.faces)
    hidden = _hidden(binding.to_take(places), side, face)
    assert hidden[places[:, 0] < -40].all() and not hidden[places[:, 0] > 40].any()  # the far cheek, and the near one

    helmet = mount_head_camera(rig, seed=1)
    sizes = [helmet.size] * 4
    before = locate(rig, take, binding, helmet.cameras, sizes, take.names).anchors[0]
    pixels, _ = project(take.positions[0], helmet.cameras[0])
    stillest = int(np.linalg.norm(pixels - before[0], axis=1).argmin())
    monkeypatch.setattr("blendcap.makeup.setup._hidden", lambda points, *_: np.arange(len(points)) == stillest)
    after = locate(rig, take, binding, helmet.cameras, sizes, take.names).anchors[0]
    assert np.linalg.norm(after - before[0], axis=1).min() > 1


@pytest.mark.parametrize(
    ("factor", "sentence"),
    [(0.001, '1000 times as long.*"unit": "m"'), (0.1, '10 times as long.*"cm"'), (1 / 25.4, '25.4 times.*"in"'),
     (10, '0.1 times.*"mm"'), (1000, '0.001 times as long: .*"mm"')],
)  # fmt: skip
def test_cameras_in_another_unit_are_named_and_not_the_paint(rig, bound, factor, sentence):
    take, binding = bound
    helmet, cameras = mount_head_camera(rig, seed=1), []
    for camera in helmet.cameras:
        pose = camera.pose.copy()
        pose[:3, 3] *= factor
        cameras.append(replace(camera, pose=pose))
    with pytest.raises(InputError, match=f"The cameras see no face where the markers are, but would.* {sentence}"):
        locate(rig, take, binding, cameras, [helmet.size] * 4, [])


def test_cameras_that_look_elsewhere_are_not_taken_for_another_unit(rig, bound):
    take, binding = bound
    away = Camera([[400, 0, 320], [0, 400, 240], [0, 0, 1]], look_at([0, 0, 300], [0, 0, 900]))
    with pytest.raises(InputError, match="No camera has the patch 'forehead_right' in its picture"):
        locate(rig, take, binding, [away], [(640, 480)], [])


def test_video_of_another_length_is_refused(rig, bound, tmp_path, capsys):
    take, _ = bound
    helmet = mount_head_camera(rig, seed=1, size=(64, 48))
    write_cameras(tmp_path / "c.json", {helmet.names[0]: (helmet.cameras[0], (64, 48))})
    blendcap.write_markers(tmp_path / "t.c3d", take)
    blendcap.write_rig(tmp_path / "r.glb", rig)
    write_video(tmp_path / "v.mp4", [np.zeros((48, 64), dtype=np.uint8)] * 7, 30.0, (64, 48))
    (tmp_path / "t.csv").write_text("start,end,unit\n0,1,AU4\n", encoding="utf-8")
    files = {"--cameras": "c.json", "--take": "t.c3d", "--rig": "r.glb", "--turns": "t.csv", "-o": "m.npz"}
    common = [word for option, name in files.items() for word in (option, str(tmp_path / name))]
    assert main(["facs", "train", str(tmp_path / "v.mp4"), *common]) == 1
    assert "has 7 frames at 30 a second, but the take" in capsys.readouterr().err
    assert main(["facs", "train", *[str(tmp_path / "v.mp4")] * 2, *common]) == 1
    assert "Videos: 2; cameras: 1 (" in capsys.readouterr().err
    twice = ["--take", str(tmp_path / "t.c3d")]
    assert main(["facs", "train", *[str(tmp_path / "v.mp4")] * 2, *common, *twice]) == 1
    assert "Takes: 2; turns: 1; weights: 0; videos: 2. Give turns for each take" in capsys.readouterr().err
    assert not (tmp_path / "m.npz").exists()


def test_small_films_are_drawn_large_and_the_picture_is_of_the_frame_that_shows_most(tmp_path):
    corners = np.array([[10.0, 12.0], [40.0, 12.0], [40.0, 36.0], [10.0, 36.0]])
    setup = Setup({"eye_right": (0, corners)}, [np.zeros((0, 2))] * 2, [np.zeros((3, 0, 2))] * 2)
    curves = blendcap.Animation([[0.1, 0.0], [0.9, 0.5], [0.2, 0.0]], ("eyeBlinkLeft", "browInnerUp"), 30.0)
    films = [[np.full((48, 64), 40 * t, dtype=np.uint8) for t in range(3)] for _ in range(2)]
    assert write_patches_picture(tmp_path / "p.png", films, setup, curves) == 1
    with Image.open(tmp_path / "p.png") as image:
        picture = np.asarray(image).astype(int)
    assert picture.shape[1] == 2 * TILE and (picture[300, 450] == 40).all()  # the second frame
    drawn = np.ptp(picture[:360], axis=2) > 60
    rows, columns = np.flatnonzero(drawn[:, 72:TILE].any(1)), np.flatnonzero(drawn.any(0))
    scale = TILE / 64
    assert abs(rows.max() - 36 * scale) < 3 and abs(columns.max() - 40 * scale) < 3  # the patch, at the films' scale
