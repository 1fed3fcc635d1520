"""A coarse basis of functions on a graph: smooth functions are found with a fraction of the unknowns."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy import sparse

DAMPING = 2 / 3  # of the Jacobi step that smooths the basis
CLEARLY = 1 + 1e-9  # ties go to the first: rounding shall not choose


def coarse_basis(count: int, edges: np.ndarray, weights: np.ndarray) -> sparse.csr_matrix:
    """Functions (count, m) that add up to 1, each at home around one of m places of a graph, m about count / 7.

    Smoothed aggregation: Vanek, Mandel and Brezina (1996), "Algebraic multigrid by smoothed aggregation for second and
    fourth order elliptic problems", Computing 56, doi:10.1007/BF02238511. It follows the edges, so that a function at
    home on the upper lip does not reach across to the lower one.

    Parameters
    ----------
    count : int
        Nodes of the graph.
    edges : (E, 2) int64
    weights : (E,) float64
        How firmly an edge joins its ends; above 0.
    """
    ends, others = np.concatenate([edges, edges[:, ::-1]]).T
    graph = sparse.csr_matrix((np.tile(weights, 2), (ends, others)), shape=(count, count))
    home = _aggregate(graph.indptr, graph.indices, graph.data)
    hats = sparse.csr_matrix((np.ones(count), (np.arange(count), home)), shape=(count, int(home.max(initial=-1)) + 1))
    degree = np.maximum(np.asarray(graph.sum(1)).ravel(), 1e-300)
    alone = degree <= 1e-300
    around = sparse.diags(DAMPING / degree) @ (graph @ hats)
    return sparse.csr_matrix(sparse.diags(np.where(alone, 1.0, 1 - DAMPING)) @ hats + around)


@njit(cache=True)
def _aggregate(starts, neighbors, weights):
    """(n,) the group of each node: a node whose neighbours are all free founds one with them; the rest join one."""
    count = len(starts) - 1
    home = np.full(count, -1)
    groups = 0
    for node in range(count):
        around = neighbors[starts[node] : starts[node + 1]]
        if home[node] < 0 and (home[around] < 0).all():
            home[node] = groups
            home[around] = groups
            groups += 1
    founded = home.copy()
    for node in range(count):
        if home[node] >= 0:
            continue
        best = 0.0
        for k in range(starts[node], starts[node + 1]):
            if founded[neighbors[k]] >= 0 and weights[k] > CLEARLY * best:
                best = weights[k]
                home[node] = founded[neighbors[k]]
    return home
