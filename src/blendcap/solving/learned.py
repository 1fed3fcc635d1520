"""The default solve: exact whole-take solves whose prior is learned from the take itself."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from blendcap.data import Certificate
from blendcap.numerics.boxseq import solve_box_sequence
from blendcap.solving.curves import CURVE_ERROR, Curves
from blendcap.solving.noise import HELD, VISIBLE, weight_errors
from blendcap.solving.prior import (
    HELMET_RIDGE,
    HELMET_STEP,
    TakePrior,
    learn_prior,
    posterior,
    step_weights,
    symmetric_prior,
)
from blendcap.solving.rows import MarkerRows

log = logging.getLogger(__name__)

START_NOISE = 0.3  # mm: assumed before the residuals are seen


@dataclass(frozen=True, eq=False)
class LearnedAnswer:
    """The rows last solved, unknowns (T, N + K), energies by term (T,) in mm², certificate, prior and noise (mm)."""

    rows: MarkerRows
    unknowns: np.ndarray
    energies: dict[str, np.ndarray]
    certificate: Certificate
    prior: TakePrior
    noise: float


def solve_learned(
    rows: MarkerRows,
    mirror: np.ndarray,
    rate: float,
    noise: float,
    *,
    symmetry: float = 0.97,
    smoothness: float = 1.0,
    passes: int = 3,
    quick: np.ndarray | None = None,
    curves: Curves | None = None,
    curve_error: float = CURVE_ERROR,
    relinearize: Callable[[np.ndarray], np.ndarray] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> LearnedAnswer:
    """Weights of the whole take, most probable under a prior that the take itself teaches.

    Minimises, exactly and for all frames at once,
    `|y_t - B a_t - R u_t|² + s² a_t' C⁻¹ a_t + sum_i s² w_ti / q_i (a_ti - a_(t-1)i)²` with `0 <= a <= 1`,
    where s is the noise, C the covariance of poses, q the variance of steps and w their Student weights;
    C, q and w are re-estimated between passes. Curves add `sum_i s² / e_i² c_ti (a_ti - ã_ti)²` (Eq. 4, Eq. 38) with
    their confidence c; a solve of the markers alone before puts the curves of shapes that markers see on their scale
    and tells how far each still errs, e_i. A curve of a shape that no marker sees counts in full.

    Parameters
    ----------
    rows : MarkerRows
    mirror : (N,) int
        Left and right partners.
    rate : float
        Frames a second.
    noise : float
        Standard deviation of a marker coordinate, mm: the least that is assumed. What the rig leaves unexplained is
        added, as the answer shows it.
    symmetry, smoothness, passes
        As in SolveSettings.
    quick : (N,) bool, optional
        Shapes that move within a few frames, as eyelids do.
    curves : Curves, optional
        What is known of the weights from elsewhere.
    curve_error : float
        Least standard deviation of a curve that is fully trusted.
    relinearize : callable, optional
        Takes the unknowns (T, N + K) to targets (T, M, 3) with the helmet's rotation made exact.
    progress : callable
        Told what begins.
    """
    start = prior = symmetric_prior(mirror, symmetry, rate)
    unknowns, factors = None, np.ones((1, len(mirror)))
    quick = np.zeros(len(mirror), dtype=bool) if quick is None else quick
    least, noise = noise, max(noise, START_NOISE)
    told_error = np.full(len(mirror), curve_error)
    if curves is not None:
        progress("the markers alone")
        curves, told_error = _calibrated(
            rows, prior, noise, _coupling(rows, prior, noise, rate, smoothness), curves, curve_error
        )
    for k in range(passes):
        progress(f"pass {k + 1} of {passes}")
        precision = _precision(prior, noise, len(rows.lower))
        coupling = _coupling(rows, prior, noise, rate, smoothness * factors)
        strength = (noise / told_error) ** 2
        diagonal, pull = (None, 0.0) if curves is None else curves.terms(strength, len(rows.lower))
        unknowns, certificate = solve_box_sequence(
            rows.gram + precision, rows.linear + pull, coupling, diagonal=diagonal, lower=rows.lower, upper=rows.upper,
            start=unknowns, rows=rows.rows, missing=rows.missing,
        )  # fmt: skip
        log.info("pass %d: %d Newton steps, KKT %.1e", k + 1, certificate.iterations, certificate.max_kkt)
        if k == passes - 1:
            break
        weights = unknowns[:, : rows.shapes]
        known = precision if diagonal is None else precision + np.diag(diagonal.mean(0))
        prior, freedom = learn_prior(start, weights, rows.mean_gram, prior, known, noise, rate)
        noise = max(least, _unexplained(rows, unknowns, freedom))
        told = np.zeros(len(mirror)) if curves is None else curves.precision(told_error)
        prior = prior.holding(_untold(rows, np.sqrt(noise**2 - least**2), mirror, told))
        factors = step_weights(weights, prior, mirror, quick)
        if relinearize is not None and k == passes - 2:
            rows = rows.with_targets(relinearize(unknowns))
    assert unknowns is not None  # there is at least one pass
    energies = _energies(rows, unknowns, precision, coupling)
    if curves is not None:
        energies["curves"] = curves.energy(unknowns[:, : rows.shapes], strength)
    return LearnedAnswer(rows, unknowns, energies, certificate, prior, noise)


def _coupling(rows: MarkerRows, prior: TakePrior, noise: float, rate: float, factors) -> np.ndarray:
    """(T, N + K) coupling of neighbouring frames, mm²; `factors` (T, N) are those on the shapes'."""
    coupling = np.full((len(rows.targets), len(rows.lower)), noise**2 / (HELMET_STEP**2 * 60 / rate))
    coupling[:, : rows.shapes] = factors * noise**2 / prior.steps
    return coupling


