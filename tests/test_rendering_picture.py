"""Shading: what light must and must not do, and that pictures stay the same."""

import time
from itertools import pairwise

import numpy as np
import pytest

from blendcap.data import Camera, InputError, Mesh, Rig, triangulate
from blendcap.rendering import Light, default_colors, face_camera, prepare, project, rasterize, render, vertex_normals
from blendcap.rendering.color import LINEAR, PIXELS, STEPS, to_linear, to_srgb
from blendcap.rendering.light import openness
from blendcap.rendering.parallel import each_ahead

WHITE = (1.0, 1.0, 1.0)
BLACK = (0.0, 0.0, 0.0)


def globe(radius=50.0, rings=24, center=(0.0, 0, 0)):
    """A sphere of quads as a mesh, poles up and down."""
    height, turn = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1)[:-1], indexing="ij"
    )
    points = np.stack([np.sin(height) * np.sin(turn), np.cos(height), np.sin(height) * np.cos(turn)], -1).reshape(-1, 3)
    n = 2 * rings
    quads = [[i * n + j, (i + 1) * n + j, (i + 1) * n + (j + 1) % n, i * n + (j + 1) % n]
             for i in range(rings) for j in range(n)]  # fmt: skip
    return Mesh(points * radius + center, triangulate(np.array(quads)))


def plate(half=40.0, z=0.0):
    corners = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv=np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]))


def test_normals_of_a_globe_point_outwards():
    mesh = globe()
    normals = vertex_normals(mesh.vertices, mesh.faces)
    used = np.linalg.norm(normals, axis=1) > 0
    np.testing.assert_allclose(np.linalg.norm(normals[used], axis=1), 1)
    assert (normals * mesh.vertices / 50).sum(1).min() > 0.99


def test_normals_turn_with_the_mesh_and_weigh_by_area():
    mesh = globe()
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    turned = vertex_normals(mesh.vertices @ rotation.T, mesh.faces)
    np.testing.assert_allclose(turned, vertex_normals(mesh.vertices, mesh.faces) @ rotation.T, atol=1e-12)
    fold = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 3]])
    normal = vertex_normals(fold, np.array([[0, 1, 2], [0, 2, 3]]))[0]
    np.testing.assert_allclose(normal, np.array([3, 0, 1]) / np.sqrt(10))


def test_every_byte_comes_back_from_linear_light():
    np.testing.assert_array_equal(PIXELS[np.round(LINEAR * (STEPS - 1)).astype(int)], np.arange(256))
    np.testing.assert_allclose(to_srgb(to_linear(np.linspace(0, 1, 99))), np.linspace(0, 1, 99), atol=1e-7)
    assert to_linear(0.5) == pytest.approx(0.21404, abs=1e-5)


def test_background_is_kept_to_the_byte_and_checked():
    mesh, size = globe(), (60, 50)
    camera = face_camera(mesh.vertices, size)
    wall = np.random.default_rng(0).integers(0, 256, size=(50, 60, 3)).astype(np.uint8)
    picture = render(mesh, camera, size, background=wall / 255)
    free = (rasterize(mesh.vertices, mesh.faces, camera, size).depth == np.inf) & (picture == wall).all(2)
    assert free.sum() > 0.2 * free.size
    assert (picture[:2] == wall[:2]).all() and (picture[:, -2:] == wall[:, -2:]).all()
    with pytest.raises(InputError, match="The background is 60 x 50 pixels, but the picture is 50 x 60"):
        render(mesh, camera, (50, 60), background=wall / 255)


def test_silhouette_is_antialiased():
    mesh, size = globe(rings=48), (64, 64)
    camera = face_camera(mesh.vertices, size)
    picture = render(mesh, camera, size, color=WHITE, background=BLACK, light=Light(strengths=(0, 0, 0, 3.0), gloss=0))
    covered = to_linear(picture[..., 1] / 255) / to_linear(picture[32, 32, 1] / 255)
    edge = (covered > 0.05) & (covered < 0.9)
    assert 60 < edge.sum() < 400
    # the covered area is the disc's: a quarter of a pixel at a time, so much better than whole pixels would do
    pixels, _ = project(mesh.vertices, camera)
    diameter = np.ptp(pixels[:, 1])
    white = render(mesh, camera, size, color=WHITE, background=BLACK, light=Light(strengths=(0, 0, 0, 50.0), gloss=0))
    share = to_linear(white[..., 1] / 255).sum()
    assert share == pytest.approx(np.pi * diameter**2 / 4, rel=0.01)


