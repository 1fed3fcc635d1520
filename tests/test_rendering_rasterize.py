"""The rasterizer against closed forms and against ray casting written anew."""

import sys

import cv2
import numpy as np
import pytest

from blendcap.data import Camera
from blendcap.rendering import face_camera, look_at, project, rasterize


def straight(width=40, height=30, focal=100.0, distance=100.0):
    """At z = 0 one mm is one pixel: pixel (x, y) sees the point (x, -y, 0), y up."""
    pose = np.diag([1.0, -1, -1, 1])
    pose[2, 3] = distance
    return Camera(np.array([[focal, 0, 0], [0, focal, 0], [0, 0, 1.0]]), pose), (width, height)


def cast(vertices, faces, camera, size):
    """Depth and face of each pixel by intersecting its ray with every triangle (Möller and Trumbore)."""
    rotation, origin = camera.pose[:3, :3], camera.position
    y, x = np.mgrid[: size[1], : size[0]]
    rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(camera.intrinsics).T @ rotation
    depth, face = np.full(x.shape, np.inf), np.full(x.shape, -1)
    margin = np.full(x.shape, np.inf)  # of the nearest pixel centre to an edge
    for f, (a, b, c) in enumerate(vertices[faces]):
        e1, e2 = b - a, c - a
        p = np.cross(rays, e2)
        det = p @ e1
        u = p @ (origin - a) / det
        q = np.cross(origin - a, e1)
        v, t = rays @ q / det, (e2 @ q) / det
        inner = np.minimum(np.minimum(u, v), 1 - u - v)
        margin = np.minimum(margin, np.abs(inner))
        hit = (inner > 0) & (t > 0) & (t < depth)
        depth[hit], face[hit] = t[hit], f
    return depth, face, margin


def test_triangle_covers_known_pixels():
    camera, size = straight()
    vertices = np.array([[0.5, -0.5, 0], [10.5, -0.5, 0], [0.5, -10.5, 0]])
    fragments = rasterize(vertices, np.array([[0, 1, 2]]), camera, size)
    y, x = np.mgrid[: size[1], : size[0]]
    inside = (x > 0.5) & (y > 0.5) & (x + y < 11)
    # the diagonal x + y = 11 passes through pixel centres and is a right and bottom edge: it is left out
    np.testing.assert_array_equal(fragments.face >= 0, inside)
    assert np.allclose(fragments.depth[inside], 100)
    assert np.isinf(fragments.depth[~inside]).all()


def test_left_and_top_edges_belong_to_the_triangle():
    camera, size = straight()
    vertices = np.array([[2.0, -2, 0], [8, -2, 0], [8, -8, 0], [2, -8, 0]])
    for faces in ([[0, 2, 1], [0, 3, 2]], [[0, 1, 2], [0, 2, 3]], [[1, 3, 0], [3, 1, 2]]):  # both sides, both diagonals
        y, x = np.nonzero(rasterize(vertices, np.array(faces), camera, size).face >= 0)
        assert (x.min(), x.max(), y.min(), y.max(), len(x)) == (2, 7, 2, 7, 36)


def test_nearer_triangle_wins_in_either_order():
    camera, size = straight()
    far = np.array([[0, 0, 0], [30, 0, 0], [0, -25, 0]])
    near = far * 0.5 + [3, -3, 10]
    vertices = np.concatenate([far, near])
    one = rasterize(vertices, np.array([[0, 1, 2], [3, 4, 5]]), camera, size)
    two = rasterize(vertices, np.array([[3, 4, 5], [0, 1, 2]]), camera, size)
    assert (one.face == 1).sum() > 50 and (one.face == 0).sum() > 50
    np.testing.assert_array_equal(one.face >= 0, two.face >= 0)
    np.testing.assert_array_equal(one.face == 1, two.face == 0)
    np.testing.assert_array_equal(one.depth, two.depth)


