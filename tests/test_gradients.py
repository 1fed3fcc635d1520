"""Gradients and deformation gradients against closed forms."""

import numpy as np

from blendcap.modeling.gradients import deformation_gradients, gradient_operator, inverse_frames
from sheet import sheet_mesh


def faces_and_normals():
    mesh, _ = sheet_mesh()
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return mesh, normals / np.linalg.norm(normals, axis=1)[:, None], 0.5 * np.linalg.norm(normals, axis=1)


def test_the_gradient_of_a_linear_function_is_its_slope_in_the_plane():
    mesh, normals, areas = faces_and_normals()
    slope = np.array([0.3, -2.0, 0.7])
    operator, measured = gradient_operator(mesh.vertices, mesh.faces)
    found = (operator @ (mesh.vertices @ slope)).reshape(-1, 3)
    np.testing.assert_allclose(found, slope - (normals @ slope)[:, None] * normals, atol=1e-12)
    np.testing.assert_allclose(measured, areas, rtol=1e-12)


def test_the_weighted_operator_is_the_cotangent_laplacian():
    vertices = np.array([[0, 0, 0], [4, 0, 0], [1, 3, 0], [5, 2, 1.0]])
    faces = np.array([[0, 1, 2], [1, 3, 2]])
    operator, areas = gradient_operator(vertices, faces)
    laplacian = (operator.T.multiply(np.repeat(areas, 3)) @ operator).toarray()

    def cotangent(at, one, two):
        u, v = vertices[one] - vertices[at], vertices[two] - vertices[at]
        return u @ v / np.linalg.norm(np.cross(u, v))

    shared = -(cotangent(0, 1, 2) + cotangent(3, 1, 2)) / 2
    np.testing.assert_allclose(laplacian[1, 2], shared, rtol=1e-12)
    np.testing.assert_allclose(laplacian.sum(0), 0, atol=1e-12)


def test_a_turn_is_its_own_deformation_gradient():
    mesh, _, _ = faces_and_normals()
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    maps = deformation_gradients(inverse_frames(mesh.vertices, mesh.faces), 1.7 * mesh.vertices @ turn.T, mesh.faces)
    np.testing.assert_allclose(maps, np.broadcast_to(1.7 * turn, maps.shape), atol=1e-12)


def test_a_stretch_is_found_in_the_plane_of_each_triangle():
    mesh, normals, _ = faces_and_normals()
    stretch = np.array([[1.2, 0.1, 0], [0, 0.8, 0.3], [0.2, 0, 1.1]])
    maps = deformation_gradients(inverse_frames(mesh.vertices, mesh.faces), mesh.vertices @ stretch.T, mesh.faces)
    inside = np.eye(3) - normals[:, :, None] * normals[:, None]
    np.testing.assert_allclose(maps @ inside, stretch @ inside, atol=1e-12)


def test_flat_triangles_have_no_gradient_and_keep_the_identity():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3]])
    operator, areas = gradient_operator(vertices, faces)
    assert areas[0] == 0 and not operator[:3].toarray().any()
    maps = deformation_gradients(inverse_frames(vertices, faces), 2 * vertices, faces)
    np.testing.assert_allclose(maps[0], np.eye(3))
    np.testing.assert_allclose(maps[1], 2 * np.eye(3), atol=1e-12)