def test_key_light_comes_from_its_side_and_casts_a_shadow():
    mesh, size = globe(), (80, 80)
    camera = face_camera(mesh.vertices, size)
    light = Light(key=(-1, 0, 1), strengths=(1, 0, 0, 0), gloss=0)
    picture = render(mesh, camera, size, color=(0.5, 0.5, 0.5), light=light, background=BLACK).astype(int)
    assert picture[40, 14:24].mean() > picture[40, 60:70].mean() + 40
    # a small globe between light and large one takes its light away, exactly where the light says
    ball = globe(radius=12, center=(-45.0, 0, 75))
    both = Mesh(
        np.concatenate([mesh.vertices, ball.vertices]), np.concatenate([mesh.faces, ball.faces + len(mesh.vertices)])
    )
    shaded = render(both, camera, size, color=(0.5, 0.5, 0.5), light=light, background=BLACK).astype(int)
    spot = np.round(project(np.array([50 * np.array([-0.34, 0, 0.94])]), camera)[0][0]).astype(int)
    away = np.round(project(np.array([50 * np.array([-0.34, 0.75, 0.57])]), camera)[0][0]).astype(int)
    assert shaded[spot[1], spot[0], 1] < 0.5 * picture[spot[1], spot[0], 1]
    assert abs(shaded[away[1], away[0], 1] - picture[away[1], away[0], 1]) <= 2


def test_a_convex_body_does_not_shade_itself():
    mesh = globe(rings=32)
    normals = vertex_normals(mesh.vertices, mesh.faces)
    assert openness(mesh.vertices, normals, mesh.faces).min() > 0.95


def test_the_floor_of_a_pit_is_less_open_than_its_rim():
    x, z = np.meshgrid(np.linspace(-50, 50, 41), np.linspace(-50, 50, 41))
    y = -60 * np.exp(-(x**2 + z**2) / 120)
    index = np.arange(41 * 41).reshape(41, 41)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    vertices, faces = np.stack([x, y, z], -1).reshape(-1, 3), triangulate(quads)
    light = openness(vertices, vertex_normals(vertices, faces), faces).reshape(41, 41)
    assert light[20, 20] < 0.6 and light[3, 3] > 0.95


def test_texture_is_seen_where_its_coordinates_say():
    mesh = plate()
    texture = np.zeros((64, 64, 3), dtype=np.uint8)
    texture[:32, :32] = [255, 0, 0]  # rows from the top: v above one half, u below
    texture[32:, 32:] = [0, 255, 0]
    mesh = Mesh(mesh.vertices, mesh.faces, uv=mesh.uv, texture=texture)
    size = (64, 64)
    picture = render(mesh, face_camera(mesh.vertices, size), size, light=Light(gloss=0)).astype(int)
    assert picture[18, 18, 0] > 150 and picture[18, 18, 1] < 40
    assert picture[46, 46, 1] > 150 and picture[46, 46, 0] < 40
    assert picture[18, 46].max() < 40
    grey = Mesh(mesh.vertices, mesh.faces, uv=mesh.uv, texture=np.full((8, 8, 1), 128, dtype=np.uint8))
    alike = Mesh(mesh.vertices, mesh.faces, uv=mesh.uv, texture=np.full((8, 8, 3), 128, dtype=np.uint8))
    pictures = [render(m, face_camera(m.vertices, size), size) for m in (grey, alike)]
    np.testing.assert_array_equal(*pictures)
    plain = render(plate(), face_camera(mesh.vertices, size), size, color=np.full(3, 128 / 255))
    assert np.abs(plain.astype(int) - pictures[0]).max() <= 1


def test_color_of_nan_is_not_drawn():
    mesh, size = globe(), (50, 50)
    camera = face_camera(mesh.vertices, size)
    color = np.full((len(mesh.vertices), 3), 0.5)
    color[mesh.vertices[:, 1] > 0] = np.nan
    picture = render(mesh, camera, size, color=color, background=WHITE)
    assert (picture[10, 25] == 255).all() and (picture[40, 25] < 200).all()


def test_the_inside_of_an_open_surface_is_dark():
    size = (40, 40)
    front, back = plate(), Mesh(plate().vertices, plate().faces[:, ::-1])
    camera = face_camera(front.vertices, size)
    lit, dark = (render(m, camera, size, color=(0.6, 0.6, 0.6), light=Light(gloss=0))[20, 20] for m in (front, back))
    assert lit.min() > 2 * dark.max()


