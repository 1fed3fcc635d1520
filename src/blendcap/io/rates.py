"""Frame rates and gaps in time."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError

_COMMON = (23.976, 24, 25, 29.97, 30, 48, 50, 59.94, 60, 90, 100, 120, 200, 240)


def rate_of_times(times: np.ndarray, where: str) -> float:
    """The rate (1/s) of frames at `times` (T,) in seconds: of their median step, snapped to a common rate within 0.2 %.

    The median makes it blind to dropped frames; snapping undoes the rounding of times in text files.
    """
    if len(times) < 2:
        raise InputError(f"{where} has one frame and states no rate; add a line '# rate: 60' with the true rate.")
    step = float(np.median(np.diff(times)))
    if not step > 0:
        raise InputError(f"The times of {where} do not rise; sort or repair them.")
    near = min(_COMMON, key=lambda rate: abs(rate * step - 1))
    return float(near) if abs(near * step - 1) < 0.002 else 1 / step
