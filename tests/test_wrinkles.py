"""Wrinkles: slopes of a known relief, at the right place, for shapes of any spelling."""

from dataclasses import replace

import numpy as np
import pytest

from blendcap import mannequin
from blendcap.rendering import face_camera, prepare_rig, shaped, slopes_of
from blendcap.synthetic.canvas import Canvas
from blendcap.synthetic.mannequin.furrows import FURROWS
from blendcap.synthetic.wrinkles import _frame, _picture, _slopes, wrinkle

SIZE = 256


@pytest.fixture(scope="module")
def wrinkled():
    return wrinkle(mannequin(shapes=52), size=SIZE)


def test_slopes_are_the_gradient_of_a_known_relief():
    """A sheet in space whose chart is sheared and stretched: the slopes along u and across it, in closed form."""
    n = 200
    rows, columns = (a.ravel() for a in np.mgrid[:n, :n])
    u, v = (columns + 0.5) / n, 1 - (rows + 0.5) / n
    a, b = np.array([60.0, 8, 0]), np.array([25.0, 40, 0])  # mm by u and by v
    positions = np.outer(u, a) + np.outer(v, b)
    canvas = Canvas(n, (rows, columns), rows, np.zeros((n * n, 3), dtype=np.float32))
    x, y = positions[:, 0], positions[:, 1]
    relief = 0.8 * np.sin(0.3 * x + 0.2 * y)
    gradient = 0.8 * np.cos(0.3 * x + 0.2 * y)[:, None] * [0.3, 0.2]
    along = a[:2] / np.linalg.norm(a)
    across = np.array([-along[1], along[0]])
    found = _slopes(_picture(canvas, relief[:, None])[..., 0], _frame(_picture(canvas, positions)))[1:-1, 1:-1]
    expected = -np.stack([gradient @ along, gradient @ across], 1).reshape(n, n, 2)[1:-1, 1:-1]
    np.testing.assert_allclose(found, expected, atol=1.5e-3)


def test_every_folding_shape_has_a_map_and_no_other(wrinkled):
    names = {f"{stem}{side}" for stem in FURROWS for side in ("Left", "Right")} - {
        "browInnerUpLeft",
        "browInnerUpRight",
    }
    assert set(wrinkled.normal_maps) == names | {"browInnerUp"}
    for normal_map in wrinkled.normal_maps.values():
        slopes = np.abs(slopes_of(normal_map)).max(2)
        assert slopes.max() > 0.1 and (slopes > 0.02).mean() < 0.2


def test_left_and_right_mirror(wrinkled):
    for stem in ("browDown", "eyeSquint", "mouthSmile"):
        left, right = (
            slopes_of(wrinkled.normal_maps[f"{stem}{side}"])[: int(0.64 * SIZE)] for side in ("Left", "Right")
        )
        assert left[:, SIZE // 2 :].any() and not left[:, : SIZE // 2 - 6].any()  # the chart's u grows to the left
        np.testing.assert_allclose(left, right[:, ::-1] * [-1, 1], atol=0.05)


def test_spelling_and_halves(wrinkled):
    rig = mannequin(shapes=52).select(["browInnerUp", "browDownLeft", "jawOpen"])
    renamed = replace(rig, names=("browInnerUp_L", "browInnerUp_R", "browDown_L"), mirror=None, combinations={})
    maps = wrinkle(renamed, size=SIZE).normal_maps
    assert set(maps) == {"browInnerUp_L", "browInnerUp_R", "browDown_L"}
    both = slopes_of(maps["browInnerUp_L"]) + slopes_of(maps["browInnerUp_R"])
    np.testing.assert_allclose(both, slopes_of(wrinkled.normal_maps["browInnerUp"]), atol=0.03)
    deep = slopes_of(wrinkle(renamed, 2.0, size=SIZE).normal_maps["browDown_L"])
    np.testing.assert_allclose(deep, 2 * slopes_of(maps["browDown_L"]), atol=0.06)


def test_a_raised_brow_is_seen_to_wrinkle(wrinkled):
    plain = mannequin(shapes=52)
    weights = np.zeros(52)
    weights[plain.index("browInnerUp")] = 1
    camera = face_camera(plain.points["landmarks68"].positions(plain.mesh) + np.array([0, 30, 0]), (200, 200))
    smooth, lined = (shaped(prepare_rig(r), r, weights).picture(camera, (200, 200)).astype(int)
                     for r in (plain, wrinkled))  # fmt: skip
    change = np.abs(smooth - lined).mean(2)
    assert change[:100].mean() > 10 * max(change[120:].mean(), 0.01)
    still = [shaped(prepare_rig(r), r, np.zeros(52)).picture(camera, (200, 200)) for r in (plain, wrinkled)]
    assert np.abs(still[0].astype(int) - still[1]).max() <= 1
