"""Gradients, and what transfer asks of them, against closed forms."""

import numpy as np
import pytest

from blendcap.modeling.gradients import gradient_operator, hat_gradients, inverse_frames, transferred_pull
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


def pulled(rest, delta, faces, other, weights):
    """The pull (V, 3) of a shape on another face, and its cost."""
    planes = np.cross(other[faces[:, 1]] - other[faces[:, 0]], other[faces[:, 2]] - other[faces[:, 0]])
    planes /= np.maximum(np.linalg.norm(planes, axis=1), 1e-300)[:, None]
    pull = np.zeros(rest.shape)
    hats, _ = hat_gradients(other, faces)
    return pull, transferred_pull(rest, delta, faces, inverse_frames(rest, faces), hats, weights, planes, pull)


def test_a_turn_pulls_another_face_to_the_same_turn():
    mesh, rng = faces_and_normals()[0], np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= 1.7 * np.linalg.det(turn)
    delta, other = mesh.vertices @ turn.T - mesh.vertices, mesh.vertices * [1.3, 0.9, -0.7] + [5, 0, 0]
    weights = rng.uniform(0.5, 2, len(mesh.faces))
    pull, cost = pulled(mesh.vertices, delta, mesh.faces, other, weights)
    gradient, _ = gradient_operator(other, mesh.faces)
    wanted = gradient.T @ (np.repeat(weights, 3)[:, None] * (gradient @ (other @ turn.T - other - delta)))
    np.testing.assert_allclose(pull, wanted, atol=1e-10)
    missing = (gradient @ (other @ turn.T - other - delta)) * np.sqrt(np.repeat(weights, 3))[:, None]
    assert cost == pytest.approx((missing**2).sum())


def test_a_stretch_pulls_its_own_face_nowhere():
    mesh = faces_and_normals()[0]
    stretch = np.array([[1.2, 0.1, 0], [0, 0.8, 0.3], [0.2, 0, 1.1]])
    delta = mesh.vertices @ stretch.T - mesh.vertices
    pull, cost = pulled(mesh.vertices, delta, mesh.faces, mesh.vertices, np.ones(len(mesh.faces)))
    np.testing.assert_allclose(pull, 0, atol=1e-12)
    assert abs(cost) < 1e-12


def test_triangles_that_are_flat_or_do_not_move_ask_for_nothing():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [3, 1, 0.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 4, 3]])
    operator, areas = gradient_operator(vertices, faces)
    assert areas[0] == 0 and not operator[:3].toarray().any()
    delta = np.zeros_like(vertices)
    delta[2] = [0, 5, 0]  # a corner of the flat triangle only
    pull, cost = pulled(vertices, delta, faces, 2 * vertices, np.ones(3))
    assert not pull.any() and cost == 0
    delta[0] = [-1, 0, 0]
    pull, cost = pulled(vertices, delta, faces, 2 * vertices, np.ones(3))
    assert pull[[0, 1, 3]].any(1).all() and not pull[4].any() and cost > 0
