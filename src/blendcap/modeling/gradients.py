"""How a surface is deformed, triangle by triangle: the gradient operator, and what transfer asks of gradients."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy import sparse

FLAT = 1e-6  # a triangle whose height is this part of its longest edge, or less, has no plane


def gradient_operator(vertices: np.ndarray, faces: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """The operator that takes values at vertices to their gradient in the plane of each triangle.

    It needs no fourth vertex: least squares over it has the same solution as the thesis' Eq. 25, with V unknowns
    instead of V + F, where every triangle counts alike. Weighted by the areas, `G' A G` is the cotangent Laplacian and
    the solution that of Botsch and others (2006), "Deformation transfer for detail-preserving surface editing": it
    depends on the surface rather than on how it is cut into triangles.

    Parameters
    ----------
    vertices : (V, 3) float64
        mm.
    faces : (F, 3) int64

    Returns
    -------
    G : (3 F, V) sparse
        1/mm; rows 3 f to 3 f + 2 are the derivatives along x, y and z on triangle f. Zero on flat triangles.
    areas : (F,) float64
        mm²; 0 for flat triangles.
    """
    hats, areas = hat_gradients(vertices, faces)
    rows = np.repeat(np.arange(3 * len(faces)), 3)
    columns = np.repeat(faces, 3, axis=0).ravel()
    matrix = sparse.csr_matrix((hats.ravel(), (rows, columns)), shape=(3 * len(faces), len(vertices)))
    return matrix, areas


def hat_gradients(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The gradients (F, 3, 3) 1/mm of hat functions, a column for each corner, and areas; see `gradient_operator`."""
    first, second, normal = _edges(vertices, faces)
    areas, flat = _areas(first, second, normal)
    squared = np.where(flat, np.inf, (normal**2).sum(1))[:, None]
    # the gradient of a corner's hat function is its opposite edge, turned by 90 degrees in the plane, over 2 A
    two, three = np.cross(second, normal) / squared, np.cross(normal, first) / squared
    return np.stack([-two - three, two, three], axis=2), areas


def inverse_frames(rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The inverse of each triangle's frame at rest, (F, 3, 3) 1/mm (Eq. 20); zero for flat triangles."""
    first, second, normal = _edges(rest, faces)
    _, flat = _areas(first, second, normal)
    frames = _frames(first, second, normal)
    frames[flat] = np.eye(3)
    inverse = np.linalg.inv(frames)
    inverse[flat] = 0
    return inverse


@njit(cache=True, error_model="numpy")
def transferred_pull(rest, delta, faces, inverse, hats, weights, planes, pull):
    """Add `G' W (Q' - I - G delta)` to `pull` (V, 3), and return what `W |Q' - I - G delta|²` costs in the planes.

    Q is the affine map of each triangle from rest to deformed (Eq. 18 to 21); a flat one keeps the identity. The pull
    is what Eq. 25 lacks where the shape `delta` (V, 3) of one face is merely copied to another.

    Parameters
    ----------
    rest, faces, inverse : (V, 3), (F, 3), (F, 3, 3)
        The face that the shape is of, and `inverse_frames` of it.
    hats, weights, planes : (F, 3, 3), (F,), (F, 3)
        Of the other face: `hat_gradients`, what a triangle counts, and unit normals.
    """
    cost, frame, part = 0.0, np.empty((3, 3)), np.empty((3, 3))
    for f in range(len(faces)):
        corners = faces[f]
        if not (delta[corners[0]].any() or delta[corners[1]].any() or delta[corners[2]].any()):
            continue
        _frame(rest, delta, corners, frame)
        flat = not inverse[f].any()
        for k in range(3):
            for c in range(3):
                part[k, c] = 0.0 if flat else -1.0 * (k == c)
                for j in range(3):
                    part[k, c] += frame[c, j] * inverse[f, j, k] - hats[f, k, j] * delta[corners[j], c]
        for c in range(3):
            across = planes[f, 0] * part[0, c] + planes[f, 1] * part[1, c] + planes[f, 2] * part[2, c]
            cost += weights[f] * (part[0, c] ** 2 + part[1, c] ** 2 + part[2, c] ** 2 - across**2)
            for j in range(3):
                along = hats[f, 0, j] * part[0, c] + hats[f, 1, j] * part[1, c] + hats[f, 2, j] * part[2, c]
                pull[corners[j], c] += weights[f] * along
    return cost


@njit(cache=True, error_model="numpy")
def _frame(rest, delta, corners, frame):
    """Two edges of a deformed triangle and its normal, as long as an edge, as columns of `frame` (Eq. 18)."""
    first, second, third = corners
    for c in range(3):
        frame[c, 0] = rest[second, c] + delta[second, c] - rest[first, c] - delta[first, c]
        frame[c, 1] = rest[third, c] + delta[third, c] - rest[first, c] - delta[first, c]
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        frame[c, 2] = frame[a, 0] * frame[b, 1] - frame[b, 0] * frame[a, 1]
    length = np.sqrt(max(np.sqrt(frame[0, 2] ** 2 + frame[1, 2] ** 2 + frame[2, 2] ** 2), 1e-300))
    for c in range(3):
        frame[c, 2] /= length


def _edges(vertices, faces) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return b - a, c - a, np.cross(b - a, c - a)


def _areas(first, second, normal) -> tuple[np.ndarray, np.ndarray]:
    """Areas, 0 where flat, and where that is."""
    longest = np.maximum(np.maximum((first**2).sum(1), (second**2).sum(1)), ((second - first) ** 2).sum(1))
    twice = np.linalg.norm(normal, axis=1)
    flat = twice <= FLAT * longest
    return np.where(flat, 0.0, twice / 2), flat


def _frames(first, second, normal) -> np.ndarray:
    """Columns: two edges and the normal, as long as an edge (Eq. 18)."""
    length = np.sqrt(np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))
    return np.stack([first, second, normal / length], axis=2)
