"""Detectors that never saw our faces find them: OpenCV's cascade, and MediaPipe in an environment of its own."""

import sys

import cv2
import numpy as np
import pytest


@pytest.fixture
def judge(benchmark_module):
    return benchmark_module("face_judge")


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
    assert found["found"][0] >= 99 and found["found"][1] >= 95
    assert max(found["all but jaw, brows and nose tip"]) < 3.3
    assert judge.report(frames, judge.errors_across_lines(frames, points))["all but the nose tip"][2] < 3.3
    assert max(judge.report(frames, judge.errors_without_offsets(frames, points))["all but the nose tip"]) < 3.3


def test_a_constant_step_in_the_face_is_taken_away_and_no_other(judge, monkeypatch):
    """A step in space, seen by cameras of any yaw: fitted on other people, it leaves nothing; what differs stays."""
    monkeypatch.setattr(judge, "FACEMESH", np.arange(136).reshape(68, 2))  # vertices of their own for each landmark
    rng = np.random.default_rng(4)
    steps, places = rng.normal(scale=0.05, size=(68, 3)), rng.normal(size=(68, 3))
    frames, points, none = [], [], np.empty(0)
    for person in range(4):
        for yaw in (-0.4, 0.0, 0.4):
            turn = np.array([[np.cos(yaw), 0], [0, -1], [-np.sin(yaw), 0]])  # pictures have y down
            truth = 100 * (places + 0.1 * rng.normal(size=places.shape)) @ turn
            span = np.linalg.norm(truth[36] - truth[45]) / np.cos(yaw)
            frames.append(judge.Frame("any", person, "neutral", yaw, none, truth))
            points.append(np.zeros((478, 2)))
            points[-1][judge.FACEMESH] = (truth + span * steps @ turn)[:, None]
    points = np.array(points)
    assert judge.errors(frames, points).mean() > 0.04
    assert judge.errors_without_offsets(frames, points).max() < 1e-9
    points[3:6, judge.FACEMESH[30]] += 20.0  # one person's nose
    away = judge.errors_without_offsets(frames, points)
    assert away[3:6, 30].min() > 0.01 and np.delete(away, 30, axis=1).max() < 1e-9
    points[0] = np.nan
    assert np.isnan(judge.errors_without_offsets(frames, points)[0]).all()
    assert np.isfinite(judge.errors_without_offsets(frames, points)[1:]).all()


def test_along_jaw_and_brows_a_point_may_lie_anywhere_on_the_line(judge, monkeypatch):
    monkeypatch.setattr(judge, "FACEMESH", np.arange(136).reshape(68, 2))
    truth = np.random.default_rng(5).normal(size=(68, 2))
    truth[:17] = np.stack([np.linspace(0, 160, 17), 50 * np.ones(17)], 1)  # a straight jaw
    truth[[36, 45]] = (0, 0), (100, 0)
    frame = judge.Frame("any", 0, "neutral", 0.0, np.empty(0), truth)

    def away(step: tuple[float, float], mark: int, measure=judge.errors_across_lines) -> float:
        points = np.zeros((1, 478, 2))
        points[0, judge.FACEMESH] = truth[:, None]
        points[0, judge.FACEMESH[mark]] += step
        return float(measure([frame], points)[0, mark])

    assert away((4, 0), 8) == pytest.approx(0, abs=1e-12) and away((4, 0), 8, judge.errors) == pytest.approx(0.04)
    assert away((4, -3), 8) == pytest.approx(0.03)
    assert away((10, 0), 16) == pytest.approx(0.10)  # beyond the end of the line
    assert away((3, 4), 40) == pytest.approx(0.05)  # an eye is no line