def _calibrated(
    rows: MarkerRows, prior: TakePrior, noise: float, coupling: np.ndarray, curves: Curves, least: float
) -> tuple[Curves, np.ndarray]:
    """The curves on the markers' scale and their errors (N,), told by a solve that does not know them."""
    precision = _precision(prior, noise, len(rows.lower))
    alone, _ = solve_box_sequence(
        rows.gram + precision, rows.linear, coupling, lower=rows.lower, upper=rows.upper,
        rows=rows.rows, missing=rows.missing,
    )  # fmt: skip
    variance = posterior(rows.mean_gram, precision, prior.steps, noise**2)[0].diagonal()
    return curves.calibrated(alone[:, : rows.shapes], variance, weight_errors(rows, noise) < VISIBLE, least)


def _untold(rows: MarkerRows, model_error: float, mirror: np.ndarray, told: np.ndarray) -> np.ndarray:
    """(N,) bool: shapes that what the rig cannot explain would drive more than the markers do.

    White noise averages out and the prior knows how to weigh it; motion that the rig lacks does not, and would be put
    into any shape that the markers hardly see. A shape whose partner is seen follows its partner, and one that curves
    tell, with the precision `told` (N,), is told.
    """
    errors = weight_errors(rows, model_error, told)
    return np.minimum(errors, errors[mirror]) > HELD


def _unexplained(rows: MarkerRows, unknowns: np.ndarray, freedom: float) -> float:
    """Standard deviation of a marker coordinate that the answer leaves, mm, with what the fit swallowed put back."""
    squared = np.nansum(rows.errors(unknowns) ** 2)
    coordinates = 3 * np.count_nonzero(~rows.missing)
    return float(np.sqrt(squared / max(coordinates - freedom * len(unknowns), 0.25 * coordinates, 1)))


def _precision(prior: TakePrior, noise: float, size: int) -> np.ndarray:
    count = len(prior.steps)
    precision = np.eye(size) * HELMET_RIDGE
    precision[:count, :count] = noise**2 * np.linalg.inv(prior.covariance)
    return precision


def _energies(rows: MarkerRows, unknowns: np.ndarray, precision: np.ndarray, coupling: np.ndarray) -> dict:
    steps = np.diff(unknowns, axis=0, prepend=unknowns[:1]) ** 2 * coupling
    return {
        "markers": np.nansum(rows.errors(unknowns) ** 2, axis=1),
        "prior": np.einsum("ti,ij,tj->t", unknowns, precision, unknowns, optimize=True),
        "smoothness": steps[:, : rows.shapes].sum(1),
        "helmet smoothness": steps[:, rows.shapes :].sum(1),
    }
