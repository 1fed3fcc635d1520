"""Catmull-Clark subdivision with creases as one sparse linear map, and the cage whose surface passes given points.

Rules of Catmull and Clark (1978) with the semi-sharp creases of DeRose, Kass and Truong (1998, section 3). An
infinitely sharp ring subdivides as a cubic B-spline of its own points only, so two rings with equal points stay equal:
lids and lips seal exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse

LEVELS = 2
ROUNDS, GAIN = 4, 0.8  # of the surface fit: close to the points, yet no ringing


@dataclass(frozen=True, eq=False)
class Surface:
    """A subdivided cage.

    Parameters
    ----------
    matrix : (V, N) sparse
        Takes values at the cage's points to the fine vertices; cage point i is fine vertex i.
    quads : (Q, 4) int64
        The children of a cage quad stand together, in the order of the cage's quads.
    chains : tuple of (K,) int64
        The given chains of cage points, refined.
    middles : {(int, int): int}
        The fine vertex in the middle of each edge of the cage, by its ends, lower first, and of each edge of what
        lies between the cage and the surface.
    twins : (V,) int64
        The mirror image of each fine vertex.
    """

    matrix: sparse.csr_matrix
    quads: np.ndarray
    chains: tuple[np.ndarray, ...]
    middles: dict[tuple[int, int], int]
    twins: np.ndarray

    def cage_through(self, targets: np.ndarray) -> np.ndarray:
        """The cage (N, K) whose surface passes close to `targets` (N, K) at its own vertices (Richardson steps)."""
        count = len(targets)
        own = self.matrix[:count]
        cage = targets
        for _ in range(ROUNDS):
            cage = cage + GAIN * (targets - own @ cage)
        return cage

    def through(self, targets: np.ndarray) -> np.ndarray:
        """The fine surface (V, ...) through `targets` (N, ...); linear in them."""
        flat = targets.reshape(len(targets), -1)
        return np.asarray(self.matrix @ self.cage_through(flat)).reshape(-1, *targets.shape[1:])

    def reflected(self, vectors: np.ndarray) -> np.ndarray:
        """The mirror image of vectors or positions (V, ..., 3)."""
        return vectors[self.twins] * [-1.0, 1.0, 1.0]

    def evened(self, vectors: np.ndarray) -> np.ndarray:
        """Symmetric vectors (V, ..., 3) without the asymmetry that rounding left in them."""
        return 0.5 * (vectors + self.reflected(vectors))


def subdivide(
    count: int,
    quads: np.ndarray,
    sharpness: dict[tuple[int, int], float],
    corners: np.ndarray,
    twins: np.ndarray,
    chains: Sequence[np.ndarray] = (),
    levels: int = LEVELS,
) -> Surface:
    """Subdivide a cage of `count` points.

    Parameters
    ----------
    count : int
    quads : (Q, 4) int64
    sharpness : {(low, high): float}
        Creased edges; an edge on the boundary is sharp in any case.
    corners : (K,) int64
        Points that do not move.
    twins : (count,) int64
        The mirror image of each point; the quads are mirror symmetric.
    chains : sequence of (K,) int64
        Runs of neighbouring points to follow through the levels.
    levels : int
    """
    matrix = sparse.csr_matrix(sparse.identity(count))
    middles: dict[tuple[int, int], int] = {}
    for _ in range(levels):
        step, finer, sharpness, edges = _level(count, quads, sharpness, corners)
        twins = np.concatenate([twins, _twin_edges(edges, twins), len(edges) + count + _twin_quads(quads, twins)])
        quads = finer
        middles |= edges
        chains = [_refined(chain, edges) for chain in chains]
        matrix = sparse.csr_matrix(step @ matrix)
        count = len(twins)
    return Surface(matrix, quads, tuple(chains), middles, twins)


def refined(corners: np.ndarray, levels: int = LEVELS) -> np.ndarray:
    """Values at the corners of quads (Q, 4, K), interpolated to the corners of their children (Q 4^levels, 4, K)."""
    for _ in range(levels):
        after = (corners + np.roll(corners, -1, axis=1)) / 2
        center = np.repeat(corners.mean(1, keepdims=True), 4, axis=1)
        corners = np.stack([corners, after, center, np.roll(after, 1, axis=1)], 2).reshape(-1, 4, corners.shape[2])
    return corners


def _level(count: int, quads: np.ndarray, sharpness: dict, corners: np.ndarray):
    """One level: its matrix, quads, sharpness and edge numbers. New points are ordered: vertices, edges, faces."""
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], -1).reshape(-1, 2)
    edges, side = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    side = side.reshape(quads.shape)
    face_points = _incidence(quads, count) / 4
    edge_faces = _incidence(side, len(edges)).T
    faces_of_edge = np.asarray(edge_faces.sum(1)).ravel()
    middle = _incidence(edges, count) / 2
    sharp = np.array([sharpness.get((int(a), int(b)), 0.0) for a, b in edges])
    sharp[faces_of_edge == 1] = np.inf
    crease = sparse.diags(np.clip(sharp, 0, 1))
    smooth = 0.5 * middle + 0.5 * sparse.diags(1 / faces_of_edge) @ edge_faces @ face_points
    edge_points = smooth - crease @ smooth + crease @ middle
    vertex_points = _vertex_points(count, edges, sharp, corners, middle, face_points, quads)
    step = sparse.vstack([vertex_points, edge_points, face_points]).tocsr()
    step.eliminate_zeros()
    at_edge, at_face = count + side, count + len(edges) + np.arange(len(quads))
    children = [np.stack([quads[:, k], at_edge[:, k], at_face, at_edge[:, k - 1]], 1) for k in range(4)]
    number = {(int(a), int(b)): count + i for i, (a, b) in enumerate(edges)}
    finer = {}
    for (a, b), value in sharpness.items():
        if value > 1:
            new = number[(a, b)]
            finer[(a, new)] = finer[(b, new)] = value - 1
    return step, np.stack(children, 1).reshape(-1, 4), finer, number


def _vertex_points(count, edges, sharp, corners, middle, face_points, quads) -> sparse.csr_matrix:
    touching_edges = _incidence(edges, count).T
    touching_faces = _incidence(quads, count).T
    valence, faces = (np.asarray(m.sum(1)).ravel() for m in (touching_edges, touching_faces))
    around = sparse.diags(1 / (valence * faces)) @ touching_faces @ face_points
    smooth = around + sparse.diags(2 / valence**2) @ touching_edges @ middle + sparse.diags((valence - 3) / valence)
    creased = edges[sharp > 0]
    number = np.bincount(creased.ravel(), minlength=count)
    mean = np.bincount(creased.ravel(), np.repeat(np.minimum(sharp[sharp > 0], 10), 2), minlength=count)
    blend = np.where(number >= 2, np.clip(mean / np.maximum(number, 1), 0, 1), 0)
    on_line = number == 2
    on_line[corners] = False
    fixed = number > 2
    fixed[corners] = True
    blend[corners] = 1
    a, b = np.concatenate([creased, creased[:, ::-1]]).T
    keep = on_line[a]
    neighbours = sparse.csr_matrix((np.full(keep.sum(), 0.125), (a[keep], b[keep])), shape=(count, count))
    rule = neighbours + sparse.diags(0.75 * on_line + 1.0 * fixed)
    return (sparse.diags(1 - blend) @ smooth + sparse.diags(blend) @ rule).tocsr()


def _incidence(members: np.ndarray, count: int) -> sparse.csr_matrix:
    """Sparse (rows, count) with a one for each member of each row."""
    rows = np.repeat(np.arange(len(members)), members.shape[1])
    ones = np.ones(members.size)
    return sparse.csr_matrix((ones, (rows, members.ravel())), shape=(len(members), count))


def _refined(chain: np.ndarray, edges: dict[tuple[int, int], int]) -> np.ndarray:
    """A chain with the new point of each of its edges between the ends."""
    fine = [int(chain[0])]
    for a, b in pairwise(chain):
        fine += [edges[_edge(int(a), int(b))], int(b)]
    return np.array(fine)


def _edge(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _twin_edges(edges: dict[tuple[int, int], int], twins: np.ndarray) -> np.ndarray:
    """The point on the mirror image of each edge."""
    return np.array([edges[_edge(int(twins[a]), int(twins[b]))] for a, b in edges])


def _twin_quads(quads: np.ndarray, twins: np.ndarray) -> np.ndarray:
    """The mirror image of each quad."""
    place = {tuple(row): i for i, row in enumerate(np.sort(quads, axis=1).tolist())}
    return np.array([place[tuple(row)] for row in np.sort(twins[quads], axis=1).tolist()])
