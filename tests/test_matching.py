"""Windows of one picture found again in another: by known shifts, light and warp."""

import cv2
import numpy as np
import pytest

from blendcap.makeup.matching import REACH, Windows

SIZE = 96
PLACES = np.array([[30.0, 40.0], [60.0, 33.0], [48.0, 62.0]])
STILL = np.tile(np.eye(2), (3, 1, 1))


def texture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A smooth pattern that is known between the pixels, too."""
    waves = ((0.31, 0.12, 0.3), (-0.17, 0.42, 1.1), (0.23, 0.27, 2.0), (0.05, -0.36, 0.7))
    return (100 + sum(20 * np.sin(a * x + b * y + c) for a, b, c in waves)).astype(np.float32)


def picture(matrix=((1, 0), (0, 1)), shift=(0, 0)) -> np.ndarray:
    """The pattern as it looks when each place p of it has gone to `matrix (p - middle) + middle + shift`."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(np.float64)
    middle = np.array([SIZE / 2, SIZE / 2])
    back = (np.stack([x, y], axis=-1) - middle - shift) @ np.linalg.inv(np.array(matrix)).T + middle
    return texture(back[..., 0], back[..., 1])


def test_shifts_are_found_to_a_hundredth_of_a_pixel():
    windows = Windows.cut(picture(), PLACES)
    for shift in ((0.0, 0.0), (0.37, -0.81), (-2.6, 1.9)):
        places, correlation = windows.find(picture(shift=shift), PLACES, STILL)
        np.testing.assert_allclose(places, PLACES + shift, atol=0.02)
        assert (correlation > 0.999).all()


def test_light_changes_nothing():
    moved = picture(shift=(0.6, -0.4))
    windows = Windows.cut(picture(), PLACES)
    bright = windows.find(moved, PLACES, STILL)
    for dark in (windows.find(0.5 * moved, PLACES, STILL), windows.find(0.3 * moved + 40, PLACES, STILL)):
        np.testing.assert_allclose(dark[0], bright[0], atol=1e-3)
        np.testing.assert_allclose(dark[1], bright[1], atol=1e-5)


def test_a_window_is_found_on_skin_that_turns_and_stretches_if_it_is_told_how():
    matrix = np.array([[0.75, -0.35], [0.3, 1.1]])
    middle = np.array([SIZE / 2, SIZE / 2])
    moved, true = picture(matrix), (PLACES - middle) @ matrix.T + middle
    windows = Windows.cut(picture(), PLACES)
    told, correlation = windows.find(moved, true + np.array([0.8, -0.6]), np.tile(matrix, (3, 1, 1)))
    np.testing.assert_allclose(told, true, atol=0.05)
    assert (correlation > 0.99).all()
    _, untold = windows.find(moved, true, STILL)
    assert (untold < correlation - 0.03).all()


def test_along_an_edge_nothing_is_seen_and_nothing_is_made_up():
    _, x = np.mgrid[:SIZE, :SIZE]
    edge = (200 / (1 + np.exp(-(x - 48.0) / 1.5))).astype(np.float32)
    windows = Windows.cut(edge, np.array([[48.0, 48.0]]))
    assert windows.values[0, 1] < 1e-6 * windows.values[0, 0]
    np.testing.assert_allclose(np.abs(windows.directions[0, 0]), [1, 0], atol=1e-6)
    places, _ = windows.find(np.roll(edge, 2, axis=1), np.array([[48.0, 51.5]]), STILL[:1])
    np.testing.assert_allclose(places, [[50.0, 51.5]], atol=0.02)


def test_what_does_not_count_does_not_pull():
    """Half of a window lies on something that stays; the other half moves."""
    y, x = np.mgrid[:SIZE, :SIZE]
    still = x < 48
    other = texture(1.7 * y, 1.3 * x)
    before, after = (np.where(still, other, seen).astype(np.float32) for seen in (picture(), picture(shift=(1.5, 1.0))))
    middle = np.array([[51.0, 48.0]])
    counts = np.zeros((1, 2 * REACH + 1, 2 * REACH + 1), dtype=bool)
    counts[:, :, 5:] = True  # from x = 49 on
    told, correlation = Windows.cut(before, middle, counts).find(after, middle, STILL[:1])
    whole, _ = Windows.cut(before, middle).find(after, middle, STILL[:1])
    np.testing.assert_allclose(told, middle + np.array([1.5, 1.0]), atol=0.1)
    assert correlation > 0.98 and np.linalg.norm(whole - middle - [1.5, 1.0]) > 0.3


@pytest.mark.parametrize("start", [(3.0, 48.0), (48.0, SIZE - 4.0), (-20.0, 48.0), (np.nan, 48.0)])
def test_a_window_that_leaves_the_picture_is_not_found(start):
    windows = Windows.cut(picture(), PLACES[:1])
    _, correlation = windows.find(picture(), np.array([start]), STILL[:1])
    assert correlation == -1


def test_a_blank_picture_is_not_taken_for_the_window():
    windows = Windows.cut(picture(), PLACES)
    _, correlation = windows.find(np.zeros((SIZE, SIZE), dtype=np.float32), PLACES, STILL)
    assert (np.abs(correlation) < 0.5).all()


def test_gradients_say_where_another_matcher_finds_them():
    """OpenCV's pyramidal Lucas and Kanade, which shares no code with ours."""
    start, end = (np.clip(p, 0, 255).astype(np.uint8) for p in (picture(), picture(shift=(1.3, -0.7))))
    theirs, *_ = cv2.calcOpticalFlowPyrLK(start, end, PLACES.astype(np.float32)[:, None], None, winSize=(15, 15))
    ours, _ = Windows.cut(start.astype(np.float32), PLACES).find(end.astype(np.float32), PLACES, STILL)
    np.testing.assert_allclose(ours, theirs[:, 0], atol=0.05)
