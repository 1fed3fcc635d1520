"""Frame rates and gaps in time."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError, checks

_COMMON = (23.976, 24, 25, 29.97, 30, 48, 50, 59.94, 60, 90, 100, 120, 200, 240)


def stated_rate(text: str | None, times: np.ndarray | None, where: str) -> float:
    """The rate (1/s) that a file states in words, else that of its times (T,); `where` names the file in errors."""
    if times is not None and not np.isfinite(times).all():
        row = int(np.argmin(np.isfinite(times)))
        raise InputError(f"Row {row + 1} after the header of {where} has no time; write it in, or drop the column.")
    if text is not None:
        return checks.rate(text, f"The rate of {where}")  # pyright: ignore[reportArgumentType]
    if times is None:
        raise InputError(f"{where} has neither a rate nor a time column; add a line '# rate: 60' at its top.")
    return rate_of_times(times, where)


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
