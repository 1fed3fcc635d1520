"""The causal solve: frame by frame, from the past only, for a preview on the stage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba import get_num_threads, set_num_threads

from blendcap.data import Certificate
from blendcap.numerics.boxls import solve_box
from blendcap.solving.curves import CURVE_ERROR, Curves
from blendcap.solving.prior import (
    HELMET_RIDGE,
    HELMET_STEP,
    PSEUDO_FRAMES,
    STEP_FLOOR,
    SYMMETRY,
    TakePrior,
    step_variance,
    symmetric_prior,
)
from blendcap.solving.rows import MarkerRows

REFRESH = 30  # frames between two re-estimates of the prior
RICCATI_STEPS = 40


class LiveSolver:
    """Solves one frame after another; what it learned so far is its state.

    A Kalman filter in which the update is an exact box-constrained solve: the last answer, with the covariance that a
    filter in its steady state would have, is the prior of the next frame. A step that is large against what was learned
    (a blink) is charged less, as in the whole-take solve.

    Parameters
    ----------
    rows : MarkerRows
        How the markers move; its targets are not used.
    mirror : (N,) int
        Partners, as in `Kinship`.
    rate : float
        Frames a second.
    noise : float
        Standard deviation of a marker coordinate, model error included, mm.
    symmetry, smoothness, curve_error : float
        As in SolveSettings.
    held : (N,) bool, optional
        Shapes that stay at rest.
    """

    def __init__(
        self, rows: MarkerRows, mirror: np.ndarray, rate: float, noise: float, *,
        symmetry: float = SYMMETRY, smoothness: float = 1.0, curve_error: float = CURVE_ERROR,
        held: np.ndarray | None = None,
    ):  # fmt: skip
        self.rows, self.rate, self.noise, self.smoothness = rows, rate, noise, smoothness
        self.curve_strength = (noise / curve_error) ** 2
        self.held = np.zeros(rows.shapes, dtype=bool) if held is None else held
        self.start = self.prior = symmetric_prior(mirror, symmetry, rate)
        self.step_floor = step_variance(STEP_FLOOR, rate)
        self.last: np.ndarray | None = None
        self.frames = 0
        count = rows.shapes
        self.moment, self.steps = np.zeros((count, count)), np.zeros(count)
        self._refresh()

    def _refresh(self) -> None:
        """Quadratic terms that stay the same until the prior is learned anew."""
        count, size = self.rows.shapes, len(self.rows.lower)
        self.quadratic = self.rows.gram + HELMET_RIDGE * np.eye(size)
        self.quadratic[:count, :count] += self.noise**2 * np.linalg.inv(self.prior.holding(self.held).covariance)
        walk = np.r_[self.prior.steps, np.full(size - count, step_variance(HELMET_STEP, self.rate))]
        posterior = np.diag(walk)
        for _ in range(RICCATI_STEPS):
            predicted = np.linalg.inv(posterior + np.diag(walk))
            posterior = np.linalg.inv(predicted + self.quadratic / self.noise**2)
        self.hold = self.smoothness * self.noise**2 / (np.diag(posterior) + walk)

    def step(self, targets: np.ndarray, curves: Curves | None = None) -> tuple[np.ndarray, Certificate]:
        """Unknowns (N + K,) of the next frame from marker displacements (M, 3), mm, NaN where missing.

        `curves` is one frame of what is known of the weights from elsewhere.
        """
        rows, count = self.rows, self.rows.shapes
        missing = np.any(~np.isfinite(targets), axis=1)
        linear = -np.where(missing[:, None], 0.0, targets).ravel() @ rows.rows.reshape(-1, len(rows.lower))
        fixed = np.zeros_like(linear)
        if curves is not None:
            diagonal, pull = curves.terms(self.curve_strength, len(linear))
            fixed, linear = diagonal[0], linear + pull[0]
        hold = np.zeros_like(self.hold) if self.last is None else self.hold
        last = np.zeros_like(hold) if self.last is None else self.last
        answer, certificate = self._solve(linear, fixed, hold, last, missing)
        if self.last is not None:
            scaled = (answer[:count] - last[:count]) ** 2 / (0.5 * self.prior.steps)
            hold = hold * np.r_[2 / (1 + scaled), np.ones(len(hold) - count)]
            answer, certificate = self._solve(linear, fixed, hold, last, missing)
            self.steps += (answer[:count] - last[:count]) ** 2
        self.moment += np.outer(answer[:count], answer[:count])
        self.last, self.frames = answer, self.frames + 1
        if self.frames % REFRESH == 0:
            self._learn()
        return answer, certificate

    def _solve(self, linear, fixed, hold, last, missing):
        rows = self.rows
        with _one_thread():
            answer, certificate = solve_box(
                self.quadratic, (linear - hold * last)[None], diagonal=(hold + fixed)[None], lower=rows.lower,
                upper=rows.upper, rows=rows.rows, missing=missing[None],
            )  # fmt: skip
        return answer[0], certificate

    def _learn(self) -> None:
        weight = self.frames + PSEUDO_FRAMES
        covariance = (self.moment + PSEUDO_FRAMES * self.start.covariance) / weight
        steps = (self.steps + PSEUDO_FRAMES * self.start.steps) / weight + self.step_floor
        self.prior = TakePrior(covariance, steps)
        self._refresh()


@contextmanager
def _one_thread() -> Iterator[None]:
    """To wake the threads takes longer than to solve one frame."""
    threads = get_num_threads()
    set_num_threads(1)
    try:
        yield
    finally:
        set_num_threads(threads)


def solve_live(
    rows: MarkerRows, mirror: np.ndarray, rate: float, noise: float, *,
    symmetry: float = SYMMETRY, smoothness: float = 1.0, curves: Curves | None = None, curve_error: float = CURVE_ERROR,
    held: np.ndarray | None = None,
) -> tuple[np.ndarray, dict[str, np.ndarray], Certificate]:  # fmt: skip
    """A whole take through a LiveSolver as if it arrived live: unknowns (T, N + K), energies, certificate."""
    options: dict[str, Any] = {"symmetry": symmetry, "smoothness": smoothness, "curve_error": curve_error, "held": held}
    solver = LiveSolver(rows, mirror, rate, noise, **options)
    targets = np.where(rows.missing[..., None], np.nan, rows.targets)
    frames = [None] * len(targets) if curves is None else curves.frames()
    steps = [solver.step(frame, known) for frame, known in zip(targets, frames, strict=True)]
    unknowns = np.array([answer for answer, _ in steps])
    residuals = np.concatenate([certificate.residuals for _, certificate in steps])
    certificate = Certificate(
        max_kkt=float(residuals.max()),
        iterations=float(np.mean([c.iterations for _, c in steps])),
        converged=all(c.converged for _, c in steps),
        residuals=residuals,
    )
    energies = {"markers": np.nansum(rows.errors(unknowns) ** 2, axis=1)}
    if curves is not None:
        energies["curves"] = curves.energy(unknowns[:, : rows.shapes], solver.curve_strength)
    return unknowns, energies, certificate
