"""What `info` says of files that are no rig, mesh, take or animation."""

import numpy as np
import pytest

from blendcap import InputError, mannequin
from blendcap.data import Camera
from blendcap.io import describe, write_correspondences, write_points, write_video
from blendcap.io.cameras import write_cameras
from blendcap.io.models import write_model


def test_a_video_says_how_long_it_is(tmp_path):
    write_video(tmp_path / "film.mp4", (np.zeros((40, 60, 3), np.uint8) for _ in range(12)), 24.0, (60, 40))
    facts = describe(tmp_path / "film.mp4")
    assert facts == {"kind": "video", "frames": 12, "rate": 24.0, "seconds": 0.5, "size": [60, 40], "unit": "pixels"}


def test_notes_beside_a_take_are_told_apart(tmp_path):
    rig = mannequin(shapes=52)
    points = rig.points["landmarks68"].select(("30", "8"))
    camera = Camera(np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]]), np.eye(4))
    write_cameras(tmp_path / "cameras.json", {"upper": (camera, (640, 480))})
    write_points(tmp_path / "points.json", points, rig.name)
    write_correspondences(tmp_path / "places.json", points)
    assert describe(tmp_path / "cameras.json") == {"kind": "cameras", "cameras": {"upper": [640, 480]}}
    assert describe(tmp_path / "points.json") == {"kind": "points", "rig": rig.name, "points": ["30", "8"]}
    assert describe(tmp_path / "places.json") == {"kind": "places", "markers": ["30", "8"]}


def test_turns_say_how_often_each_unit_is_shown(tmp_path):
    (tmp_path / "t.csv").write_text("start,end,unit,who\n1,2,AU4,A\n7.5,9.5,AU4,A\n3,4,AU45L,A\n", encoding="utf-8")
    units = {"AU4": 2, "AU45L": 1}
    assert describe(tmp_path / "t.csv") == {"kind": "turns", "showings": 3, "seconds": 9.5, "units": units}


def test_a_model_says_what_it_is_of(tmp_path):
    write_model(tmp_path / "units.npz", "patch classifier", 3, {}, {"means": np.zeros(4)})
    facts = describe(tmp_path / "units.npz")
    assert (facts["kind"], facts["of"], facts["version"]) == ("model", "patch classifier", 3)
    assert "means" in facts["arrays"] and "units" not in facts
    write_model(tmp_path / "units.npz", "patch classifier", 3, {"units": ("AU4", "AU45L")}, {"means": np.zeros(4)})
    assert describe(tmp_path / "units.npz")["units"] == ["AU4", "AU45L"]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [("[]", "must be a JSON object"), ('{"cameras": []}', 'list "cameras" that is not empty'), ("{", "JSON")],
)
def test_other_notes_are_refused(tmp_path, content, sentence):
    (tmp_path / "notes.json").write_text(content)
    with pytest.raises(InputError, match=sentence):
        describe(tmp_path / "notes.json")
