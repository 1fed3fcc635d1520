"""Pictures side by side: the answers do not depend on the threads, and OpenCV has its own back afterwards."""

import threading

import cv2
import numpy as np
import pytest

from blendcap.makeup import features as features_module
from blendcap.makeup import threads
from blendcap.makeup.features import features
from blendcap.makeup.patches import paint
from blendcap.makeup.threads import in_threads, one_core_each


@pytest.fixture(autouse=True)
def three_threads_of_opencv():
    before = cv2.getNumThreads()
    cv2.setNumThreads(3)
    yield
    cv2.setNumThreads(before)


def test_answers_come_in_order_from_threads_that_work_at_once():
    both = threading.Barrier(2, timeout=30)  # passed only if two are within

    def work(k: int) -> int:
        both.wait()
        return k * k

    assert in_threads(work, range(6), most=2) == [0, 1, 4, 9, 16, 25]
    assert in_threads(lambda k: k, []) == []


def test_opencv_has_one_core_within_and_its_own_afterwards_whoever_leaves_first():
    first, second = one_core_each(), one_core_each()
    first.__enter__()
    assert cv2.getNumThreads() == 1
    second.__enter__()
    first.__exit__(None, None, None)
    assert cv2.getNumThreads() == 1
    second.__exit__(None, None, None)
    assert cv2.getNumThreads() == 3
    assert in_threads(lambda _: cv2.getNumThreads(), range(3)) == [1, 1, 1]


def test_an_error_in_a_thread_is_raised_and_opencv_has_its_own_back():
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda k: 1 // k, [1, 0, 2])
    assert cv2.getNumThreads() == 3


@pytest.mark.parametrize("kind", ["fine", "motion+gabor"])
def test_features_do_not_depend_on_threads(monkeypatch, kind):
    rng = np.random.default_rng(0)
    noise = np.array([cv2.GaussianBlur(rng.random((44, 56)), (0, 0), 2) for _ in range(23)])
    frames = np.where(noise > 0.5, 255, 0).astype(np.uint8)
    seen = features([frames, frames[::-1]], [frames[3], frames[5]], kind)
    one_by_one = np.concatenate(
        [features([frames[k : k + 1], frames[22 - k : 23 - k]], [frames[3], frames[5]], kind) for k in range(23)]
    )
    np.testing.assert_allclose(seen, one_by_one, rtol=1e-5, atol=1e-6)  # OpenCV rounds as the memory is aligned
    monkeypatch.setattr(features_module, "TOGETHER", 4)
    monkeypatch.setattr(threads, "cores", lambda: 5)
    again = features([frames, frames[::-1]], [frames[3], frames[5]], kind)
    np.testing.assert_allclose(again, seen, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("size", [(44, 56), (43, 55)])
def test_paint_is_what_exceeds_a_multiple_of_the_median(size):
    """Of patches with an even and an odd number of pixels; the median is counted, not sorted."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        patch = rng.integers(40, 60, size).astype(np.uint8)
        patch[:26] = 50
        patch[10:16, 8:40] = 200
        raised = 150 / np.median(patch)
        assert paint(patch, raised * (1 - 1e-9)).any() and not paint(patch, raised).any()