def _where_sheets_meet(turned):
    """Three pixels: a black sheet, turned to the camera or away, a pixel of both, and a white one a hair nearer."""
    left = np.array([[-40.0, -20, 0], [0, -20, 0], [0, 20, 0], [-40, 20, 0]])
    right = np.array([[0.0, -20, 0.1], [40, -20, 0.1], [40, 20, 0.1], [0, 20, 0.1]])
    faces = np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]])
    faces[:2, 1:] = faces[:2, 1:] if turned else faces[:2, :0:-1]
    pose = np.diag([1.0, -1, -1, 1])
    pose[2, 3] = 200
    camera = Camera(np.array([[200.0, 0, 30], [0, 200, 15], [0, 0, 1]]), pose)
    even = Light(strengths=(0, 0, 0, 1.0), gloss=0)
    paint = np.repeat([BLACK, (0.6, 0.6, 0.6)], 4, axis=0)
    return render(Mesh(np.concatenate([left, right]), faces), camera, (60, 30), color=paint, light=even)[15, 29:32, 1]


def test_where_faces_turned_apart_meet_a_pixel_is_their_mean():
    # as at the seam of shut lids, which would be black dashes if one of the two had the whole pixel
    left, both, right = to_linear(_where_sheets_meet(turned=True) / 255.0)
    assert right > left + 0.1
    assert both == pytest.approx((left + right) / 2, abs=0.02)


def test_where_faces_turned_alike_meet_the_nearer_one_colors_the_pixel():
    left, both, right = _where_sheets_meet(turned=False).astype(int)
    assert right > left + 50
    assert both == pytest.approx(right, abs=2)


def test_a_picture_is_the_same_every_time_and_from_a_prepared_surface():
    mesh, size = globe(), (90, 70)
    camera = face_camera(mesh.vertices, size, 0.4)
    pictures = [render(mesh, camera, size), prepare(mesh).picture(camera, size), render(mesh, camera, size)]
    for other in pictures[1:]:
        np.testing.assert_array_equal(pictures[0], other)


def test_a_posed_surface_is_that_of_the_posed_mesh_and_takes_a_given_openness():
    mesh, size = globe(), (90, 70)
    moved = mesh.vertices * [1.1, 0.8, 1.0]
    camera, surface = face_camera(moved, size, 0.4), prepare(mesh)
    posed = surface.posed(moved)
    np.testing.assert_array_equal(posed.picture(camera, size), render(mesh.with_vertices(moved), camera, size))
    np.testing.assert_array_equal(surface.posed(moved, posed.sky).table, posed.table)
    dim = surface.posed(moved, 0.5 * posed.sky).picture(camera, size)
    assert (dim[35, 45] + 8 < posed.picture(camera, size)[35, 45]).all()


def test_work_done_ahead_comes_in_order_and_its_errors_come_through():
    def work(n):
        time.sleep(0.01 * (n % 3))
        return 1 // (7 - n)

    with pytest.raises(ZeroDivisionError):
        list(each_ahead(work, range(9)))
    assert list(each_ahead(lambda n: (time.sleep(0.01 * (-n % 3)), n)[1], range(8))) == list(range(8))
    assert list(each_ahead(work, [])) == []


def test_default_colors_know_parts_by_name():
    skin, eye, tooth, veil = globe(60), globe(12, center=(30.0, 0, 70)), globe(5, rings=6), globe(13, rings=6)
    parts = [skin, eye, tooth, veil]
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    mesh = Mesh(np.concatenate([part.vertices for part in parts]), faces)
    rows = [np.arange(start, stop) for start, stop in pairwise(starts)]
    regions = {"eyes": rows[1], "lids": rows[0][:200], "upper_teeth": rows[2], "EyeOcclusionLeft": rows[3]}
    rig = Rig(mesh, np.zeros((1, len(mesh.vertices), 3)), ("a",), regions=regions)
    colors = default_colors(rig)
    assert colors is not None
    assert np.ptp(colors[rows[0]], axis=0).max() == 0
    assert np.isnan(colors[rows[3]]).all() and np.isfinite(colors[np.concatenate(rows[:3])]).all()
    assert (colors[rows[2]] > 0.75).all()
    front = rows[1][np.argmax(eye.vertices[:, 2])]
    behind = rows[1][np.argmin(eye.vertices[:, 2])]
    assert colors[front].max() < 0.1 and colors[behind].min() > 0.8
    texture = np.zeros((2, 2, 3), dtype=np.uint8)
    textured = Rig(Mesh(mesh.vertices, faces, uv=mesh.vertices[:, :2], texture=texture), rig.deltas, ("a",))
    assert default_colors(textured) is None
