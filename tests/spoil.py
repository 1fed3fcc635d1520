"""Solvers that answer wrongly on purpose: what a certificate is for."""

import numpy as np


class WrongSolver:
    """A sparse solver whose answers are off by a ten-thousandth of the largest it ever gave."""

    def __init__(self, solver):
        self._solver, self._size, self._rng = solver, 0.0, np.random.default_rng(0)

    def __getattr__(self, name):
        return getattr(self._solver, name)

    def solve(self, columns):
        answer = self._solver.solve(columns)
        self._size = max(self._size, float(np.abs(answer).max()))
        return answer + 1e-4 * self._size * self._rng.uniform(-1, 1, answer.shape)


def spoil_factors(monkeypatch, module):
    """Every factor that the module makes from now on has a `WrongSolver`."""
    real = module.factorize

    def spoiled(*args, **options):
        factor = real(*args, **options)
        factor._solver = WrongSolver(factor._solver)
        return factor

    monkeypatch.setattr(module, "factorize", spoiled)
