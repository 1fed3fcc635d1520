"""The coarse basis: a partition of unity at home on the graph, and what it saves."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import shortest_path

import masks
from blendcap.modeling.affine import AffineField
from blendcap.numerics.coarsening import coarse_basis
from blendcap.numerics.surfaces import edges_of

PARAMETERS, FACES = masks.sheet(15, 18)
VERTICES, EDGES = masks.mask(PARAMETERS) / 200, edges_of(FACES)[0]
JOINED = np.random.default_rng(0).uniform(0.5, 2, len(EDGES))


def test_it_is_a_partition_of_unity_at_home_on_the_graph():
    basis = coarse_basis(len(VERTICES), EDGES, JOINED)
    assert len(VERTICES) / 10 < basis.shape[1] < len(VERTICES) / 5
    np.testing.assert_allclose(basis.sum(1), 1)
    assert basis.data.min() > 0
    graph = sparse.csr_matrix((np.ones(len(EDGES)), EDGES.T), shape=(len(VERTICES),) * 2)
    steps = shortest_path(graph, directed=False, unweighted=True)
    for function in basis.toarray().T:
        home = np.flatnonzero(function)
        assert steps[np.ix_(home, home)].max() <= 6  # joined over at most two edges from its middle, smoothed by one


def test_parts_of_a_graph_share_no_function_and_a_lone_node_has_its_own():
    count = len(VERTICES)
    basis = coarse_basis(2 * count + 1, np.concatenate([EDGES, EDGES + count]), np.tile(JOINED, 2)).toarray()
    one, other = basis[:count].any(0), basis[count:-1].any(0)
    assert not (one & other).any() and basis[-1].max() == 1 and not basis[:-1, basis[-1] > 0].any()


def test_a_stiff_field_is_nearly_as_good_in_it():
    rng, count = np.random.default_rng(1), len(VERTICES)
    targets = VERTICES + 0.05 * np.sin(3 * VERTICES[:, ::-1]) + 0.01 * rng.normal(size=VERTICES.shape)
    sampling, held = sparse.csr_matrix(([1.0], ([0], [7])), shape=(1, count)), targets[[7]]
    weights = rng.uniform(0.2, 1, count)
    cost = []
    for basis in (None, coarse_basis(count, EDGES, JOINED)):
        field = AffineField(VERTICES, EDGES, JOINED, sampling, "splu", basis)
        answer = field.solve(5.0, weights, targets, 2.0, held)
        found = field.energies(answer, weights, targets, held)
        cost.append(25 * found["stiffness"] + found["data"] + 4 * found["landmarks"])
        np.testing.assert_allclose(field.moved(field.identity), VERTICES, atol=1e-12)
        if basis is not None:  # the blended maps are maps like any others
            whole = AffineField(VERTICES, EDGES, JOINED, sampling, "splu")
            np.testing.assert_allclose(whole.moved(field.maps(answer)), field.moved(answer), atol=1e-12)
    assert cost[0] <= cost[1] < 1.03 * cost[0]


def test_one_coarse_solve_is_the_dense_least_squares_of_its_blends():
    rng, count = np.random.default_rng(2), len(VERTICES)
    basis = coarse_basis(count, EDGES, JOINED)
    targets, weights, held = rng.normal(size=(count, 3)), rng.uniform(0.1, 1, count), rng.normal(size=(1, 3))
    sampling = sparse.csr_matrix(([0.2, 0.8], ([0, 0], [3, 4])), shape=(1, count))
    field = AffineField(VERTICES, EDGES, JOINED, sampling, "splu", basis)
    answer = field.solve(2.0, weights, targets, 3.0, held)
    blend = np.kron(basis.toarray(), np.eye(4))
    place = np.zeros((count, 4 * count))
    for i in range(count):
        place[i, 4 * i : 4 * i + 4] = [*VERTICES[i], 1]
    apart = np.zeros((len(EDGES), count))
    apart[np.arange(len(EDGES))[:, None], EDGES] = [-1, 1]
    rows = [2 * np.sqrt(np.repeat(JOINED, 4))[:, None] * np.kron(apart, np.eye(4)),
            np.sqrt(weights)[:, None] * place, 3 * sampling.toarray() @ place]  # fmt: skip
    target = np.vstack([np.zeros((4 * len(EDGES), 3)), np.sqrt(weights)[:, None] * targets, 3 * held])
    dense = np.linalg.lstsq(np.vstack(rows) @ blend, target, rcond=None)[0]
    np.testing.assert_allclose(answer, dense, atol=1e-6)
