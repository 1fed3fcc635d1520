"""What a performer shows while a classifier is trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Lesson:
    """What the performer did, frame by frame.

    Parameters
    ----------
    units : (T,) str
        The action unit that is being shown, from rest to rest; "" where none is.
    repetitions : (T,) int
        Which showing it is. Accuracies are measured on whole showings that were left out: neighboring frames are too
        alike to test each other.
    """

    units: np.ndarray
    repetitions: np.ndarray

    @classmethod
    def of_spans(cls, spans: Sequence[tuple[float, float, str]], frames: int, rate: float) -> Lesson:
        """From spans (start, end, unit), seconds, one a showing."""
        units, repetitions = np.full(frames, "", dtype=object), np.zeros(frames, dtype=int)
        for number, (start, end, unit) in enumerate(spans, 1):
            part = slice(round(start * rate), round(end * rate))
            units[part], repetitions[part] = unit, number
        return cls(units, repetitions)