def test_agrees_with_ray_casting():
    rng = np.random.default_rng(3)
    vertices = rng.normal(size=(60, 3)) * 40
    faces = rng.permutation(60).reshape(20, 3)
    camera, size = face_camera(vertices, (90, 70), 0.4, -0.3), (90, 70)
    depth, face, margin = cast(vertices, faces, camera, size)
    fragments = rasterize(vertices, faces, camera, size)
    clear = margin > 1e-9
    np.testing.assert_array_equal(fragments.face[clear], face[clear])
    seen = clear & (face >= 0)
    assert seen.sum() > 1000
    np.testing.assert_allclose(fragments.depth[seen], depth[seen], rtol=1e-12)
    # perspective-correct weights lead back to the point on the ray
    y, x = np.nonzero(seen)
    points = np.einsum("pk,pkd->pd", fragments.barycentric[seen], vertices[faces[face[seen]]])
    pixels, depths = project(points, camera)
    np.testing.assert_allclose(pixels, np.stack([x, y], 1), atol=1e-9)
    np.testing.assert_allclose(depths, depth[seen], rtol=1e-12)


def test_backs_are_hidden_by_fronts_and_by_nothing_else():
    # a cloud of small triangles in front of, in and behind a wall: the whole is the nearer of fronts and backs alone
    rng = np.random.default_rng(11)
    middle = np.concatenate([rng.uniform(-90, 90, (3000, 2)), rng.uniform(-40, 40, (3000, 1))], axis=1)
    cloud = (middle[:, None] + 8 * rng.normal(size=(3000, 3, 3))).reshape(-1, 3)
    wall = np.array([[-95.0, -90, 0], [70, -90, 0], [70, 90, 0], [-95, 90, 0]])
    vertices = np.concatenate([cloud, wall])
    faces = np.concatenate([np.arange(9000).reshape(-1, 3), [[9000, 9001, 9002], [9000, 9002, 9003]]])
    camera, size = face_camera(vertices, (150, 170), 0.2), (150, 170)
    pixels = project(vertices, camera)[0][faces]
    one, two = (pixels[:, k] - pixels[:, 0] for k in (1, 2))
    front = one[:, 0] * two[:, 1] < one[:, 1] * two[:, 0]
    assert front[-2:].all() and 1000 < front.sum() < 2000
    both, fronts, backs = (rasterize(vertices, faces[some], camera, size).depth for some in (..., front, ~front))
    np.testing.assert_array_equal(both, np.minimum(fronts, backs))
    assert ((backs < fronts).sum() > 1000) and ((fronts < backs).sum() > 1000)


def test_triangles_through_the_camera_need_no_clipping():
    rng = np.random.default_rng(5)
    vertices = rng.normal(size=(45, 3)) * 30
    faces = rng.permutation(45).reshape(15, 3)
    camera = Camera(np.array([[60.0, 0, 40], [0, 60, 30], [0, 0, 1]]), look_at((2.0, 1, 3), (10.0, 5, -40)))
    depths = project(vertices, camera)[1][faces]
    assert ((depths < 0).any(1) & (depths > 0).any(1)).sum() > 4 and (depths < 0).all(1).any()
    depth, face, margin = cast(vertices, faces, camera, (80, 60))
    fragments = rasterize(vertices, faces, camera, (80, 60))
    clear = margin > 1e-9
    np.testing.assert_array_equal(fragments.face[clear], face[clear])
    np.testing.assert_allclose(fragments.depth[clear], depth[clear], rtol=1e-9)


def test_nothing_behind_the_camera_is_seen():
    camera, size = straight()
    vertices = np.array([[-500.0, -500, 150], [500, -500, 150], [0, 800, 150]])
    assert (rasterize(vertices, np.array([[0, 1, 2]]), camera, size).face == -1).all()


def grid(seed, relief, offset):
    """A sheet of triangles that hides the whole picture of `straight`; its inner corners move by up to a pixel."""
    rng, n = np.random.default_rng(seed), 9
    x, y = np.meshgrid(np.linspace(-2, 46, n) + offset, np.linspace(-2, 38, n) + offset)
    inner = np.pad(np.ones((n - 2, n - 2, 1)), ((1, 1), (1, 1), (0, 0)))
    xy = np.stack([x, y], -1) + inner * rng.integers(-2, 3, size=(n, n, 2)) / 2
    z = rng.normal(size=(n, n, 1)) * relief
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (q.ravel() for q in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    return np.concatenate([xy * [1, -1] * (128 - z) / 128, z], -1).reshape(-1, 3), faces


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("relief, offset", [(0, 0), (0, 0.25), (3, 0.3)])
def test_shared_edges_cover_each_pixel_exactly_once(seed, relief, offset):
    # without relief all numbers are exact, and edges and corners pass through the very centres of pixels
    vertices, faces = grid(seed, relief, offset)
    camera, size = straight(focal=128.0, distance=128.0)
    count = sum((rasterize(vertices, face[None], camera, size).face >= 0).astype(int) for face in faces)
    assert (count == 1).all()


def test_weights_reproduce_affine_functions():
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(3, 3)) * [15, 15, 5] + [20, -15, 0], np.array([[0, 1, 2]])
    camera, size = straight()
    fragments = rasterize(vertices, faces, camera, size)
    seen = fragments.face >= 0
    weights = fragments.barycentric[seen]
    assert seen.sum() > 20
    assert np.abs(weights.sum(1) - 1).max() < 1e-12 and weights.min() >= 0
    slope, offset = rng.normal(size=3), 0.7
    y, x = np.nonzero(seen)
    depth = fragments.depth[seen]
    world = np.stack([x * depth / 100, -y * depth / 100, 100 - depth], 1)
    np.testing.assert_allclose(weights @ (vertices @ slope + offset), world @ slope + offset, atol=1e-9)


