"""Curves of weights from elsewhere, such as classified makeup patches, as rows on the weights themselves.

Eq. 4 of Reading Between the Dots (2016), Eq. 38 of the thesis (2017): `sum_i gamma_i (a_i - ã_i)²` joins the objective.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blendcap.data import Animation, InputError
from blendcap.data.names import match

CURVE_ERROR = 0.1  # standard deviation of a curve that is fully trusted: 4 mm² (the papers' maximum) at 0.2 mm of noise
LINE_SPREAD = np.array([0.1, 0.5])  # standard deviation of a curve's offset and gain, before the markers are heard
BEND_SPREAD = np.array([1.0])  # likewise of its bend between rest and full
LINE_ROUNDS = 3
MOST_MEMORY = 10.0  # frames
TINY = 1e-12
PERCENT = 1.5  # a curve that goes beyond is in another unit
TOLERANCE = 0.1  # seconds by which curves and take may differ in length before somebody must say how they lie

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Curves:
    """What is known of the weights from elsewhere.

    Parameters
    ----------
    targets : (T, N)
        ã, the weight that the curve says; 0 where it says nothing.
    confidence : (T, N)
        0, the markers alone decide, to 1.
    """

    targets: np.ndarray
    confidence: np.ndarray

    def terms(self, strength: float | np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Diagonal and linear terms (T, size) in mm² of `gamma (a - ã)²` with `gamma = strength * confidence`.

        `strength` is one number or one a shape (N,), mm².
        """
        diagonal = np.zeros((len(self.targets), size))
        diagonal[:, : self.targets.shape[1]] = strength * self.confidence
        linear = np.zeros_like(diagonal)
        linear[:, : self.targets.shape[1]] = -strength * self.confidence * self.targets
        return diagonal, linear

    def precision(self, error: float | np.ndarray) -> np.ndarray:
        """(N,) one over variance of what is known of each weight, averaged over the take."""
        return self.confidence.mean(0) / error**2

    def frames(self) -> list[Curves]:
        """Each frame on its own."""
        return [Curves(*pair) for pair in zip(self.targets[:, None], self.confidence[:, None], strict=True)]

    def energy(self, weights: np.ndarray, strength: float | np.ndarray) -> np.ndarray:
        """(T,) `sum_i gamma_i (a_i - ã_i)²`, mm²."""
        return (strength * self.confidence * (weights - self.targets) ** 2).sum(1)

    def calibrated(
        self, weights: np.ndarray, variance: np.ndarray, seen: np.ndarray, hiding: np.ndarray, least: float
    ) -> tuple[Curves, np.ndarray]:
        """The curves put on the scale of an answer without them, and what each still errs (N,), standard deviation.

        A face moves by more or less than the one that the curves were learned on, and a unit that comes with another
        is told a little of it. Where markers or tracks see a shape, a line `offset + gain * curve` through their
        answers mends both, and what is left beside it is the curve's error. That error lasts: it counts for as many
        frames as it stays alike.

        A lid that shuts hides the paint that would tell it, and the answer falls short. There a curve keeps its word at
        rest and at full; `curve + bend * curve * (1 - curve)` puts what lies between on the answer's scale, and both
        how much a frame tells and how far the curve errs fall to nothing as the lid comes down.

        Parameters
        ----------
        weights : (T, N)
            Of a solve that did not lean on the curves.
        variance : (N,)
            What that solve leaves open; so much disagreement is not the curve's fault.
        seen : (N,) bool
            Shapes that markers and tracks see well enough to judge a curve. The others' curves stay as they are.
        hiding : (N,) bool
            Of these, shapes that hide what tells them.
        least : float
            What a curve errs at least.
        """
        targets, confidence, errors = self.targets.copy(), self.confidence.copy(), np.full(len(variance), least)
        for n in np.flatnonzero(seen & (self.confidence.sum(0) > 0)):
            curve, trust, answer = self.targets[:, n], self.confidence[:, n], weights[:, n]
            if hiding[n]:
                open_ = trust * (1 - curve) ** 2
                told, _ = _mended(curve, (curve * (1 - curve))[:, None], BEND_SPREAD, answer, open_)
                excess = max(_mean((answer - told) ** 2, open_) - variance[n] - least**2, 0)
                confidence[:, n] *= least**2 / (least**2 + (1 - curve) ** 2 * excess)
            else:
                told, memory = _mended(curve, np.column_stack([np.ones_like(curve), curve]), LINE_SPREAD, answer, trust)
                missed = max(_mean((answer - told) ** 2, trust) - variance[n], least**2)
                errors[n] = np.sqrt(memory * missed * trust.mean())
            targets[:, n] = np.clip(told, 0, 1)
        return Curves(targets, confidence), errors

    def conflict(self, weights: np.ndarray) -> np.ndarray:
        """(T, N) how far the answer is from what the curve says, weight units, by its confidence."""
        return self.confidence * np.abs(weights - self.targets)


