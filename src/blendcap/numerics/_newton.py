"""Newton's method on the states of a coupled sequence, and the monotone method behind it."""

from __future__ import annotations

import numpy as np

from blendcap.numerics import _chain as chain
from blendcap.numerics._boxproblem import BoxProblem, blocks
from blendcap.numerics._gradient import gradients
from blendcap.numerics._pivoting import FREE, LOWER, UPPER

MOST = 80  # active-set steps before the monotone method takes over
PATIENCE = 3  # steps without fewer wrong states before one state a frame is changed
DESCENTS = 200
ARMIJO = 1e-4
SLACK = 4  # free unknowns that a frame may gain before the inverses are laid out anew


class Sequence:
    """One scaled problem with couplings, and the answer as it grows."""

    def __init__(self, problem: BoxProblem, coupling: np.ndarray, states: np.ndarray | None):
        self.box = problem.arrays()
        self.linear, self.lower, self.upper = problem.linear, problem.lower, problem.upper
        self.coupling = coupling
        self.count = blocks(len(self.linear))
        self.tolerance = 1e-12 * np.maximum(1.0, np.abs(self.linear).max(1, initial=0.0))
        self.states = np.full(self.linear.shape, FREE, np.int8) if states is None else states
        self.states[np.isinf(self.lower) & (self.states == LOWER)] = FREE
        self.states[np.isinf(self.upper) & (self.states == UPPER)] = FREE
        bounds = np.where(self.states == UPPER, self.upper, self.lower)
        self.x = np.where(self.states == FREE, 0.0, bounds)
        self.g = np.empty_like(self.x)
        self.changed = np.ones(len(self.x), bool)
        self.capacity = np.zeros(len(self.x), np.int64)
        self.starts, self.inverses = np.zeros(1, np.int64), np.empty(0)

    def solve(self) -> tuple[np.ndarray, int]:
        """The weights and how many Newton steps they took."""
        if not len(self.x):
            return self.x, 0
        fewest, patience = self.states.size + 1, PATIENCE
        self.slope(self.x, self.g, self.changed)
        for steps in range(1, MOST + 1):
            self.x += self.newton()
            self.slope(self.x, self.g)
            wrong = self.flip(patience <= 0)
            if wrong == 0:
                self.refine()
                return self.x, steps
            patience -= 1
            if wrong < fewest:
                fewest, patience = wrong, max(patience, 0) if patience < 0 else PATIENCE
            near = self.changed.copy()
            near[1:] |= self.changed[:-1]
            near[:-1] |= self.changed[1:]
            self.slope(self.x, self.g, near)
        steps = MOST + self.descend()
        return self.x, steps

    def slope(self, x: np.ndarray, g: np.ndarray, todo: np.ndarray | None = None) -> None:
        """g = half the gradient at x, in the frames to do."""
        todo = np.ones(len(x), bool) if todo is None else todo
        gradients(self.box, self.coupling, x, g, todo, self.count)

    def newton(self) -> np.ndarray:
        """The step of the free unknowns to where their gradient is zero."""
        free = np.count_nonzero(self.states == FREE, axis=1)
        if (free > self.capacity).any() or self.changed.mean() > 0.5:
            self.capacity = np.minimum(free + SLACK, len(self.lower))
            self.starts = np.concatenate([[0], np.cumsum(self.capacity * (self.capacity + 1) // 2)])
            if self.starts[-1] > self.inverses.size:
                self.inverses = np.empty(0)  # let go of the old ones before the new ones are there
                self.inverses = np.empty(self.starts[-1])
            self.changed[:] = True
        chain.eliminate(self.box, self.coupling, self.states, self.changed, self.starts, self.inverses)
        step = np.empty_like(self.x)
        chain.substitute(self.coupling, self.states, self.starts, self.inverses, self.g, step)
        return step

    def flip(self, single: bool) -> int:
        """Put wrong states right; how many there were."""
        bounds, tolerance = (self.lower, self.upper), self.tolerance
        return chain.flip(bounds, self.states, self.x, self.g, tolerance, single, self.changed, self.count)

    def refine(self) -> None:
        """Correct the free unknowns until their gradient is zero: the inverses forget what is small."""
        for _ in range(5):
            worst = np.abs(np.where(self.states == FREE, self.g, 0.0)).max(1)
            if (worst <= self.tolerance).all():
                break
            self.x += self.newton()
            self.slope(self.x, self.g)

    def descend(self) -> int:
        """Projected Newton steps (Bertsekas 1982, doi:10.1137/0320018); none raises the objective. How many."""
        x = np.clip(self.x, self.lower, self.upper)
        steps, moved = 0, np.inf
        while steps < DESCENTS and moved > 1e-13:
            steps += 1
            self.slope(x, self.g)
            self.states[:] = FREE
            self.states[(x <= self.lower) & (self.g >= 0)] = LOWER
            self.states[(x >= self.upper) & (self.g <= 0)] = UPPER
            self.changed[:] = True
            new = self.search(x, self.newton())
            moved = np.abs(new - x).max()
            x = new
        self.x = x
        return steps

    def search(self, x: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The first of the clipped points x + step, x + step / 2 ... that lowers the objective enough, else x."""
        value, g = (x * (self.g + self.linear)).sum(), np.empty_like(x)
        for halving in range(40):
            trial = np.clip(x + 0.5**halving * step, self.lower, self.upper)
            self.slope(trial, g)
            if (trial * (g + self.linear)).sum() <= value + 2 * ARMIJO * (self.g * (trial - x)).sum():
                return trial
        return x