def test_answer_does_not_depend_on_the_threads(monkeypatch):
    rng = np.random.default_rng(1)
    vertices, faces = rng.normal(size=(300, 3)) * 30, rng.integers(0, 300, size=(400, 3))
    camera = face_camera(vertices, (130, 110))
    whole = rasterize(vertices, faces, camera, (130, 110))
    monkeypatch.setattr(sys.modules["blendcap.rendering.rasterize"], "BAND", 7)
    split = rasterize(vertices, faces, camera, (130, 110))
    for name in ("depth", "face", "barycentric"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(split, name))


def test_corner_at_infinity_does_not_break_it():
    camera, size = straight()
    vertices = np.array([[1e300, 0, 0], [0, 1e300, 0], [0, -10, 0], [5, -5, 0], [9, -5, 0], [5, -9, 0]])
    with np.errstate(all="ignore"):
        fragments = rasterize(vertices, np.array([[0, 1, 2], [3, 5, 4]]), camera, size)
    assert (fragments.face == 1).any()


def test_project_is_opencvs():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(50, 3)) * 30
    pose = look_at((40.0, 30, 200), (0.0, 0, 0))
    intrinsics = np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]])
    distortion = np.array([-0.21, 0.13, 0.002, -0.003, 0.05])
    expected = cv2.projectPoints(points, cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3], intrinsics, distortion)[0][:, 0]
    pixels, depth = project(points, Camera(intrinsics, pose, distortion))
    np.testing.assert_allclose(pixels, expected, atol=1e-9)
    np.testing.assert_allclose(depth, (points @ pose[:3, :3].T + pose[:3, 3])[:, 2])


def test_look_at_is_a_rotation_and_sees_the_target_in_the_middle():
    for eye in ((0.0, 0, 300), (10.0, 200, -5), (0.0, 50, 0)):
        pose = look_at(eye, (0.0, 0, 0))
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
        np.testing.assert_allclose(pose[:3, 3], [0, 0, np.linalg.norm(eye)], atol=1e-9)


@pytest.mark.parametrize("yaw, pitch", [(0, 0), (0.8, 0.2), (-1.57, 0), (3.1, -0.5)])
def test_face_camera_frames_all_and_fills_the_picture(yaw, pitch):
    vertices = np.random.default_rng(0).normal(size=(200, 3)) * [60, 90, 70] + [10, 20, 30]
    size = (320, 400)
    pixels, depth = project(vertices, face_camera(vertices, size, yaw, pitch))
    low, high = pixels.min(0), pixels.max(0)
    assert depth.min() > 0
    assert (low > 0).all() and (high < np.array(size) - 1).all()
    assert ((high - low) / size).max() == pytest.approx(0.88, abs=1e-9)
    np.testing.assert_allclose((low + high) / 2, (np.array(size) - 1) / 2, atol=1e-9)


def test_face_camera_stands_on_the_subjects_left():
    left = np.array([[60.0, 0, 0], [-60, 0, 0], [0, 60, 0], [0, -60, 0]])
    pixels, _ = project(left, face_camera(left, (200, 200)))
    assert pixels[0, 0] > pixels[1, 0]  # seen from the front, the subject's left is on the picture's right
    assert pixels[2, 1] < pixels[3, 1]
    assert face_camera(left, (200, 200), yaw=0.5).position[0] > 0
    assert face_camera(left, (200, 200), pitch=0.5).position[1] > 0
