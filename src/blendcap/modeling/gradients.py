"""How a surface is deformed, triangle by triangle: the gradient operator and deformation gradients."""

from __future__ import annotations

import numpy as np
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
    first, second, normal = _edges(vertices, faces)
    areas, flat = _areas(first, second, normal)
    squared = np.where(flat, np.inf, (normal**2).sum(1))[:, None]
    # the gradient of a corner's hat function is its opposite edge, turned by 90 degrees in the plane, over 2 A
    two, three = np.cross(second, normal) / squared, np.cross(normal, first) / squared
    hats = np.stack([-two - three, two, three], axis=2)
    rows = np.repeat(np.arange(3 * len(faces)), 3)
    columns = np.repeat(faces, 3, axis=0).ravel()
    matrix = sparse.csr_matrix((hats.ravel(), (rows, columns)), shape=(3 * len(faces), len(vertices)))
    return matrix, areas


def inverse_frames(rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The inverse of each triangle's frame at rest, (F, 3, 3) 1/mm (Eq. 20); zero for flat triangles."""
    first, second, normal = _edges(rest, faces)
    _, flat = _areas(first, second, normal)
    frames = _frames(first, second, normal)
    frames[flat] = np.eye(3)
    inverse = np.linalg.inv(frames)
    inverse[flat] = 0
    return inverse


def deformation_gradients(inverse: np.ndarray, deformed: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The affine map Q of each triangle (F, 3, 3) from rest to deformed (Eq. 18 to 21).

    `inverse` is that of the rest's frames. A triangle that was flat at rest keeps the identity.
    """
    maps = _frames(*_edges(deformed, faces)) @ inverse
    maps[~inverse.any((1, 2))] = np.eye(3)
    return maps


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
