"""What deformation transfer adds to shapes that are simply copied: one sparse factor for all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from blendcap.modeling.gradients import gradient_operator, hat_gradients, inverse_frames, transferred_pull
from blendcap.numerics.leastsq import factorize
from blendcap.numerics.surfaces import face_normals

GAUGE = 1e-8  # of the diagonal: what holds a piece that no still vertex holds
STILL = 0.02  # of a shape's largest motion: vertices below count as still where a piece has to be placed
HOLD = 1.0  # of the diagonal: how firmly a piece that hangs on the skin follows it


@dataclass(frozen=True, eq=False)
class Faces:
    """A template and a new face in one place: same vertices, aligned.

    Parameters
    ----------
    template : (V, 3) float64
        The template's neutral, turned, scaled and moved onto the new one.
    deltas : (N, V, 3) float64
        Its shapes, turned and scaled alike.
    rest : (V, 3) float64
        The new neutral.
    faces : (F, 3) int64
        Triangles, texture seams sewn.
    pieces : list of (K,) int64
        Vertices of each connected piece, the skin first.
    unit : float
        Size of the new face against the template's.
    """

    template: np.ndarray
    deltas: np.ndarray
    rest: np.ndarray
    faces: np.ndarray
    pieces: list[np.ndarray]
    unit: float


@dataclass(frozen=True, eq=False)
class Differences:
    """The transferred shapes minus the copied ones.

    Parameters
    ----------
    field : (N, V, 3) float64
        mm.
    stiffness : (V, V) sparse
        The cotangent Laplacian of the new face.
    areas : (V,) float64
        mm² of each vertex.
    residual : float
        Largest relative residual of the solves.
    """

    field: np.ndarray
    stiffness: sparse.csc_matrix
    areas: np.ndarray
    residual: float


@dataclass(frozen=True, eq=False)
class Costs:
    """Eq. 24 of every shape, a quadratic function of what is added to the copied shapes.

    Parameters
    ----------
    copied : (N,) float64
        What nothing added costs.
    right : (V, 3 N) float64
        Half the slope there, downwards.
    stiffness : (V, V) sparse
    """

    copied: np.ndarray
    right: np.ndarray
    stiffness: sparse.csc_matrix

    def at(self, added: np.ndarray) -> np.ndarray:
        """What the shapes cost (N,) with fields (N, V, 3) added, whether these solve Eq. 25 or not."""
        columns = _columns(added)
        gained = columns * (2 * self.right - self.stiffness @ columns)
        return np.maximum(self.copied - gained.sum(0).reshape(-1, 3).sum(1), 0)


def differences(faces: Faces, weights: np.ndarray | None = None) -> tuple[Differences, Costs]:
    """Solve Eq. 25 for all shapes at once, in the unknowns `u = transferred - copied`.

    Vertices that no shape moves have u = 0 and are no unknowns. A piece without such a vertex may float: it is placed
    so that what is nearly still in a shape stays. `weights` (F,) is what each triangle counts; its area by default.
    """
    gradient, areas = gradient_operator(faces.rest, faces.faces)
    weights = areas if weights is None else weights
    stiffness = sparse.csc_matrix(gradient.T @ sparse.diags(np.repeat(weights, 3)) @ gradient)
    right, copied = _right_sides(faces, weights)
    free, floating = _unknowns(faces, stiffness)
    inner = sparse.csc_matrix(stiffness[free][:, free])
    factor = factorize(inner + sparse.diags(GAUGE * inner.diagonal() * floating[free]))
    solved = np.zeros_like(right)
    solved[free] = factor.solve(right[free])
    field = _fields(solved)
    for piece in faces.pieces:
        if floating[piece[0]]:
            _place(field, faces.deltas, piece)
    found = Differences(field, stiffness, _of_vertices(faces.faces, areas, len(right)), factor.residual)
    return found, Costs(copied, right, stiffness)


def surface_of(rest: np.ndarray, faces: np.ndarray) -> tuple[sparse.csc_matrix, np.ndarray]:
    """The cotangent Laplacian (V, V) of a surface and the area (V,) of each vertex, mm²."""
    gradient, areas = gradient_operator(rest, faces)
    weighted = gradient.T @ sparse.diags(np.repeat(areas, 3))
    return sparse.csc_matrix(weighted @ gradient), _of_vertices(faces, areas, len(rest))


def _of_vertices(faces: np.ndarray, areas: np.ndarray, count: int) -> np.ndarray:
    return np.bincount(faces.ravel(), np.repeat(areas / 3, 3), count)


def hang(solved: Differences, field: np.ndarray, piece: np.ndarray, holders: np.ndarray) -> float:
    """Let a piece follow the skin: solve it again, held to the skin's field at its near vertices (in place).

    `holders` (K,) is for each vertex of the piece the skin vertex that holds it, -1 where none is near. Returns the
    relative residual of the solve.
    """
    inner = sparse.csc_matrix(solved.stiffness[piece][:, piece])
    hold = HOLD * inner.diagonal() * (holders >= 0)
    followed = field[:, np.maximum(holders, 0)]
    right = inner @ _columns(solved.field[:, piece]) + hold[:, None] * _columns(followed)
    factor = factorize(inner + sparse.diags(hold))
    field[:, piece] = _fields(factor.solve(right))
    return factor.residual


def _columns(fields: np.ndarray) -> np.ndarray:
    """(N, V, 3) as (V, 3 N)."""
    return fields.transpose(1, 0, 2).reshape(fields.shape[1], -1)


def _fields(columns: np.ndarray) -> np.ndarray:
    """(V, 3 N) as (N, V, 3)."""
    return np.ascontiguousarray(columns.reshape(len(columns), -1, 3).transpose(1, 0, 2))


def _right_sides(faces: Faces, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The right-hand sides (V, 3 N) of all shapes, and what Eq. 24 costs at the copied ones, (N,)."""
    inverse = inverse_frames(faces.template, faces.faces)
    hats, _ = hat_gradients(faces.rest, faces.faces)
    planes = face_normals(faces.rest, faces.faces)
    planes /= np.maximum(np.linalg.norm(planes, axis=1), 1e-300)[:, None]
    right = np.zeros((len(faces.deltas), len(faces.rest), 3))
    copied = np.empty(len(faces.deltas))
    for i, delta in enumerate(faces.deltas):
        given = faces.template, delta, faces.faces, inverse, hats, weights, planes
        copied[i] = transferred_pull(*given, right[i])
    return _columns(right), copied


def _unknowns(faces: Faces, stiffness) -> tuple[np.ndarray, np.ndarray]:
    """Vertices to solve for, and where (V,) a piece has no still vertex."""
    still = np.logical_not(np.asarray(faces.deltas).any(axis=(0, 2)))
    floating = np.zeros(len(still), dtype=bool)
    for piece in faces.pieces:
        floating[piece] = not still[piece].any()
    return np.flatnonzero(~still & (stiffness.diagonal() > 0)), floating


def _place(field: np.ndarray, deltas: np.ndarray, piece: np.ndarray) -> None:
    """Move a floating piece, shape by shape, so that its stillest vertices have no difference (in place)."""
    for u, delta in zip(field, deltas, strict=True):
        motion = (delta[piece] ** 2).sum(1)
        weight = 1 / (motion + STILL**2 * motion.max() + 1e-30)
        u[piece] -= weight @ u[piece] / weight.sum()
