"""Sparse least squares: against a dense solver, two backends, and the check that comes with every answer."""

import builtins

import numpy as np
import pytest
from scipy import sparse

from blendcap.data import InputError
from blendcap.numerics.leastsq import Term, assemble, energies, factorize
from spoil import WrongSolver


@pytest.fixture(params=["splu", "cholmod"])
def backend(request):
    if request.param == "cholmod":
        pytest.importorskip("cvxopt")
    return request.param


def random_terms(seed=0, unknowns=40, columns=3):
    rng = np.random.default_rng(seed)
    terms = []
    for name, rows, weight in (("a", 70, 2.5), ("b", 30, rng.uniform(0, 4, 30)), ("a", 50, 0.1)):
        matrix = sparse.random(rows, unknowns, density=0.2, random_state=seed + rows, format="csr")
        terms.append(Term(name, matrix, rng.normal(size=(rows, columns)), weight))
    return terms


def grid(size):
    """Edges of a grid of points: (edges, points) differences."""
    number = np.arange(size * size).reshape(size, size)
    pairs = np.concatenate([np.stack([number[:, :-1], number[:, 1:]], -1).reshape(-1, 2),
                            np.stack([number[:-1], number[1:]], -1).reshape(-1, 2)])  # fmt: skip
    rows = np.repeat(np.arange(len(pairs)), 2)
    return sparse.csr_matrix((np.tile([1.0, -1.0], len(pairs)), (rows, pairs.ravel())), (len(pairs), size * size))


def dense_rows(terms):
    roots = [np.sqrt(np.broadcast_to(t.weight, t.matrix.shape[:1]))[:, None] for t in terms]
    return (np.vstack([r * t.matrix.toarray() for r, t in zip(roots, terms, strict=True)]),
            np.vstack([r * t.target for r, t in zip(roots, terms, strict=True)]))  # fmt: skip


@pytest.mark.parametrize("seed", range(5))
def test_the_answer_is_that_of_a_dense_solver(seed, backend):
    terms = random_terms(seed)
    matrix, rhs = assemble(terms)
    factor = factorize(matrix, backend)
    rows, target = dense_rows(terms)
    np.testing.assert_allclose(factor.solve(rhs), np.linalg.lstsq(rows, target, rcond=None)[0], rtol=1e-9, atol=1e-9)
    assert factor.residual < 1e-14
    assert factor.backend == backend


def test_energies_are_those_of_the_dense_rows_and_the_answer_is_their_least_sum():
    terms = random_terms()
    rows, target = dense_rows(terms)
    matrix, rhs = assemble(terms)
    x = factorize(matrix).solve(rhs)
    parts = energies(terms, x)
    assert list(parts) == ["a", "b"]  # equal names add up
    assert sum(parts.values()) == pytest.approx(((rows @ x - target) ** 2).sum())
    nudged = x + 1e-4 * np.random.default_rng(0).normal(size=x.shape)
    assert sum(energies(terms, nudged).values()) > sum(parts.values())


def test_one_column_may_be_a_vector(backend):
    terms = [Term(t.name, t.matrix, t.target[:, 0], t.weight) for t in random_terms()]
    matrix, rhs = assemble(terms)
    assert rhs.shape == (40,)
    whole = factorize(matrix, backend).solve(assemble(random_terms())[1])
    np.testing.assert_allclose(factorize(matrix, backend).solve(rhs), whole[:, 0], rtol=1e-10)


@pytest.mark.parametrize("block", [1, 4])
def test_an_updated_factor_is_a_new_factor(block, backend):
    stiffness = sparse.kron(grid(12), sparse.eye(4))
    rng = np.random.default_rng(1)
    hold = Term("hold", sparse.eye(4 * 144), rng.normal(size=(576, 3)), rng.uniform(1e-3, 1, 576))
    factor, answers = None, []
    for weight in (100.0, 1.0, 0.01):
        matrix, rhs = assemble([Term("stiffness", stiffness, np.zeros((stiffness.shape[0], 3)), weight), hold])
        if factor is None:
            factor = factorize(matrix, backend, block=block)
        else:
            factor.update(matrix)
        answers.append(factor.solve(rhs))
        fresh = np.linalg.solve(matrix.toarray(), rhs)
        np.testing.assert_allclose(answers[-1], fresh, rtol=1e-9, atol=1e-9)
        assert factor.residual < 1e-14
    assert np.ptp([a.std() for a in answers]) > 0.1  # the three problems are not one