def curves_for(
    names: Sequence[str], curves: Animation, times: np.ndarray, offset: float | None = None, rig: str = "rig"
) -> Curves:
    """The curves on a rig's shapes, sampled at the frames of a take.

    Parameters
    ----------
    names : (N,) str
        The rig's shapes.
    curves : Animation
        By shape names; `confidence` is how much they count, 1 if not given. NaN says nothing.
    times : (T,)
        Of the take's frames, seconds.
    offset : float, optional
        Seconds by which the curves begin after the take (negative: before). Outside the curves nothing is said. 0 if
        both are equally long.
    rig : str
        What to call the rig in an error.

    Raises
    ------
    InputError
        If a curve that says something has no shape on the rig, or the curves and the take differ in length and nobody
        said by how much they are apart, or do not overlap.
    """
    own = curves.times - curves.times[0]
    lengths = own[-1] + 1 / curves.rate, times[-1] - times[0] + 1 / curves.rate
    if offset is None:
        if abs(lengths[0] - lengths[1]) > TOLERANCE:
            raise InputError(
                f"The curves last {lengths[0]:.2f} s and the take {lengths[1]:.2f} s; say by the offset how many "
                "seconds after the take the curves begin (0 if together)."
            )
        offset = 0.0
    at = times - times[0] - offset
    inside = (at >= -0.5 / curves.rate) & (at < own[-1] + (1 - 1e-6) / curves.rate)  # a frame lasts until the next
    if not inside.any():
        raise InputError(
            f"With an offset of {offset:g} s the curves and the take do not overlap; the take lasts {lengths[1]:.2f} s."
        )
    trust = np.ones_like(curves.weights) if curves.confidence is None else curves.confidence
    trust = np.where(np.isnan(curves.weights), 0.0, np.nan_to_num(trust))
    highest = float(np.nan_to_num(curves.weights * (trust > 0)).max(initial=0.0))
    if highest > PERCENT:
        log.warning(
            "The curves go up to %g, but 1 is all of a shape, and more is cut off; if they are in percent, divide them "
            "by 100.", highest,
        )  # fmt: skip
    places = _places(names, curves, trust, rig)
    targets, confidence = np.zeros((2, len(times), len(names)))
    for column, shapes in places.items():
        said, sure = np.nan_to_num(curves.weights[:, column]), trust[:, column]
        amount = np.interp(at, own, sure) * inside
        value = np.interp(at, own, said * sure) / np.maximum(np.interp(at, own, sure), TINY)  # a gap's edge says no 0
        for shape in shapes:
            confidence[:, shape] = amount
            targets[:, shape] = np.where(amount > 0, np.clip(value, 0, 1), 0.0)
    return Curves(targets, confidence)


def _places(names: Sequence[str], curves: Animation, trust: np.ndarray, rig: str) -> dict[int, list[int]]:
    """For each column of the curves the shapes that it speaks of."""
    table, index = match(curves.names, names), {name: i for i, name in enumerate(names)}
    places = {}
    for column, name in enumerate(curves.names):
        if name in table:
            places[column] = [index[shape] for shape in table[name]]
        elif trust[:, column].any():
            raise InputError(
                f"The curve {name!r} has no shape on the rig {rig!r}; map it to one of its shapes or leave it out."
            )
    return places


def _mended(
    curve: np.ndarray, design: np.ndarray, spread: np.ndarray, answer: np.ndarray, trust: np.ndarray
) -> tuple[np.ndarray, float]:
    """A curve (T,) and what it takes of a design (T, K) to meet an answer (T,); and over how many frames it errs alike.

    What it takes is believed to be near 0, within `spread` (K,): a curve that hardly moves teaches nothing.
    """
    told, memory = curve, 1.0
    for _ in range(LINE_ROUNDS):
        memory = _memory(answer - told)
        missed = max(_mean((answer - told) ** 2, trust), 1e-6)
        weighed = design.T * trust * len(curve) / (memory * missed * max(trust.sum(), TINY))
        told = curve + design @ np.linalg.solve(weighed @ design + np.diag(1 / spread**2), weighed @ (answer - curve))
    return told, memory


def _mean(values: np.ndarray, trust: np.ndarray) -> float:
    """Of values (T,), by how far they are trusted (T,)."""
    return float((trust * values).sum() / max(trust.sum(), TINY))


def _memory(errors: np.ndarray) -> float:
    """Frames over which errors (T,) stay alike: the time of a process that forgets by a constant part a frame."""
    centered = errors - errors.mean()
    alike = (centered[1:] * centered[:-1]).sum() / max((centered**2).sum(), 1e-12)
    return float(np.clip((1 + alike) / (1 - alike), 1, MOST_MEMORY)) if alike < 1 else MOST_MEMORY
