"""Sparse least squares of many terms: one assembly, one symmetric factor that is reused, and a check of every answer.

Registration, deformation transfer and example-based rigging are all `min over x of sum_k w_k |A_k x - b_k|²`; they
differ in their terms only. The normal equations `H x = sum_k A_k' w_k b_k` are solved directly, all columns at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import splu

from blendcap.data.errors import InputError

Backend = Literal["auto", "cholmod", "splu"]
REFINED = 1e-12  # relative residual above which an answer is refined once
NEAR, ROUNDS = 1e-8, 25  # conjugate gradients: the residual to reach, of the right-hand side; the most rounds
LOST = 1e-3  # a factor that misses a known answer by this much is of a singular matrix


@dataclass(frozen=True, eq=False)
class Term:
    """One summand `w |A x - b|²` of a least-squares problem.

    Parameters
    ----------
    name : str
        What the term asks for; `energies` reports under it.
    matrix : (m, n) sparse
        A.
    target : (m, k) or (m,) float64
        b: one column a right-hand side.
    weight : float or (m,) float64
        w, of the squared rows; not negative.
    """

    name: str
    matrix: Any
    target: np.ndarray
    weight: float | np.ndarray = 1.0


def assemble(terms: Sequence[Term]) -> tuple[sparse.csc_matrix, np.ndarray]:
    """The normal equations of a sum of terms.

    Returns
    -------
    H : (n, n) sparse
        `sum A' w A`, symmetric, sorted.
    rhs : (n, k) or (n,) float64
        `sum A' w b`.
    """
    if not terms:
        raise InputError("The least-squares problem has no terms; give at least one.")
    (matrix, rhs), *others = (_normal(term) for term in terms)
    for more, right in others:
        matrix, rhs = matrix + more, rhs + right
    matrix = sparse.csc_matrix(matrix)
    matrix.sort_indices()
    return matrix, rhs


def energies(terms: Sequence[Term], x: np.ndarray) -> dict[str, float]:
    """What each term costs at x (n, k): `w |A x - b|²`, summed over its rows and columns; equal names add up."""
    result: dict[str, float] = {}
    for term in terms:
        squared = (term.matrix @ x - term.target) ** 2
        rows = squared if squared.ndim == 1 else squared.sum(1)
        result[term.name] = result.get(term.name, 0.0) + float(np.sum(rows * term.weight))
    return result


def factorize(matrix: Any, backend: Backend = "auto", *, block: int = 1) -> Factor:
    """A factor of a symmetric positive definite sparse matrix (n, n).

    Parameters
    ----------
    matrix : (n, n) sparse
        Both triangles.
    backend : "auto", "cholmod" or "splu"
        CHOLMOD's supernodal Cholesky through cvxopt (the extra `fast`; GPL-3), or SuperLU in symmetric mode from
        SciPy. "auto" takes CHOLMOD where it is installed.
    block : int
        Unknowns come in groups of so many consecutive ones that belong together, as the 4 of a vertex's affine map;
        the order of elimination is then found on the groups, which is quicker and leaves less fill.

    Raises
    ------
    InputError
        If the matrix is singular or not symmetric positive definite, or the backend is not there.
    """
    if backend not in ("auto", "cholmod", "splu"):
        raise InputError(f"There is no sparse solver {backend!r}; choose auto, cholmod or splu.")
    if backend == "cholmod" and not has_cholmod():
        raise InputError("The solver cholmod needs cvxopt; run pip install 'blendcap[fast]', or choose splu.")
    wanted = _Cholmod if backend == "cholmod" or (backend == "auto" and has_cholmod()) else _Splu
    return Factor(wanted(), matrix, block)


def has_cholmod() -> bool:
    """Whether cvxopt, which brings CHOLMOD, is installed."""
    try:
        import cvxopt.cholmod  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError:
        return False
    return True


class Factor:
    """A factored matrix: solves for any number of right-hand sides, and takes new values of the same pattern.

    Attributes
    ----------
    backend : str
        "cholmod" or "splu".
    residual : float
        The largest relative residual `|H x - rhs| / (|H| |x| + |rhs|)` (infinity norms, a column) of the last solve.
    """

    def __init__(self, solver: _Cholmod | _Splu, matrix: Any, block: int = 1):
        self._solver, self._block = solver, block
        self._pattern: tuple[np.ndarray, np.ndarray] | None = None
        self.backend, self.residual = solver.name, float("nan")
        self.update(matrix)

    def update(self, matrix: Any) -> None:
        """Factor another matrix; where its pattern is that of the last one, the analysis of the pattern is kept."""
        self._renew(matrix)
        self._probe()

    def _renew(self, matrix: Any) -> None:
        self._matrix = sparse.csc_matrix(matrix)
        self._matrix.sort_indices()
        self._size = len(self._matrix.indptr) - 1
        self._norm = float(np.max(np.asarray(abs(self._matrix).sum(0)), initial=0.0))
        if not np.isfinite(self._norm):
            raise InputError("The least-squares system holds a NaN or an infinite number; look for it in the inputs.")
        if not _same(self._pattern, self._matrix):
            self._pattern = (self._matrix.indptr, self._matrix.indices)
            self._solver.analyse(self._matrix, _order(self._matrix, self._block), self._block)
        try:
            self._solver.factor(self._matrix)
        except (ArithmeticError, RuntimeError):
            raise InputError(_singular("some unknowns")) from None

    def solve(self, rhs: ArrayLike) -> np.ndarray:
        """x (n, k) or (n,) with `H x = rhs`."""
        right = np.asarray(rhs, dtype=np.float64)
        columns = right.reshape(len(right), -1)
        answer = self._solver.solve(columns)
        missed = columns - self._matrix @ answer
        self.residual = _relative(self._norm, missed, answer, columns)
        if self.residual > REFINED:
            answer = answer + self._solver.solve(missed)
            self.residual = _relative(self._norm, columns - self._matrix @ answer, answer, columns)
        if not np.isfinite(self.residual):
            raise InputError("The right-hand side of the least-squares system holds a NaN or an infinite number.")
        return answer.reshape(right.shape)

    def solve_near(self, matrix: Any, rhs: np.ndarray, start: np.ndarray) -> np.ndarray:
        """x (n, k) for another matrix of the same pattern, not far from the factored one.

        With CHOLMOD, where factoring is cheap, the factor is renewed. SuperLU's stays, as the preconditioner of
        conjugate gradients from `start`; it is renewed where they do not reach a residual of 1e-8 in 25 rounds.
        """
        matrix = sparse.csc_matrix(matrix)
        answer = None if self.backend == "cholmod" else self._conjugate(matrix, rhs, start)
        if answer is None:
            self._renew(matrix)  # near a matrix that has been proven, it needs no proof of its own
            return self.solve(rhs)
        norm = float(np.max(np.asarray(abs(matrix).sum(0)), initial=0.0))
        self.residual = _relative(norm, rhs - matrix @ answer, answer, rhs)
        return answer

    def _conjugate(self, matrix: Any, rhs: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        """Conjugate gradients for all columns at once, each with steps of its own; None if they are too slow."""
        answer, missed = start, rhs - matrix @ start
        wanted = NEAR * np.abs(rhs).max(0)
        pull = direction = self._solver.solve(missed)
        power = (missed * pull).sum(0)
        for _ in range(ROUNDS):
            bent = matrix @ direction
            length = power / np.maximum((direction * bent).sum(0), 1e-300)
            answer, missed = answer + length * direction, missed - length * bent
            if (np.abs(missed).max(0) <= wanted).all():
                return answer
            pull = self._solver.solve(missed)
            power, before = (missed * pull).sum(0), power
            direction = pull + power / np.maximum(before, 1e-300) * direction
        return None

    def _probe(self) -> None:
        """A known vector must come back; along directions that no term holds, it does not."""
        known = np.random.default_rng(0).uniform(0.5, 1.5, (self._size, 1))
        error = np.abs(self._solver.solve(self._matrix @ known) - known).ravel()
        error[~np.isfinite(error)] = np.inf
        if np.max(error, initial=0.0) > LOST:
            raise InputError(_singular(f"unknown {int(np.argmax(error))} and perhaps others"))


def _relative(norm: float, missed: np.ndarray, answer: np.ndarray, columns: np.ndarray) -> float:
    size = norm * np.abs(answer).max(0, initial=0.0) + np.abs(columns).max(0, initial=0.0)
    return float(np.max(np.abs(missed).max(0, initial=0.0) / np.maximum(size, 1e-300), initial=0.0))


def _singular(which: str) -> str:
    return f"The least-squares system is singular: its terms leave {which} free; add a term that holds every part."


def _normal(term: Term) -> tuple[Any, np.ndarray]:
    matrix: Any = sparse.csr_matrix(term.matrix)
    weight = np.broadcast_to(np.asarray(term.weight, dtype=np.float64), (matrix.shape[0],))
    weighted = sparse.csc_matrix(matrix.T @ sparse.diags(weight))
    return weighted @ matrix, weighted @ np.asarray(term.target, dtype=np.float64)


def _order(matrix: Any, block: int) -> np.ndarray | None:
    """An order of elimination (n,) found on groups of unknowns; None leaves it to the backend."""
    if block == 1:
        return None
    count, column = matrix.shape[0] // block, np.repeat(np.arange(matrix.shape[1]), np.diff(matrix.indptr))
    pairs = (matrix.indices // block, column // block)
    groups = sparse.csc_matrix((np.full(len(column), -1.0), pairs), shape=(count, count))
    dominant: Any = groups + sparse.diags(1.0 - 2.0 * np.asarray(groups.sum(0)).ravel())
    order = np.argsort(_splu(dominant.tocsc(), "MMD_AT_PLUS_A").perm_c)
    return (block * order[:, None] + np.arange(block)).ravel()


class _Cholmod:
    """Supernodal Cholesky. cvxopt takes the lower triangle, column by column, as CSC stores it."""

    name = "cholmod"

    def analyse(self, matrix: Any, order: np.ndarray | None, block: int) -> None:
        import cvxopt.cholmod  # pyright: ignore[reportMissingImports]

        column = np.repeat(np.arange(matrix.shape[1]), np.diff(matrix.indptr))
        self._lower = np.flatnonzero(matrix.indices >= column)
        rows, columns = (cvxopt.matrix(np.asarray(i[self._lower], np.int64)) for i in (matrix.indices, column))
        self._held = cvxopt.spmatrix(1.0, rows, columns, matrix.shape)
        given = () if order is None else (cvxopt.matrix(np.asarray(order, np.int64)),)
        self._factor = cvxopt.cholmod.symbolic(self._held, *given)

    def factor(self, matrix: Any) -> None:
        import cvxopt.cholmod  # pyright: ignore[reportMissingImports]

        self._held.V = cvxopt.matrix(matrix.data[self._lower])
        cvxopt.cholmod.numeric(self._held, self._factor)

    def solve(self, columns: np.ndarray) -> np.ndarray:
        import cvxopt.cholmod  # pyright: ignore[reportMissingImports]

        answer = cvxopt.matrix(np.asfortranarray(columns))
        cvxopt.cholmod.solve(self._factor, answer)
        return np.array(answer).reshape(columns.shape)


class _Splu:
    """SuperLU that trusts the diagonal.

    Its subtrees are not joined to dense ones beyond a block (`relax`): it takes any consecutive columns for a subtree,
    which is only so in another mode, and would fill in zeros.
    """

    name = "splu"
    _lu: Any = None

    def analyse(self, matrix: Any, order: np.ndarray | None, block: int) -> None:
        self._order, self._block = order, block

    def factor(self, matrix: Any) -> None:
        self._lu = None  # the old factor's memory goes to the new one
        if self._order is None:
            self._lu = _splu(matrix, "MMD_AT_PLUS_A", self._block)
        else:
            self._lu = _splu(sparse.csc_matrix(matrix[self._order][:, self._order]), "NATURAL", self._block)

    def solve(self, columns: np.ndarray) -> np.ndarray:
        if self._order is None:
            return self._lu.solve(columns)
        answer = np.empty_like(columns)
        answer[self._order] = self._lu.solve(columns[self._order])
        return answer


def _splu(matrix: Any, order: str, block: int = 1):
    return splu(matrix, permc_spec=order, diag_pivot_thresh=0.0, relax=block, options={"SymmetricMode": True})


def _same(pattern: tuple[np.ndarray, np.ndarray] | None, matrix: Any) -> bool:
    return (
        pattern is not None and np.array_equal(pattern[0], matrix.indptr) and np.array_equal(pattern[1], matrix.indices)
    )
