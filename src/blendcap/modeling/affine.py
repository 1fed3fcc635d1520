"""An affine map at every vertex, stiff along the edges: the unknown of non-rigid ICP and its normal equations."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from blendcap.numerics.leastsq import Backend, Factor, Term, assemble, energies, factorize

HELD = 1e-9  # weight of a vertex without a match: too little to pull, enough that no part is loose


class AffineField:
    """Eq. 7 of the thesis for one template: `|alpha (M x G) X|² + |W (D X - U)|² + |beta (D_L X - U_L)|²`, G = 1.

    X (4 n, 3) stacks the transposed affine maps. They are blends `X = (P x I) Y` of m maps Y (4 m, 3), the unknowns: n
    of their own, or fewer in a coarse basis P. The matrix has one pattern, so that its analysis is made once.

    Parameters
    ----------
    vertices : (n, 3) float64
        The template, centred and scaled to a size of about 1: alpha is relative to that.
    edges : (E, 2) int64
    edge_weights : (E,) float64
        Of the squared differences of neighbouring maps.
    landmarks : (L, n) sparse
        Takes values at vertices to the landmarks; no rows if there are none.
    backend : str
        Of `numerics.leastsq`.
    basis : (n, m) sparse, optional
        P: every row adds up to 1. A map of its own for every vertex if not given.
    """

    def __init__(self, vertices, edges, edge_weights, landmarks: Any, backend: Backend = "auto", basis: Any = None):
        count = len(vertices)
        basis = sparse.csr_matrix(sparse.eye(count) if basis is None else basis)
        homogeneous = np.column_stack([vertices, np.ones(count)])
        place = sparse.csr_matrix(
            (homogeneous.ravel(), np.arange(4 * count), np.arange(0, 4 * count + 1, 4)), shape=(count, 4 * count)
        )
        rows = np.repeat(np.arange(len(edges)), 2)
        incidence = sparse.csr_matrix((np.tile([-1.0, 1.0], len(edges)), (rows, edges.ravel())), (len(edges), count))
        self._blend: Any = sparse.kron(basis, sparse.eye(4), "csr")
        self._place = sparse.csr_matrix(place @ self._blend)
        self._held = sparse.csr_matrix(landmarks @ self._place)
        self._stiff = Term("stiffness", sparse.kron(incidence @ basis, sparse.eye(4), "csr"),
                           np.zeros((4 * len(edges), 3)), np.repeat(edge_weights, 4))  # fmt: skip
        self._squares = (homogeneous[:, :, None] * homogeneous[:, None, :]).reshape(-1, 16)
        self._backend: Backend = backend
        self._factor: Factor | None = None
        self._solved: tuple[tuple[float, float], np.ndarray] | None = None
        self._lay_out(basis)

    def _lay_out(self, basis: Any) -> None:
        """The one pattern of the matrix, and where in it the stiffness, the landmarks and each block stand."""
        stiff, _ = assemble([self._stiff])
        held = sparse.csc_matrix(self._held.T @ self._held)
        above, below, self._shares = _products(basis)
        corners = np.arange(4)
        down = (4 * above[:, None, None] + corners[:, None] + 0 * corners).ravel()
        right = (4 * below[:, None, None] + 0 * corners[:, None] + corners).ravel()
        blocks = sparse.csc_matrix((np.ones(len(down)), (down, right)), shape=stiff.shape)
        pattern = abs(stiff) + abs(held) + blocks
        pattern.sort_indices()
        self._pattern = pattern
        self._stiffness, self._pull = self._values(stiff), self._values(held)
        self._blocks = self._where(down, right)

    def _where(self, rows, columns) -> np.ndarray:
        size, pattern = np.int64(self._pattern.shape[0]), self._pattern
        keys = pattern.indices + np.repeat(np.arange(size), np.diff(pattern.indptr)) * size
        return np.searchsorted(keys, rows + columns * size)

    def _values(self, matrix) -> np.ndarray:
        entries, result = matrix.tocoo(), np.zeros(self._pattern.nnz)
        result[self._where(entries.row.astype(np.int64), entries.col.astype(np.int64))] = entries.data
        return result

    @property
    def identity(self) -> np.ndarray:
        """Y (4 m, 3) that leaves every vertex where it is."""
        return np.tile(np.eye(4)[:, :3], (self._blend.shape[1] // 4, 1))

    def maps(self, unknowns: np.ndarray) -> np.ndarray:
        """The maps X (4 n, 3) of all vertices that the unknowns Y blend to."""
        return self._blend @ unknowns

    def moved(self, maps: np.ndarray) -> np.ndarray:
        """The vertices (n, 3) under maps Y."""
        return self._place @ maps

    def solve(self, stiffness, weights, targets, pull, held) -> np.ndarray:
        """The maps Y (4 m, 3) of the least energy.

        Parameters
        ----------
        stiffness : float
            alpha.
        weights : (n,) float64
            Squared diagonal of W.
        targets : (n, 3) float64
            U.
        pull : float
            beta.
        held : (L, 3) float64
            U_L.
        """
        weights = weights + HELD
        data = stiffness**2 * self._stiffness + pull**2 * self._pull
        data[self._blocks] += (self._shares @ (self._squares * weights[:, None])).ravel()
        matrix = sparse.csc_matrix((data, self._pattern.indices, self._pattern.indptr), shape=self._pattern.shape)
        rhs = self._place.T @ (weights[:, None] * targets) + pull**2 * (self._held.T @ held)
        if self._factor is not None and self._solved is not None and self._solved[0] == (stiffness, pull):
            answer = self._factor.solve_near(matrix, rhs, self._solved[1])  # only a few matches have come or gone
        else:
            if self._factor is None:
                self._factor = factorize(matrix, self._backend, block=4)
            else:
                self._factor.update(matrix)
            answer = self._factor.solve(rhs)
        self._solved = ((stiffness, pull), answer)
        return answer

    @property
    def residual(self) -> float:
        """The relative residual of the last solve."""
        return float("nan") if self._factor is None else self._factor.residual

    @property
    def backend(self) -> str:
        """The sparse solver that is used."""
        return self._backend if self._factor is None else self._factor.backend

    def energies(self, maps, weights, targets, held) -> dict[str, float]:
        """What each term of Eq. 7 costs at the maps Y, without its alpha² or beta²."""
        terms = [Term("data", self._place, targets, weights), self._stiff, Term("landmarks", self._held, held)]
        return energies(terms, maps)


def _products(basis: Any) -> tuple[np.ndarray, np.ndarray, sparse.csr_matrix]:
    """Pairs of functions that meet somewhere, (K,) and (K,), and the products of their values at each vertex (K, n)."""
    width = np.diff(basis.indptr)
    row = np.repeat(np.arange(basis.shape[0]), width)
    first = np.repeat(np.arange(basis.nnz), width[row])
    turn = np.arange(len(first)) - np.repeat(np.cumsum(width[row]) - width[row], width[row])
    second = basis.indptr[row[first]] + turn
    size = np.int64(basis.shape[1])
    keys, place = np.unique(basis.indices[first] * size + basis.indices[second], return_inverse=True)
    values = basis.data[first] * basis.data[second]
    shares = sparse.csr_matrix((values, (place, row[first])), shape=(len(keys), basis.shape[0]))
    return keys // size, keys % size, shares
