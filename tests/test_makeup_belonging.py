"""Videos that stand where others should are told by the dots in their first frames."""

import logging

import cv2
import numpy as np
import pytest

from blendcap.data import Camera
from blendcap.makeup.belonging import check_belonging
from blendcap.rendering import project

NAMES = ("upper", "lower", "side")


@pytest.fixture
def scene():
    """Markers (40, 3), three cameras before them, and what each sees: skin with its grain, and white dots."""
    rng = np.random.default_rng(0)
    markers = rng.uniform(-60, 60, (40, 3)) * [1, 1, 0.3]
    cameras = []
    for turn in (-0.2, 0.15, 0.4):
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(np.array([turn, turn / 2, 0]))[0]
        pose[2, 3] = 300
        cameras.append(Camera(np.array([[600, 0, 320], [0, 600, 240], [0, 0, 1.0]]), pose))
    pictures = []
    for camera in cameras:
        picture = rng.normal(110, 6, (480, 640)).astype(np.uint8)
        for x, y in project(markers, camera)[0]:
            cv2.circle(picture, (round(x), round(y)), 4, 220, -1)
        pictures.append(picture)
    return markers, cameras, pictures


def said(caplog, pictures, markers, cameras) -> str:
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        check_belonging(pictures, markers, cameras, NAMES[: len(cameras)])
    return caplog.text


def test_videos_in_their_order_are_taken_in_silence_with_gaps_and_with_dark_dots(scene, caplog):
    markers, cameras, pictures = scene
    assert not said(caplog, pictures, markers, cameras)
    assert not said(caplog, [255 - picture for picture in pictures], markers, cameras)
    assert not said(caplog, pictures[:1], markers, cameras[:1])
    markers[::3] = np.nan
    assert not said(caplog, pictures, markers, cameras)


def test_two_videos_that_changed_places_are_both_named(scene, caplog):
    markers, cameras, (upper, lower, side) = scene
    text = said(caplog, [upper, side, lower], markers, cameras)
    assert "camera 'lower' shows the markers where the camera 'side' would" in text
    assert "camera 'side' shows the markers where the camera 'lower' would" in text
    assert "camera 'upper' shows" not in text


def test_where_no_dots_show_nothing_is_said(scene, caplog):
    markers, cameras, pictures = scene
    plain = [np.random.default_rng(k).normal(110, 6, (480, 640)).astype(np.uint8) for k in range(3)]
    assert not said(caplog, plain, markers, cameras)
    assert not said(caplog, [np.zeros_like(picture) for picture in pictures], markers, cameras)
