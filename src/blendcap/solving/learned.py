"""The default solve: exact whole-take solves whose prior is learned from the take itself."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from blendcap.data import Certificate
from blendcap.numerics.boxseq import solve_box_sequence
from blendcap.solving.curves import CURVE_ERROR, Curves
from blendcap.solving.prior import (
    HELMET_RIDGE,
    HELMET_STEP,
    TakePrior,
    learn_prior,
    posterior,
    step_weights,
    symmetric_prior,
    trend,
)
from blendcap.solving.rows import MarkerRows
from blendcap.solving.trust import marker_errors, overall, trust
from blendcap.solving.visibility import Kinship, held_shapes, lasting_noise, weight_errors

log = logging.getLogger(__name__)

START_NOISE = 0.3  # mm: assumed before the residuals are seen
TELLING = 0.2  # the markers know a weight as well as this if they are to judge its curve


@dataclass(frozen=True, eq=False)
class Answer:
    """What a solve ends with.

    Parameters
    ----------
    rows : MarkerRows
        As last solved.
    unknowns : (T, N + K)
    energies : {term: (T,)}
        mm².
    certificate : Certificate
    noise : float
        mm.
    held : (N,) bool
        Shapes held at rest.
    trusted : (M,)
        How much each marker counted, 0 to 1.
    """

    rows: MarkerRows
    unknowns: np.ndarray
    energies: dict[str, np.ndarray]
    certificate: Certificate
    noise: float
    held: np.ndarray
    trusted: np.ndarray


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
    kinship: Kinship | None = None,
    curves: Curves | None = None,
    curve_error: float = CURVE_ERROR,
    relinearize: Callable[[np.ndarray], np.ndarray] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Answer:
    """Weights of the whole take, most probable under a prior that the take itself teaches.

    Minimises, exactly and for all frames at once,
    `|y_t - B a_t - R u_t|² + s² a_t' C⁻¹ a_t + sum_i s² w_ti / q_i (a_ti - a_(t-1)i)²` with `0 <= a <= 1`,
    where s is the noise, C the covariance of poses, q the variance of steps and w their Student weights;
    C, q and w are re-estimated between passes. From the second pass on shapes that the markers cannot tell are held at
    rest (`held_shapes`), markers that went astray count less (`trust`), and a quick shape's step is charged for what it
    differs from the `trend` of the answer before. Curves add `sum_i s² / e_i² c_ti (a_ti - ã_ti)²` (Eq. 4, Eq. 38) with
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
    kinship : Kinship, optional
        Which shapes exclude each other and which are lids and eyeballs; partners alone if not given.
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
    kinship = Kinship.of_pairs(mirror) if kinship is None else kinship
    quick = np.zeros(len(mirror), dtype=bool) if quick is None else quick
    unknowns, factors, foretold = None, np.ones((1, len(mirror))), np.zeros((1, len(mirror)))
    held, trusted, weighed = np.zeros(len(mirror), dtype=bool), np.ones(len(rows.rows)), rows
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
            weighed.gram + precision, weighed.linear + pull + _pull_along(coupling, foretold), coupling,
            diagonal=diagonal, lower=rows.lower, upper=rows.upper, start=unknowns, rows=weighed.rows,
            missing=rows.missing,
        )  # fmt: skip
        log.info("pass %d: %d Newton steps, KKT %.1e", k + 1, certificate.iterations, certificate.max_kkt)
        if k == passes - 1:
            break
        weights = unknowns[:, : rows.shapes]
        known = precision if diagonal is None else precision + np.diag(diagonal.mean(0))
        prior, covariance = learn_prior(start, weights, weighed.mean_gram, prior, known, noise, rate)
        leverage = np.einsum("mki,ij,mkj->m", weighed.rows, covariance / noise**2, weighed.rows)
        trusted = trust(marker_errors(rows, unknowns, leverage))
        noise = max(least, overall(rows, unknowns, leverage, trusted))
        weighed = rows.weighed(trusted)
        told = np.zeros(len(mirror)) if curves is None else curves.precision(told_error)
        held = held_shapes(weighed, lasting_noise(noise, least), kinship, told)
        prior = prior.holding(held)
        factors, foretold = step_weights(weights, prior, mirror, quick), trend(weights, quick)
        if relinearize is not None and k == passes - 2:
            rows = rows.with_targets(relinearize(unknowns))
            weighed = rows.weighed(trusted)
    assert unknowns is not None  # there is at least one pass
    energies = _energies(weighed, unknowns, precision, coupling, foretold)
    if curves is not None:
        energies["curves"] = curves.energy(unknowns[:, : rows.shapes], strength)
    return Answer(rows, unknowns, energies, certificate, noise, held, trusted)


def _pull_along(coupling: np.ndarray, foretold: np.ndarray) -> np.ndarray:
    """(T, N + K) linear term of `c_t (a_t - a_(t-1) - f_t)²` with the steps foretold (T, N), mm²."""
    push = np.zeros_like(coupling)
    push[:, : foretold.shape[1]] = coupling[:, : foretold.shape[1]] * foretold
    return np.vstack([push[1:], np.zeros_like(push[:1])]) - push


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
    variance = posterior(rows.mean_gram, precision, prior.steps, noise**2)[0].diagonal()[: rows.shapes]
    return curves.calibrated(alone[:, : rows.shapes], variance, weight_errors(rows, noise) < TELLING, least)


def _precision(prior: TakePrior, noise: float, size: int) -> np.ndarray:
    count = len(prior.steps)
    precision = np.eye(size) * HELMET_RIDGE
    precision[:count, :count] = noise**2 * np.linalg.inv(prior.covariance)
    return precision


def _energies(
    rows: MarkerRows, unknowns: np.ndarray, precision: np.ndarray, coupling: np.ndarray, foretold: np.ndarray
) -> dict[str, np.ndarray]:
    steps = np.diff(unknowns, axis=0, prepend=unknowns[:1])
    steps[:, : rows.shapes] -= foretold
    steps = steps**2 * coupling
    return {
        "markers": np.nansum(rows.errors(unknowns) ** 2, axis=1),
        "prior": np.einsum("ti,ij,tj->t", unknowns, precision, unknowns, optimize=True),
        "smoothness": steps[:, : rows.shapes].sum(1),
        "helmet smoothness": steps[:, rows.shapes :].sum(1),
    }
