"""Weights over time, with the names of the shapes and the rate that give them meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from blendcap.data import checks
from blendcap.data.errors import InputError


@dataclass(frozen=True, eq=False)
class Animation:
    """Blendshape weights and head motion over time.

    Parameters
    ----------
    weights : (T, N) float64
        Nominally 0 to 1; NaN where unknown.
    names : (N,) str
        The shapes, each named once.
    rate : float
        Frames a second.
    head : (T, 4, 4) float64, optional
        Rigid motion of the head in the rig's space, from the neutral, mm.
    confidence : (T, N) float64, optional
        0 to 1.
    times : (T,) float64, optional
        Seconds, rising; t / rate if not given. A recording that dropped frames keeps its true times here.
    meta : {str: str}
        What else a file said: rig, source, timecode.

    Raises
    ------
    InputError
        If the lengths differ, there is no frame, a number is infinite, a confidence is not from 0 to 1, times do not
        rise or the rate is not positive.
    """

    weights: np.ndarray
    names: tuple[str, ...]
    rate: float
    head: np.ndarray | None = None
    confidence: np.ndarray | None = None
    times: np.ndarray = checks.FILLED
    meta: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self):
        put = object.__setattr__
        put(self, "names", checks.names(self.names, "The animation's shape names"))
        put(self, "rate", checks.rate(self.rate, "The animation's rate"))
        put(self, "weights", checks.array(self.weights, (checks.ANY, len(self.names)), "The animation's weights"))
        count = len(self.weights)
        if count == 0:
            raise InputError("The animation is empty: it needs at least one frame.")
        if np.isinf(self.weights).any():
            frame, shape = np.argwhere(np.isinf(self.weights))[0]
            raise InputError(f"The weight of {self.names[shape]!r} is infinite in frame {frame}; use NaN for unknown.")
        if self.head is not None:
            put(self, "head", checks.array(self.head, (count, 4, 4), "The animation's head motion"))
        if self.confidence is not None:
            put(self, "confidence", self._checked_confidence())
        times = np.arange(count) / self.rate if self.times is None else self.times
        put(self, "times", checks.array(times, (count,), "The animation's times", finite=True))
        if (np.diff(self.times) <= 0).any():
            frame = int((np.diff(self.times) <= 0).argmax()) + 1
            raise InputError(f"The animation's times do not rise at frame {frame}; sort or repair them.")

    def _checked_confidence(self) -> np.ndarray:
        confidence = checks.array(self.confidence, self.weights.shape, "The animation's confidence")
        outside = (confidence < 0) | (confidence > 1)
        if outside.any():
            frame, shape = np.argwhere(outside)[0]
            raise InputError(
                f"The confidence of {self.names[shape]!r} is {confidence[frame, shape]:g} in frame {frame}; it goes "
                "from 0 to 1."
            )
        return confidence

    def select(self, names) -> Animation:
        """The animation of only these shapes, in this order.

        Raises
        ------
        InputError
            If it lacks one.
        """
        place = {name: i for i, name in enumerate(self.names)}
        unknown = [n for n in names if n not in place]
        if unknown:
            raise InputError(f"The animation has no shape {unknown[0]!r}; it has {', '.join(self.names[:6])} ...")
        rows = [place[n] for n in names]
        confidence = None if self.confidence is None else self.confidence[:, rows]
        weights = self.weights[:, rows]
        return Animation(weights, tuple(names), self.rate, self.head, confidence, self.times, self.meta)
