"""Ways from 0 to 1 that begin and end level."""

from __future__ import annotations

import numpy as np


def smoothstep(low: float, high: float, x: np.ndarray) -> np.ndarray:
    """0 at `low`, 1 at `high`, level at both; `low` may be the larger."""
    t = np.clip((np.asarray(x) - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def least_jerk(x: np.ndarray) -> np.ndarray:
    """From 0 at 0 to 1 at 1 with the least jerk (Flash and Hogan 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985)."""
    x = np.clip(x, 0, 1)
    return np.minimum(x**3 * (10 - 15 * x + 6 * x**2), 1)
