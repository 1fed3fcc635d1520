"""What a solve of marker rows ends with, whichever the method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import Certificate
from blendcap.solving.rows import MarkerRows


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
