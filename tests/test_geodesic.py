import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blendcap.numerics.geodesic import face_neighbors, surface_distances, walk
from sheet import SLIT_HALF, SLIT_Y, STEP, sheet_mesh


def nearest(mesh, x, y):
    return int(((mesh.vertices[:, :2] - (x, y)) ** 2).sum(1).argmin())


@pytest.fixture(scope="module")
def flat():
    return sheet_mesh(bend=0.0)


@pytest.fixture(scope="module")
def bent():
    return sheet_mesh(bend=0.01)


def test_on_a_plane_paths_are_as_long_as_lines_or_a_little_longer(flat):
    mesh, _ = flat
    source = nearest(mesh, -40, 48)
    reached = surface_distances(mesh.vertices, mesh.faces, [source])[0]
    straight = np.linalg.norm(mesh.vertices - mesh.vertices[source], axis=1)
    free = mesh.vertices[:, 1] > SLIT_Y  # lines that do not pass the slit
    assert (reached >= straight - 1e-9).all()
    assert (reached[free] <= 1.0824 * straight[free] + 1e-9).all()  # 8 directions: 1 / cos(22.5 deg)


def test_close_to_exact_geodesics(bent):
    mesh, _ = bent
    sources = [nearest(mesh, 0, 20), nearest(mesh, 30, -50)]
    reached = surface_distances(mesh.vertices, mesh.faces, sources)
    targets = np.arange(len(mesh.vertices))
    none = np.empty(0, dtype=np.int64)
    for row, source in zip(reached, sources, strict=True):
        exact = igl.exact_geodesic(mesh.vertices, mesh.faces, np.array([source]), none, targets, none)
        assert (row >= exact - 1e-6).all()
        assert row.sum() < 1.06 * exact.sum()
        assert (row <= 1.1 * exact + 1e-6).all()


def test_the_way_leads_around_the_slit(flat):
    mesh, lips = flat
    upper, lower = lips[len(lips) // 2]
    distance = surface_distances(mesh.vertices, mesh.faces, [upper])[0, lower]
    assert np.allclose(mesh.vertices[upper], mesh.vertices[lower])
    assert distance == pytest.approx(2 * SLIT_HALF, abs=2 * STEP)


def test_symmetric_and_unmoved_by_rigid_motion(bent):
    mesh, _ = bent
    sources = np.array([3, 200, 411])
    reached = surface_distances(mesh.vertices, mesh.faces, sources)
    assert np.allclose(reached[:, sources], reached[:, sources].T)
    turned = Rotation.from_rotvec([0.3, -0.5, 1.0]).apply(mesh.vertices.copy()) + 7
    assert np.allclose(surface_distances(turned, mesh.faces, sources), reached)


def test_limit_and_separate_pieces():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    vertices = np.concatenate([square, square + np.array([0, 0, 1e-6])])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    reached = surface_distances(vertices, faces, [0])[0]
    assert np.allclose(reached[:4], [0, 1, np.sqrt(2), 1])
    assert np.isinf(reached[4:]).all()
    assert np.isinf(surface_distances(vertices, faces, [0], 1.2)[0, 2])


def test_unfolded_diagonal_shortens_the_way_over_a_fold():
    vertices = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0], [-1, 0, 0]])  # two triangles on the edge 0-2
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    height = 1 / np.sqrt(2) * np.sqrt(1.5) * np.sqrt(2)  # distance of corners 1 and 3 from the edge's line
    reached = surface_distances(vertices, faces, [1])[0, 3]
    assert reached == pytest.approx(2 * height, rel=1e-9)


def test_a_walk_on_a_plane_is_a_line(flat):
    mesh, _ = flat
    neighbors = face_neighbors(mesh.faces)
    rng = np.random.default_rng(0)
    for _ in range(50):
        face = int(rng.integers(len(mesh.faces)))
        start, step = rng.dirichlet(np.ones(3)), np.append(rng.normal(size=2) * 8, 0)
        begin = start @ mesh.vertices[mesh.faces[face]]
        end = begin + step
        if max(np.abs(end[:2])) > 59 or (begin[1] - SLIT_Y) * (end[1] - SLIT_Y) <= 0:
            continue
        found, weights = walk(mesh.vertices, mesh.faces, neighbors, face=face, barycentric=start, step=step)
        assert weights @ mesh.vertices[mesh.faces[found]] == pytest.approx(end, abs=2e-3)


def test_a_walk_on_a_cylinder_unrolls_to_a_line():
    angle = np.linspace(0, 2, 41)
    y = np.linspace(0, 20, 11)
    a, h = (v.ravel() for v in np.meshgrid(angle, y))
    vertices = np.stack([30 * np.sin(a), h, 30 * np.cos(a)], 1)
    number = np.arange(len(a)).reshape(11, 41)
    p, q, r, s = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    faces = np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)])
    chord = 2 * 30 * np.sin(angle[1] / 2)
    unrolled = np.stack([a / angle[1] * chord, h], 1)
    face, weights = 5 * 40 + 4, np.array([0.2, 0.5, 0.3])
    corners = vertices[faces[face]]
    across = (corners[1] - corners[0]) / chord
    step = 30 * across + 5 * np.array([0, 1, 0])
    end, there = walk(vertices, faces, face_neighbors(faces), face=face, barycentric=weights, step=step)
    assert there @ unrolled[faces[end]] == pytest.approx(weights @ unrolled[faces[face]] + (30, 5), abs=2e-3)


def test_borders_and_slits_end_a_walk(flat):
    mesh, lips = flat
    neighbors = face_neighbors(mesh.faces)
    lower = lips[len(lips) // 2, 1]
    face = int(np.flatnonzero((mesh.faces == lower).any(1))[0])
    for length in (10.0, 200.0):
        end, weights = walk(
            mesh.vertices, mesh.faces, neighbors, face=face, barycentric=np.ones(3) / 3, step=(0, length, 0)
        )
        assert (weights @ mesh.vertices[mesh.faces[end]])[1] == pytest.approx(SLIT_Y)
        assert mesh.vertices[mesh.faces[end], 1].mean() < SLIT_Y
    end, weights = walk(mesh.vertices, mesh.faces, neighbors, face=face, barycentric=np.ones(3) / 3, step=(0, -200, 0))
    assert (weights @ mesh.vertices[mesh.faces[end]])[1] == pytest.approx(-60)


def test_a_walk_may_start_on_a_corner(flat):
    mesh, _ = flat
    neighbors = face_neighbors(mesh.faces)
    vertex = nearest(mesh, 20, 20)
    face = int(np.flatnonzero(mesh.faces[:, 0] == vertex)[0])
    for turn in np.linspace(0, 2 * np.pi, 17):
        step = 7 * np.array([np.cos(turn), np.sin(turn), 0])
        end, weights = walk(mesh.vertices, mesh.faces, neighbors, face=face, barycentric=(1, 0, 0), step=step)
        assert weights @ mesh.vertices[mesh.faces[end]] == pytest.approx(mesh.vertices[vertex] + step, abs=2e-3)


def test_neighbors_are_mutual(bent):
    mesh, _ = bent
    neighbors = face_neighbors(mesh.faces)
    for face, side in np.argwhere(neighbors >= 0)[::7]:
        assert face in neighbors[neighbors[face, side]]
        assert mesh.faces[face, side] not in mesh.faces[neighbors[face, side]]
