"""The default solve: exact whole-take solves whose prior is learned from the take itself."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from blendcap.data import Certificate
from blendcap.numerics.boxseq import solve_box_sequence
from blendcap.solving.answer import Answer
from blendcap.solving.curves import CURVE_ERROR, Curves
from blendcap.solving.events import FREE, hidden, lid_events, told_by_frames
from blendcap.solving.prior import (
    HELMET_RIDGE,
    HELMET_STEP,
    HOLD,
    REACH,
    START_DEVIATION,
    TakePrior,
    posterior,
    relearned_prior,
    resting,
    step_variance,
    step_weights,
    symmetric_prior,
    trend,
)
from blendcap.solving.rows import MarkerRows
from blendcap.solving.trust import marker_errors, overall, trust, without_strays
from blendcap.solving.visibility import Kinship, held_shapes, lasting_noise, weight_errors

log = logging.getLogger(__name__)

START_NOISE = 0.3  # mm: assumed before the residuals are seen
TELLING = 0.2  # the markers know a weight as well as this if they are to judge its curve
HANDOVER_FRAMES = 9  # in which one of two shapes that exclude each other hands over to the other


def solve_learned(
    rows: MarkerRows,
    kinship: Kinship,
    rate: float,
    noise: float,
    *,
    smoothness: float = 1.0,
    passes: int = 3,
    curves: Curves | None = None,
    curve_error: float = CURVE_ERROR,
    relinearize: Callable[[np.ndarray], np.ndarray] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Answer:
    """Weights of the whole take, most probable under a prior that the take itself teaches.

    Weights count as shares of a full shape (`in_shares`). Minimises, exactly and for all frames at once,
    `|y_t - B a_t - R u_t|² + s² a_t' C⁻¹ a_t + sum_i s² w_ti / q_i (a_ti - a_(t-1)i)²` with `0 <= a <= 1`,
    where s is the noise, C the covariance of poses, q the variance of steps and w their Student weights;
    C, q and w are re-estimated between passes. From the second pass on shapes that the markers cannot tell are held at
    rest (`held_shapes`), and so is, frame by frame, the smaller of two that exclude each other (`resting`). Markers
    that went astray count less (`trust`), samples of tracks that did are left out (`without_strays`), and a quick
    shape is free while it moves and held back while it is calm (`lid_events`). Curves add
    `sum_i s² / e_i² c_ti (a_ti - ã_ti)²` (Eq. 4, Eq. 38) with
    their confidence c; a solve before, without them, puts the curves of shapes that markers or tracks see on their
    scale and tells how far each still errs, e_i. A curve of a shape that neither sees counts in full; so does that of a
    quick shape which only tracks see, as far as it is on: a lid that shuts hides its paint.

    Parameters
    ----------
    rows : MarkerRows
    kinship : Kinship
        Which shapes go together, exclude each other, or are quick. When a quick one moves is decided from all frames
        at once, and its poses are believed to reach farther than they do on average.
    rate : float
        Frames a second.
    noise : float
        Standard deviation of a marker coordinate, mm: the least that is assumed. What the rig leaves unexplained is
        added, as the answer shows it.
    smoothness, passes
        As in SolveSettings.
    curves : Curves, optional
        What is known of the weights from elsewhere.
    curve_error : float
        Least standard deviation of a curve that is fully trusted.
    relinearize : callable, optional
        Takes the unknowns (T, N + K) to targets (T, M, 3) with the helmet's rotation made exact.
    progress : callable
        Told what begins.
    """
    start = symmetric_prior(kinship.mirror, kinship.symmetry, rate)
    start = replace(start, steps=np.where(kinship.quick, step_variance(FREE, rate), start.steps))
    belief = _Belief.first(start, max(noise, START_NOISE), len(rows.rows))
    told_error = np.full(rows.shapes, curve_error)
    if curves is not None:
        progress("without the curves")
        curves, told_error = _calibrated(rows, belief, rate, smoothness, curves, curve_error, kinship.quick)
    progress(f"pass 1 of {passes}")
    terms = _terms(rows, belief, rate, smoothness, curves, told_error)
    unknowns, certificate = terms.solved()
    for k in range(1, passes):
        belief = _learned(rows, terms, unknowns, belief, start, noise, rate, kinship)
        rows = without_strays(rows, unknowns)
        if relinearize is not None and k == passes - 1:
            rows = rows.with_targets(relinearize(unknowns))
        progress(f"pass {k + 1} of {passes}")
        terms = _terms(rows, belief, rate, smoothness, curves, told_error)
        unknowns, certificate = terms.solved(unknowns)
    energies = terms.energies(unknowns)
    return Answer(rows, unknowns, energies, certificate, belief.noise, belief.held, belief.trusted)


@dataclass(frozen=True, eq=False)
class _Belief:
    """What a pass takes for granted, and the pass before has taught.

    Parameters
    ----------
    prior : TakePrior
    noise : float
        mm.
    factors : (T, N)
        On the coupling of each step: Student weights; one row before any is known.
    foretold : (T, N)
        Steps that shapes on their way are about to make, likewise.
    held : (N,) bool
    resting : (T, N) bool
        Shapes at rest because one that excludes them is on; one row before any is known.
    trusted : (M,)
    """

    prior: TakePrior
    noise: float
    factors: np.ndarray
    foretold: np.ndarray
    held: np.ndarray
    resting: np.ndarray
    trusted: np.ndarray

    @staticmethod
    def first(prior: TakePrior, noise: float, markers: int) -> _Belief:
        none = np.zeros((1, len(prior.steps)), dtype=bool)
        return _Belief(prior, noise, 1.0 - none, 0.0 * none, none[0], none, np.ones(markers))


@dataclass(frozen=True, eq=False)
class _Terms:
    """The quadratic that one pass minimises, mm²; `rows` are weighed by trust, `told_error` (N,) is of the curves.

    `hold` (T, N) is what each frame adds to the curvature of the shapes that rest in it.
    """

    rows: MarkerRows
    precision: np.ndarray
    hold: np.ndarray
    coupling: np.ndarray
    foretold: np.ndarray
    curves: Curves | None
    told_error: np.ndarray
    strength: np.ndarray

    def solved(self, start: np.ndarray | None = None) -> tuple[np.ndarray, Certificate]:
        """The unknowns (T, N + K) at its optimum."""
        diagonal, pull = self.diagonal_and_pull()
        unknowns, certificate = solve_box_sequence(
            self.rows.gram + self.precision, self.rows.linear + pull + _pull_along(self.coupling, self.foretold),
            self.coupling, diagonal=diagonal, lower=self.rows.lower, upper=self.rows.upper, start=start,
            rows=self.rows.rows, missing=self.rows.missing,
        )  # fmt: skip
        log.info("%d Newton steps, KKT %.1e", certificate.iterations, certificate.max_kkt)
        return unknowns, certificate

    def diagonal_and_pull(self) -> tuple[np.ndarray | None, np.ndarray | float]:
        """What resting shapes and the curves add to each frame's diagonal and linear term."""
        size = len(self.rows.lower)
        diagonal, pull = (None, 0.0) if self.curves is None else self.curves.terms(self.strength, size)
        if self.hold.any():
            hold = np.pad(self.hold, ((0, 0), (0, size - self.rows.shapes)))
            diagonal = hold if diagonal is None else diagonal + hold
        return diagonal, pull

    def told(self) -> np.ndarray:
        """(N,) one over variance of what the curves tell of each weight."""
        return np.zeros(self.rows.shapes) if self.curves is None else self.curves.precision(self.told_error)

    def energies(self, unknowns: np.ndarray) -> dict[str, np.ndarray]:
        """{term: (T,)} mm²."""
        rows = self.rows
        steps = np.diff(unknowns, axis=0, prepend=unknowns[:1])
        steps[:, : rows.shapes] -= self.foretold
        steps = steps**2 * self.coupling
        energies = {
            "markers": np.nansum(rows.errors(unknowns) ** 2, axis=1),
            "prior": np.einsum("ti,ij,tj->t", unknowns, self.precision, unknowns, optimize=True)
            + (self.hold * unknowns[:, : rows.shapes] ** 2).sum(1),
            "smoothness": steps[:, : rows.shapes].sum(1),
            "helmet smoothness": steps[:, rows.shapes :].sum(1),
        }
        if self.curves is not None:
            energies["curves"] = self.curves.energy(unknowns[:, : rows.shapes], self.strength)
        return energies


