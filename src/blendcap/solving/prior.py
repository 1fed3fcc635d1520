"""A Gaussian prior on poses and their changes, learned from the very take that is being solved.

Empirical Bayes: the prior's covariance is the second moment of the answer plus what the markers leave open
(the posterior covariance). A few rounds are enough; without end the variances would keep shrinking.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import correlate1d, uniform_filter1d

START_DEVIATION = 0.35  # of a weight, before the take is seen
SYMMETRY = 0.97  # correlation of left and right partners, likewise
START_STEP = 0.02  # of a weight's change from frame to frame, at 60 frames a second
STEP_FLOOR = 0.002  # likewise: the least that a shape is believed to move
DEVIATION_FLOOR = 0.01  # the least standard deviation of a weight
PSEUDO_FRAMES = 100  # how many frames the start counts for
HELMET_RIDGE = 1e-4  # mm²: keeps the helmet's unknowns unique where too few markers are seen
HELMET_STEP = 0.006  # standard deviation of the helmet's step at 60 frames a second, of 10 mm and of 0.1 rad
HOLD = 0.03  # factor on the standard deviation of a shape that is held at rest
FREEDOM = 0.25  # degrees of freedom of Student's t: the smaller, the more a large step is an event
STUDENT_SCALE = 0.5  # of the variance of the steps
EVENT_FRAMES = 3
REACH = 0.5  # the least of shapes that blink: C tells how long eyes are shut, not how far they close
TREND = (1, 4, 6, 4, 1)  # weights of the neighbouring steps that foretell a step of theirs
DECISION_FRAMES = 5  # over which it is decided which of two shapes rests
FREQUENCIES = 16  # at which the posterior covariance is sampled


@dataclass(frozen=True, eq=False)
class TakePrior:
    """Zero-mean Gaussians of weights and of their steps.

    Parameters
    ----------
    covariance : (N, N)
        Of the weights.
    steps : (N,)
        Variance of each weight's change from one frame to the next.
    """

    covariance: np.ndarray
    steps: np.ndarray

    def holding(self, held: np.ndarray) -> TakePrior:
        """The prior that keeps the shapes `held` (N,) bool at rest."""
        return self._scaled(np.where(held, HOLD, 1.0))

    def reaching(self, quick: np.ndarray) -> TakePrior:
        """The prior that lets the shapes `quick` (N,) bool reach the height of a peak, however rare peaks are."""
        deviation = np.sqrt(np.diag(self.covariance))
        return self._scaled(np.where(quick, np.maximum(REACH / deviation, 1.0), 1.0))

    def _scaled(self, factor: np.ndarray) -> TakePrior:
        return TakePrior(self.covariance * np.outer(factor, factor), self.steps)


def step_variance(deviation: float, rate: float) -> float:
    """Of a step, from its standard deviation at 60 frames a second: a random walk's grows with the time between."""
    return deviation**2 * 60 / rate


def symmetric_prior(mirror: np.ndarray, symmetry: float, rate: float) -> TakePrior:
    """The prior before the take is seen: left and right partners go together, all else is independent.

    Parameters
    ----------
    mirror : (N,) int
        Partner of each shape; itself if it has none.
    symmetry : float
        Correlation of partners.
    rate : float
        Frames a second.
    """
    count = len(mirror)
    covariance = np.eye(count)
    paired = np.flatnonzero(mirror != np.arange(count))
    covariance[paired, mirror[paired]] = symmetry
    steps = np.full(count, step_variance(START_STEP, rate))
    return TakePrior(START_DEVIATION**2 * covariance, steps)


