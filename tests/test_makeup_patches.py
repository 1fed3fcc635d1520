"""Patches of paint from frames: known motions, lights and faces, and what is refused."""

import cv2
import numpy as np
import pytest

from blendcap.data import Camera, InputError
from blendcap.makeup.patches import Patches, each_block, extract_patches, flows, laid_over, paint, paint_threshold
from blendcap.makeup.regions import PATCH_SIZE, PATCHES, patch_corners, seen_patches
from blendcap.makeup.stabilization import Held, Stabilizer, similarity
from blendcap.rendering.camera import look_at
from toy_makeup import draw

SIZE = (320, 240)
ANCHORS = np.array([[40.0, 60], [280, 70], [160, 215]])
CORNERS = np.array([[110.0, 90], [210, 90], [210, 168], [110, 168]])


def frame(matrix=None, light=1.0, amounts=None, seed=0):
    """Skin, three dots that stay and one patch of strokes, moved by a matrix (2, 3)."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    skin = 70 + 15 * np.cos(x / 90) + 10 * np.sin(y / 60)
    strokes = cv2.resize(draw(amounts or {})["forehead"], (101, 79), interpolation=cv2.INTER_LINEAR)
    skin[90:169, 110:211] += strokes * 0.6
    for px, py in ANCHORS:
        skin += 150 * np.exp(-((x - px) ** 2 + (y - py) ** 2) / 12)
    if matrix is not None:
        skin = cv2.warpAffine(skin, np.asarray(matrix), SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    noise = np.random.default_rng(seed).normal(scale=1.5, size=skin.shape)
    return np.clip(light * skin + noise, 0, 255).astype(np.uint8)


def moved(angle, scale, shift):
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = np.array(SIZE) / 2
    return np.column_stack([turn, middle + shift - turn @ middle])


def test_similarity_is_recovered_exactly():
    matrix = moved(0.2, 1.1, (3, -4))
    end = ANCHORS @ matrix[:, :2].T + matrix[:, 2]
    np.testing.assert_allclose(similarity(ANCHORS, end), matrix, atol=1e-12)


def test_stabilizer_follows_a_known_slip_and_does_not_drift():
    stabilizer, worst = Stabilizer(frame(), ANCHORS), 0.0
    for t in range(40):
        matrix = moved(0.03 * np.sin(t / 5), 1 + 0.02 * np.sin(t / 7), (6 * np.sin(t / 6), 4 * np.cos(t / 8) - 4))
        found, part = stabilizer.follow(frame(matrix, seed=t))
        corners = CORNERS @ (found - matrix)[:, :2].T + (found - matrix)[:, 2]
        worst = max(worst, np.abs(corners).max())
        assert part == 1
    assert worst < 0.35


def test_a_frame_without_its_points_keeps_the_last_place_and_says_so():
    stabilizer = Stabilizer(frame(), ANCHORS)
    matrix = moved(0.0, 1.0, (5, 0))
    stabilizer.follow(frame(matrix))
    lost, part = stabilizer.follow(np.full(SIZE[::-1], 60, dtype=np.uint8))
    assert part == 0 and np.abs(lost - matrix).max() < 0.3
    again, part = stabilizer.follow(frame(moved(0.0, 1.0, (4, 0))))
    assert part == 1 and abs(again[0, 2] - 4) < 0.3


def cut(frames, **options):
    places = {"forehead": (0, CORNERS)}
    return extract_patches([frames], places, [ANCHORS], 60.0, **options)


def test_patches_do_not_feel_slip_or_light():
    slip = [moved(0.02 * t, 1, (2 * t, -t)) for t in range(4)]
    still = cut([frame()] * 4).images["forehead"]
    slipping = cut([frame(m, seed=t) for t, m in enumerate(slip)]).images["forehead"]
    dim = cut([frame()] + [frame(light=0.5, seed=9)] * 3).images["forehead"]
    assert still.shape == (4, PATCH_SIZE[1], PATCH_SIZE[0]) and set(np.unique(still)) == {0, 255}
    for other in (slipping, dim):
        assert (still != other).mean() < 0.03
    lifted = cut([frame(), frame(amounts={"AU1+2": 1.0})]).images["forehead"]
    assert (lifted[0] != lifted[1]).mean() > 0.1


def test_blocks_are_the_parts_of_the_whole():
    frames = [frame(moved(0.01 * t, 1, (t, 0)), seed=t) for t in range(7)]
    whole = cut(frames)
    blocks = list(each_block([iter(frames)], {"forehead": (0, CORNERS)}, [ANCHORS], 60.0, block=3))
    assert [len(block.sure) for block in blocks] == [3, 3, 1]
    np.testing.assert_array_equal(np.concatenate([b.images["forehead"] for b in blocks]), whole.images["forehead"])
    for block in blocks:
        np.testing.assert_array_equal(block.neutral["forehead"], whole.images["forehead"][0])


def test_markers_are_not_paint():
    dotted = frame()
    cv2.circle(dotted, (160, 128), 4, 255, -1)
    dots = np.array([[[160.0, 128], [np.nan, np.nan]]])
    with_dot, without = cut([dotted]), cut([dotted], dots=[dots], dot_radius=6.0)
    column, row = 27, 21  # of (160, 128) in the patch
    assert with_dot.images["forehead"][0, row, column] == 255
    assert without.images["forehead"][0, row - 2 : row + 3, column - 2 : column + 3].max() == 0


def test_rims_of_markers_and_glints_are_not_paint():
    patch = np.full(PATCH_SIZE[::-1], 60, dtype=np.uint8)
    patch[10:12, 10:22] = 200  # a stroke
    patch[30:32, 30:33] = 200  # what a disc leaves of a marker
    found = paint(patch, 0.5)
    assert found[10:12, 10:22].all() and found.sum() == 24 * 255


def test_a_marker_is_taken_out_where_it_is_to_a_part_of_a_pixel():
    patch = np.full(PATCH_SIZE[::-1], 60, dtype=np.uint8)
    y, x = np.mgrid[: PATCH_SIZE[1], : PATCH_SIZE[0]]
    dots = np.array([[20.4, 15.4], [40.5, 30.5]])
    for dot in dots:
        patch[np.hypot(x - dot[0], y - dot[1]) < 3.3] = 200
    assert not paint(patch, 0.5, dots, 3.8).any()
    assert paint(patch, 0.5, dots[:1], 3.8).any()


def test_paint_is_found_at_the_brightness_between_skin_and_paint():
    patch = np.full((44, 56), 80, dtype=np.uint8)
    patch[20:24] = 200
    limit = paint_threshold(patch)
    assert 0.0 <= limit < 1.5
    np.testing.assert_array_equal(paint(patch, limit) == 255, patch == 200)
    np.testing.assert_array_equal(paint(patch // 2, limit) == 255, patch == 200)


def test_a_threshold_of_zero_is_a_threshold():
    anything, bright, found = (cut([frame()], threshold=t).images["forehead"] == 255 for t in (0.0, 0.5, None))
    assert anything.mean() > 0.5  # all that is brighter than what is around it
    assert (anything >= bright).all() and 0.05 < bright.mean() < 0.2 and found.mean() < 0.2


def test_a_threshold_above_all_paint_is_refused():
    with pytest.raises(
        InputError, match=r"Nothing in the patch 'forehead' of the first frame is brighter .* by 50 times"
    ):
        cut([frame()], threshold=50.0)


@pytest.mark.parametrize("threshold", [-0.1, np.nan, np.inf])
def test_a_threshold_that_cannot_be_is_refused(threshold):
    with pytest.raises(InputError, match=r"threshold of paint is .* must be 0 or more"):
        cut([frame()], threshold=threshold)


@pytest.mark.parametrize(
    ("videos", "sentence"),
    [
        ([[np.full(SIZE[::-1], 70, dtype=np.uint8)]], "No paint is visible in the patch 'forehead' of the first frame"),
        ([[]], "The head-camera video has no frame"),
        ([[frame()] * 3, [frame()] * 2], "Camera 1 ends after 2 frames, before the others"),
    ],
)
def test_videos_that_cannot_be_cut_are_refused(videos, sentence):
    with pytest.raises(InputError, match=sentence):
        extract_patches(videos, {"forehead": (0, CORNERS)}, [ANCHORS] * len(videos), 60.0)


def test_one_point_cannot_stabilize():
    with pytest.raises(InputError, match="at least two points"):
        Stabilizer(frame(), ANCHORS[:1])


def test_another_build_is_laid_over_the_training_face():
    ours, theirs = draw({}), draw({}, build=3.0)
    images = {name: picture[None] for name, picture in theirs.items()}
    laid = laid_over(Patches(images, 60.0, np.ones(1), theirs), flows(theirs, ours))
    for name in ours:
        before = np.abs(theirs[name].astype(float) - ours[name]).mean()
        after = np.abs(laid.images[name][0].astype(float) - ours[name]).mean()
        assert after < 0.6 * before
        np.testing.assert_array_equal(laid.neutral[name], laid.images[name][0])


@pytest.fixture(scope="module")
def landmarks():
    """A face of landmarks: a plane with the eyes 88 mm apart."""
    marks = np.zeros((68, 3))
    marks[:, 0] = np.linspace(-60, 60, 68)
    marks[:17, 1] = -90
    marks[17:27, 0], marks[17:27, 1] = np.linspace(-48, 48, 10), 20
    marks[27:36, 0], marks[27:36, 1] = 0, np.linspace(5, -35, 9)
    marks[36:42, 0], marks[42:48, 0] = np.linspace(-44, -18, 6), np.linspace(44, 18, 6)
    marks[45, 0], marks[42, 0] = 44, 18
    marks[48:68, 0], marks[48:68, 1] = np.linspace(-25, 25, 20), -65
    marks[8, 0] = 0
    return marks


def test_patches_are_placed_alike_in_space_and_in_the_picture(landmarks):
    camera = Camera([[800, 0, 320], [0, 800, 240], [0, 0, 1]], look_at([0, -20, 900], [0, -20, 0]))
    space, flat = patch_corners(landmarks), patch_corners(landmarks[:, :2])
    assert set(space) == set(PATCHES)
    for name in PATCHES:
        np.testing.assert_allclose(space[name][:, :2], flat[name], atol=1e-9)
        right_upper, left_upper, left_lower, _ = space[name]
        assert left_upper[0] > right_upper[0] and left_upper[1] > left_lower[1]
    middle = space["forehead_left"].mean(0)
    np.testing.assert_allclose(middle[0], -space["forehead_right"].mean(0)[0], atol=1e-9)
    seen = seen_patches(landmarks, [camera], [(640, 480)])
    assert all(view == 0 for view, _ in seen.values())


def test_the_camera_that_sees_a_patch_best_is_taken(landmarks):
    left, right = (
        Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], look_at([x, -20, 250], [0, -20, 0])) for x in (150, -150)
    )
    seen = seen_patches(landmarks, [left, right], [(640, 480)] * 2)
    assert seen["eye_left"][0] == 0 and seen["eye_right"][0] == 1
    away = Camera(left.intrinsics, look_at([0, 0, 300], [0, 0, 900]))
    with pytest.raises(InputError, match="No camera has the patch 'forehead_right' in its picture"):
        seen_patches(landmarks, [away], [(640, 480)])
    with pytest.raises(InputError, match="placed by 68 landmarks"):
        patch_corners(landmarks[:10])


def test_a_video_that_outlasts_the_take_is_refused():
    pose = Held(np.tile([[0.0, 0], [9, 0], [0, 9]], (2, 1, 1)))
    assert [pose.follow(frame())[1] for _ in range(2)] == [1, 1]
    with pytest.raises(InputError, match="goes on after the 2 frames of the take"):
        pose.follow(frame())