@pytest.mark.parametrize("changed", [20, 144])
def test_a_near_matrix_is_solved_with_the_old_factor_or_a_new_one(backend, changed):
    """A few rows change and the factor serves as it is; all change by a thousand and it is renewed."""
    rng, edges = np.random.default_rng(2), grid(12)
    weights, target = rng.uniform(0.5, 1, 144), rng.normal(size=(144, 3))

    def system(weight):
        return assemble([Term("e", edges, np.zeros((edges.shape[0], 3))), Term("h", sparse.eye(144), target, weight)])

    factor = factorize(system(weights)[0], backend)
    start = factor.solve(system(weights)[1])
    other = weights.copy()
    other[:changed] *= 1e-3 if changed < 144 else rng.uniform(0, 1e6, 144)
    matrix, rhs = system(other)
    np.testing.assert_allclose(factor.solve_near(matrix, rhs, start), np.linalg.solve(matrix.toarray(), rhs), atol=1e-7)
    assert factor.residual < 1e-8


def test_another_pattern_is_analysed_anew(backend):
    first, second = (assemble([Term("t", m, np.zeros((m.shape[0], 1))), Term("h", sparse.eye(m.shape[1]), np.ones(
        (m.shape[1], 1)))])[0] for m in (grid(6), grid(9)))  # fmt: skip
    factor = factorize(first, backend)
    factor.update(second)
    np.testing.assert_allclose(factor.solve(second @ np.arange(81.0)), np.arange(81.0), atol=1e-11)


def test_backends_agree_on_an_ill_conditioned_system():
    pytest.importorskip("cvxopt")
    edges = grid(40)
    terms = [Term("smooth", edges.T @ edges, np.zeros((1600, 2)), 1e4),
             Term("hold", sparse.eye(1600), np.random.default_rng(0).normal(size=(1600, 2)), 1e-2)]  # fmt: skip
    matrix, rhs = assemble(terms)
    factors = [factorize(matrix, name) for name in ("splu", "cholmod")]
    first, second = (factor.solve(rhs) for factor in factors)
    np.testing.assert_allclose(first, second, atol=1e-8 * np.abs(first).max())
    assert max(factor.residual for factor in factors) < 1e-14


def relative(matrix, rhs, x):
    """The residual by its definition, from the answer alone."""
    size = abs(matrix).sum(0).max() * np.abs(x).max(0) + np.abs(rhs).max(0)
    return (np.abs(rhs - matrix @ x).max(0) / size).max()


def test_the_residual_tells_of_a_wrong_answer(backend):
    matrix, rhs = assemble(random_terms())
    factor = factorize(matrix, backend)
    factor._solver = WrongSolver(factor._solver)  # pyright: ignore[reportAttributeAccessIssue]
    answer = factor.solve(rhs)
    assert factor.residual > 1e-7
    assert factor.residual == pytest.approx(relative(matrix, rhs, answer), rel=1e-6, abs=0)


def test_the_residual_of_a_near_matrix_is_its_own():
    """Conjugate gradients stop when they are near enough: what is left is said, as it is."""
    rng, edges = np.random.default_rng(2), grid(12)
    matrix = sparse.csc_matrix(edges.T @ edges + sparse.diags(rng.uniform(0.5, 1, 144)))
    other, rhs = matrix + sparse.diags(rng.uniform(0, 0.5, 144)), rng.normal(size=(144, 3))
    factor = factorize(matrix, "splu")
    answer = factor.solve_near(other, rhs, factor.solve(rhs))
    assert 1e-13 < factor.residual < 1e-8
    assert factor.residual == pytest.approx(relative(other, rhs, answer), rel=1e-2, abs=0)


@pytest.mark.parametrize("shift", [0.0, 1e-17])
def test_a_part_that_nothing_holds_is_refused(backend, shift):
    edges = grid(10)  # differences only: the whole may slide
    with pytest.raises(InputError, match=r"singular.*add a term that holds every part"):
        factorize(edges.T @ edges + shift * sparse.eye(100), backend)


def test_two_sheets_of_which_one_is_held(backend):
    edges = sparse.block_diag([grid(5), grid(5)])
    pinned = sparse.eye(50, format="csr")[:25]
    matrix, _ = assemble([Term("e", edges, np.zeros((edges.shape[0], 1))), Term("p", pinned, np.zeros((25, 1)))])
    with pytest.raises(InputError, match=r"singular: its terms leave (some|unknown (2[5-9]|[34]\d))"):
        factorize(matrix, backend)


def test_numbers_that_are_none_are_refused(backend):
    matrix, rhs = assemble(random_terms())
    broken = matrix.copy()
    broken.data[5] = np.nan
    with pytest.raises(InputError, match="system holds a NaN"):
        factorize(broken, backend)
    rhs[3] = np.nan
    with pytest.raises(InputError, match="right-hand side"):
        factorize(matrix, backend).solve(rhs)


def test_what_cannot_be_chosen_is_said(monkeypatch):
    with pytest.raises(InputError, match="choose auto, cholmod or splu"):
        factorize(sparse.eye(3), "pardiso")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="no terms"):
        assemble([])
    real = builtins.__import__

    def without(name, *rest):
        if name.startswith("cvxopt"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    assert factorize(sparse.eye(3)).backend == "splu"
    with pytest.raises(InputError, match=r"pip install 'blendcap\[fast\]'"):
        factorize(sparse.eye(3), "cholmod")
