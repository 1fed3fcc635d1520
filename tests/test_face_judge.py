"""Detectors that never saw our faces find them: OpenCV's cascade, and MediaPipe in an environment of its own."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

BENCHMARKS = str(Path(__file__).resolve().parent.parent / "benchmarks")


@pytest.fixture
def judge(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import face_judge

    return face_judge


def test_a_cascade_of_1_finds_the_mannequin(judge):
    cascade = cv2.CascadeClassifier(cv2.data.haarcascades + "haarcascade_frontalface_default.xml")
    for seed in (1, 4):
        for frame in judge.frames_of(judge.people("mannequin", seed), "mannequin", seed, ("neutral", "smile"))[::2]:
            grey = cv2.cvtColor(frame.picture, cv2.COLOR_RGB2GRAY)
            boxes = cascade.detectMultiScale(grey, minSize=(120, 120))
            middle = frame.truth[27:68].mean(0)
            assert any(x < middle[0] < x + w and y < middle[1] < y + h for x, y, w, h in boxes)
    assert not len(cascade.detectMultiScale(np.full((480, 480), 128, np.uint8), minSize=(120, 120)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mannequin", "ICT-FaceKit"])
def test_face_mesh_finds_faces_and_features(judge, data, kind):
    if sys.version_info[:2] > (3, 12):
        pytest.skip("MediaPipe 0.10.21 has no wheel for this Python")
    try:
        judge.environment()
    except RuntimeError as error:
        pytest.skip(str(error))
    pack = data("rigs/ict_facekit.npz") if kind == "ICT-FaceKit" else None
    frames = []
    for seed in (2, 5, 9):
        frames += judge.frames_of(judge.people(kind, seed, pack), kind, seed, ("neutral", "smile", "open", "frown"))
    points = judge.judged([frame.picture for frame in frames])
    found = judge.report(frames, judge.errors(frames, points))
    assert found["frontal found"] >= 99 and found["turned found"] >= 95
    assert found["comparable, all"] < 3.3
    moved = judge.errors(frames, points + 10)  # the measure does see ten pixels
    assert judge.report(frames, moved)["comparable"] > found["comparable"] + 1