def _terms(
    rows: MarkerRows, belief: _Belief, rate: float, smoothness: float, curves: Curves | None, told_error: np.ndarray,
) -> _Terms:  # fmt: skip
    weighed = rows.weighed(belief.trusted)
    return _Terms(
        weighed,
        _precision(belief.prior, belief.noise, len(rows.lower)),
        handed_over(belief.resting) * (belief.noise / (HOLD * START_DEVIATION)) ** 2,
        _coupling(weighed, belief.prior, belief.noise, rate, smoothness * belief.factors),
        belief.foretold,
        curves,
        told_error,
        (belief.noise / told_error) ** 2,
    )


def handed_over(resting: np.ndarray) -> np.ndarray:
    """(T, N) share of the full hold on shapes that rest (T, N): it comes and goes by equal factors, not at once.

    A hold that was there in one frame and not in the next would let go of a lid as a snapped thread does.
    """
    share = uniform_filter1d(resting.astype(float), HANDOVER_FRAMES, axis=0, mode="nearest")
    return (HOLD ** (-2 * share) - 1) / (HOLD**-2 - 1)


def _learned(
    rows: MarkerRows, terms: _Terms, unknowns: np.ndarray, belief: _Belief, start: TakePrior, least: float, rate: float,
    kinship: Kinship,
) -> _Belief:  # fmt: skip
    """What an answer teaches: the prior, whom to trust, the noise that is left, and what the markers cannot tell."""
    weights, weighed = unknowns[:, : rows.shapes], terms.rows
    diagonal, _ = terms.diagonal_and_pull()
    known = terms.precision if diagonal is None else terms.precision + np.diag(diagonal.mean(0))
    prior, covariance = relearned_prior(start, weights, weighed.mean_gram, belief.prior, known, belief.noise, rate)
    leverage = np.einsum("mki,ij,mkj->m", weighed.rows, covariance / belief.noise**2, weighed.rows)
    errors, tracks = marker_errors(rows, unknowns, leverage), rows.tracks
    apart = (np.where(kind, errors, np.nan) for kind in (tracks, ~tracks))  # each kind is judged by its own
    trusted = np.minimum(*map(trust, apart))
    noise = max(least, overall(rows, unknowns, leverage, trusted))
    held = held_shapes(rows.weighed(trusted), lasting_noise(noise, least), kinship, terms.told())
    prior = prior.reaching(kinship.quick).holding(held)
    factors = step_weights(weights, prior, kinship.mirror)
    told = told_by_frames(weighed, unknowns, noise, terms.curves, (noise / terms.told_error) ** 2)
    chance, calm = lid_events(*told, kinship.quick, kinship.partner, rate)
    chance[hidden(told[1], REACH, kinship.quick, kinship.partner)] = 0.0
    free = np.maximum(step_variance(FREE, rate), calm)
    prior = replace(prior, steps=np.where(kinship.quick, calm, prior.steps))
    factors = np.where(kinship.quick, (calm / free) ** chance, factors)
    smaller = resting(weights, kinship.opposite) & (chance < 0.5)
    return _Belief(prior, noise, factors, chance * trend(weights), held, smaller, trusted)


