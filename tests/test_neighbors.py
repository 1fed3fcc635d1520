"""Closest points on triangles, and neighborhoods that respect slits."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from blendcap.data import Mesh, Rig, SurfacePoints
from blendcap.markers.neighbors import candidates, project_on, seamless


@given(st.integers(0, 10_000), st.sampled_from([1.0, 0.05]))
@settings(max_examples=40, deadline=None)
def test_no_point_of_the_triangle_is_closer(seed, flatness):
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(5, 3, 3)) * [1, flatness, 1]
    points = rng.normal(size=(5, 3)) * 2
    weights = project_on(triangles, points)
    np.testing.assert_allclose(weights.sum(-1), 1)
    assert (weights >= 0).all()
    steps = np.linspace(0, 1, 60)
    u, v = np.meshgrid(steps, steps)
    grid = np.stack([u, v, 1 - u - v], -1)[u + v <= 1]
    everywhere = np.einsum("gc,tck->tgk", grid, triangles)
    brute = np.linalg.norm(everywhere - points[:, None], axis=-1).min(1)
    ours = np.linalg.norm(np.einsum("tc,tck->tk", weights, triangles) - points, axis=-1)
    assert (ours <= brute + 1e-12).all()
    assert (ours >= brute - 0.2).all()


def test_a_point_on_the_triangle_gives_its_own_coordinates():
    rng = np.random.default_rng(0)
    triangles, weights = rng.normal(size=(50, 3, 3)), rng.dirichlet(np.ones(3), 50)
    points = np.einsum("tc,tck->tk", weights, triangles)
    np.testing.assert_allclose(project_on(triangles, points), weights, atol=1e-9)


def test_degenerate_triangles_have_a_closest_point_too():
    line = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    point = np.array([[0.0, 0, 0]] * 3)
    np.testing.assert_allclose(project_on(line, np.array([2.0, 5, 0])) @ line, [2, 0, 0])
    np.testing.assert_allclose(project_on(point, np.array([2.0, 5, 0])).sum(), 1)


def test_one_point_against_many_triangles():
    triangles = np.random.default_rng(1).normal(size=(4, 6, 3, 3))
    point = np.array([0.3, -0.2, 1])
    many = project_on(triangles, point)
    assert many.shape == (4, 6, 3)
    np.testing.assert_array_equal(many[2, 4], project_on(triangles[2, 4], point))


def slit_sheet(columns=21, rows=11):
    """A sheet with a closed slit along its middle row: the vertices there exist twice, at the same places."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows) - rows // 2)
    vertices = np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype(float)
    index = np.arange(columns * rows).reshape(rows, columns)
    middle = rows // 2
    twin = index[middle].copy()
    twin[3:-3] = len(vertices) + np.arange(columns - 6)
    vertices = np.vstack([vertices, vertices[index[middle, 3:-3]]])
    quads = []
    for row in range(rows - 1):
        low = twin if row == middle else index[row]
        for column in range(columns - 1):
            quads.append([low[column], low[column + 1], index[row + 1, column + 1], index[row + 1, column]])
    quads = np.array(quads)
    return Mesh(vertices, np.vstack([quads[:, :3], quads[:, [0, 2, 3]]]))


def test_candidates_stay_on_their_side_of_a_closed_slit():
    mesh = slit_sheet()
    centers = mesh.vertices[mesh.faces].mean(1)
    own = int(np.argmin(np.abs(centers - [10, 0.4, 0]).sum(1)))
    points = SurfacePoints(("lip",), [own], [[0.3, 0.4, 0.3]])
    faces = candidates(mesh, points, radius=4.0, count=30)
    assert faces[0, 0] == own
    assert (faces >= 0).all()
    assert (centers[faces[0], 1] > 0).all()
    nearest = np.argsort(np.linalg.norm(centers - points.positions(mesh), axis=1))[:30]
    assert (centers[nearest, 1] < 0).any()  # straight distance would have crossed


def test_candidates_stop_at_the_radius_and_pad():
    mesh = slit_sheet()
    faces = candidates(mesh, SurfacePoints.at_vertices(["a"], [0], mesh), radius=1.5, count=50)[0]
    found = faces[faces >= 0]
    assert 0 < len(found) < 10
    assert (faces[len(found) :] == -1).all()
    centers = mesh.vertices[mesh.faces[found]].mean(1)
    assert np.linalg.norm(centers - mesh.vertices[0], axis=1).max() <= 1.5


def test_the_own_triangle_comes_first_even_where_smaller_ones_are_nearer():
    vertices = np.array([[0.0, 0, 0], [9, 9, 0], [9, -9, 0], [-1, 0.1, 0], [-1, -0.1, 0], [0, -1, 0]])
    mesh = Mesh(vertices, np.array([[3, 4, 0], [4, 5, 0], [0, 2, 1]]))
    tip = SurfacePoints(("tip",), [2], [[1.0, 0, 0]])
    assert candidates(mesh, tip, radius=20, count=3)[0].tolist() == [2, 1, 0]


def test_seams_are_sewn_where_both_sides_move_alike_and_only_there():
    mesh = slit_sheet()
    twins = np.arange(231, len(mesh.vertices))
    seam = Rig(mesh, np.zeros((1, len(mesh.vertices), 3)), ["still"])
    opening = np.zeros((1, len(mesh.vertices), 3))
    opening[0, twins[3:-3], 1] = 5
    mouth = Rig(mesh, opening, ["jawOpen"])
    assert not np.isin(twins, seamless(seam).faces).any()
    assert np.isin(twins[3:-3], seamless(mouth).faces).all()
    np.testing.assert_array_equal(seamless(mouth).vertices, mesh.vertices)
    np.testing.assert_array_equal(mesh.vertices[seamless(seam).faces], mesh.vertices[mesh.faces])