def relearned_prior(
    start: TakePrior, weights: np.ndarray, gram: np.ndarray, current: TakePrior, precision: np.ndarray,
    noise: float, rate: float,
) -> tuple[TakePrior, np.ndarray]:  # fmt: skip
    """The prior re-estimated from an answer, and the mean posterior covariance (N + K, N + K) of its unknowns.

    Parameters
    ----------
    start : TakePrior
        The prior before the take was seen.
    weights : (T, N)
        The answer under the prior `current`.
    gram : (N + K, N + K)
        Mean data term `H'H`, mm².
    current : TakePrior
    precision : (N + K, N + K)
        Quadratic term of the prior that was used, mm² (noise² times the inverse covariance).
    noise : float
        mm.
    rate : float
        Frames a second.
    """
    frames, count = weights.shape
    open_all, open_step = posterior(gram, precision, current.steps, noise**2)
    open_pose = open_all[:count, :count]
    # A weight that rests on its bound is known: only the frames in which it is free leave it open.
    free = (np.abs(weights) > 1e-6).mean(0)
    moment = weights.T @ weights / frames + np.sqrt(free)[:, None] * open_pose * np.sqrt(free)
    covariance = (frames * moment + PSEUDO_FRAMES * start.covariance) / (frames + PSEUDO_FRAMES)
    covariance[np.diag_indices(count)] += DEVIATION_FLOOR**2
    steps = (np.diff(weights, axis=0) ** 2).mean(0) + free * open_step if frames > 1 else current.steps
    return TakePrior(covariance, steps + step_variance(STEP_FLOOR, rate)), open_all


def step_weights(weights: np.ndarray, prior: TakePrior, mirror: np.ndarray) -> np.ndarray:
    """(T, N) factors on the coupling: Student's t in place of a Gaussian.

    A large step (a blink, a plosive) is an event and not noise, so it is charged less; a small one is charged more.
    An event rarely comes alone: steps are averaged with those of the neighbouring frames and of the partner on the
    other side before they are judged.

    Parameters
    ----------
    weights : (T, N)
    prior : TakePrior
    mirror : (N,) int
    """
    factors = np.ones_like(weights)
    scaled = np.diff(weights, axis=0) ** 2 / (STUDENT_SCALE * prior.steps)
    scaled = uniform_filter1d((scaled + scaled[:, mirror]) / 2, EVENT_FRAMES, axis=0)
    factors[1:] = (FREEDOM + 1) / (FREEDOM + scaled)
    return factors


def trend(weights: np.ndarray) -> np.ndarray:
    """(T, N) the step into each frame that the steps around it foretell: what is on its way goes on."""
    steps = correlate1d(np.diff(weights, axis=0), np.array(TREND) / sum(TREND), axis=0, mode="constant")
    return np.pad(steps, ((1, 0), (0, 0)))


def resting(weights: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    """(T, N) bool: of two shapes that exclude each other, the one that rests in each frame: the smaller.

    A jaw goes to one side or the other. Where the rig fits the performer badly, both at once may explain a motion that
    neither does, and no penalty that stays convex forbids that in all frames alike.

    Parameters
    ----------
    weights : (T, N)
        Of an answer that knows nothing of this.
    opposite : (N,) int
        The shape that excludes each shape; itself if none does.
    """
    return uniform_filter1d(weights - weights[:, opposite], DECISION_FRAMES, axis=0, mode="nearest") < 0


def posterior(
    gram: np.ndarray, precision: np.ndarray, steps: np.ndarray, variance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Posterior covariance of a frame's unknowns (N + K, N + K) and variance of the weights' steps (N,).

    As if the take had no ends: a long chain of equal frames is diagonal in frequency, and at the frequency w the
    coupling counts 2 - 2 cos w.
    """
    count = len(steps)
    coupling = variance / steps
    pose, step = np.zeros_like(gram), np.zeros(count)
    for k in range(FREQUENCIES):
        factor = 2 - 2 * np.cos((k + 0.5) * np.pi / FREQUENCIES)
        matrix = gram + precision
        matrix[np.arange(count), np.arange(count)] += coupling * factor
        covariance = variance * np.linalg.inv(matrix)
        pose += covariance / FREQUENCIES
        step += factor * np.diag(covariance)[:count] / FREQUENCIES
    return pose, step