def _pull_along(coupling: np.ndarray, foretold: np.ndarray) -> np.ndarray:
    """(T, N + K) linear term of `c_t (a_t - a_(t-1) - f_t)²` with the steps foretold (T, N), mm²."""
    push = np.zeros_like(coupling)
    push[:, : foretold.shape[1]] = coupling[:, : foretold.shape[1]] * foretold
    return np.vstack([push[1:], np.zeros_like(push[:1])]) - push


def _coupling(rows: MarkerRows, prior: TakePrior, noise: float, rate: float, factors) -> np.ndarray:
    """(T, N + K) coupling of neighbouring frames, mm²; `factors` (T, N) are those on the shapes'."""
    coupling = np.full((len(rows.targets), len(rows.lower)), noise**2 / step_variance(HELMET_STEP, rate))
    coupling[:, : rows.shapes] = factors * noise**2 / prior.steps
    return coupling


def _calibrated(
    rows: MarkerRows, belief: _Belief, rate: float, smoothness: float, curves: Curves, least: float, quick: np.ndarray
) -> tuple[Curves, np.ndarray]:
    """The curves on the markers' and tracks' scale and their errors (N,), told by a solve that does not know them.

    Markers stay in sight when a lid shuts, tracks of its paint do not.
    """
    terms = _terms(rows, belief, rate, smoothness, None, np.full(rows.shapes, least))
    alone, _ = terms.solved()
    noise = belief.noise
    variance = posterior(rows.mean_gram, terms.precision, belief.prior.steps, noise**2)[0].diagonal()[: rows.shapes]
    by_markers, by_all = (weight_errors(part, noise) < TELLING for part in (rows.markers, rows))
    return curves.calibrated(alone[:, : rows.shapes], variance, by_all, quick & ~by_markers, least)


def _precision(prior: TakePrior, noise: float, size: int) -> np.ndarray:
    count = len(prior.steps)
    precision = np.eye(size) * HELMET_RIDGE
    precision[:count, :count] = noise**2 * np.linalg.inv(prior.covariance)
    return precision
