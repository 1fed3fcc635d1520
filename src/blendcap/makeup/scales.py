"""How weakly a unit is told of paint that lies elsewhere, and what makes up for it.

A machine that knows one painter's strokes tells another's motion too weakly, as every regression does whose input is
noisy (attenuation; Spearman 1904, doi:10.2307/1412159). Warped copies of the lesson, whose intensities are known,
measure by how much, and most of it is made up for: what is told is brought near to the truth in the mean of all frames,
of which most are at rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

SHOWN = 0.1  # an intensity below is none
GAINS = (0.5, 4.0)  # least and most
BENDS = (1.0, 2.0)
STARTS = ((1.0, 1.0), (1.5, 1.2), (3.0, 1.5))  # the sum of squares may have several lows


def scaled(told: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Intensities (T, U), 0 and up: `gain * told ** bend` of what a machine tells (T, U), with scales (U, 2)."""
    gain, bend = scales.T
    return gain * np.clip(told, 0, 1) ** bend


def fit_scales(told: np.ndarray, true: np.ndarray, units: Sequence[str]) -> np.ndarray:
    """Gain and bend (U, 2) that bring what is told of copies nearest to the truth, in the least-squares sense.

    The bend keeps what is faint, and may be nothing, from growing with the rest. Both sides of a face have one scale.
    A unit that is never shown, or shown below `SHOWN`, keeps its word, and so does one of which nothing is told.

    Parameters
    ----------
    told, true : (T, U)
        Intensities; 1 is full, and more than that is not told apart.
    units : sequence of str
    """
    scales = np.ones((len(units), 2))
    for whole in {unit.rstrip("LR") for unit in units}:
        places = [place for place, unit in enumerate(units) if unit.rstrip("LR") == whole]
        if true[:, places].max() >= SHOWN:
            scales[places] = _fit(told[:, places].ravel(), true[:, places].ravel())
    return scales


def _fit(told: np.ndarray, true: np.ndarray) -> np.ndarray:
    from scipy.optimize import least_squares

    def error(scale: np.ndarray) -> np.ndarray:
        return np.minimum(scaled(told[:, None], scale[None])[:, 0], 1) - true

    fits = [least_squares(error, start, bounds=tuple(zip(GAINS, BENDS, strict=True))) for start in STARTS]
    return min(fits, key=lambda fit: fit.cost).x
