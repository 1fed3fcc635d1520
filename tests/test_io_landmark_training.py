"""Folders of annotated pictures, and detectors in files."""

import json

import numpy as np
import pytest

from blendcap.data import InputError
from blendcap.io import read_annotated, read_landmark_model, write_landmark_model
from blendcap.io.images import write_image
from blendcap.modeling.landmark_training import train_landmarks


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(0)
    boxes = {}
    for k in range(4):
        picture = np.full((64, 80, 3), 90, dtype=np.uint8)
        x, y = rng.integers(20, 40, 2)
        picture[y - 3 : y + 4, x - 8 : x + 9] = 200
        write_image(tmp_path / f"face{k}.png", picture)
        boxes[f"face{k}.png"] = {"nose_tip": [int(x) - 4, int(y) - 4, 9, 9]}
    (tmp_path / "rectangles.json").write_text(json.dumps(boxes))
    return tmp_path


def test_a_folder_trains_a_detector_that_survives_its_file(folder):
    images, rectangles = read_annotated(folder)
    assert [image.shape for image in images] == [(64, 80, 3)] * 4
    model = train_landmarks(images, rectangles)
    write_landmark_model(folder / "own.npz", model)
    again = read_landmark_model(folder / "own.npz")
    assert again.names == ("nose_tip",) and tuple(again.size) == (80, 64)
    np.testing.assert_allclose(again.filters, model.filters, atol=1e-3)
    for name in ("good", "bad", "mean", "covariance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))


def test_what_is_wrong_in_a_folder_is_said(folder):
    path = folder / "rectangles.json"
    whole = path.read_text()
    path.write_text("[]")
    with pytest.raises(InputError, match="must be"):
        read_annotated(folder)
    path.write_text(whole.replace("face2.png", "../face2.png"))
    with pytest.raises(InputError, match="put it into this folder"):
        read_annotated(folder)
    path.write_text(whole)
    (folder / "face1.png").write_bytes(b"nothing")
    with pytest.raises(InputError, match="it is no picture; save it as PNG or JPEG"):
        read_annotated(folder)
    with pytest.raises(InputError, match="no such file"):
        read_annotated(folder / "elsewhere")
    np.savez(folder / "other.npz", meta=np.array('{"kind": "rig"}'))
    with pytest.raises(InputError, match="holds no landmark model"):
        read_landmark_model(folder / "other.npz")
