"""Checks at the door of the records: each says what was expected, what was given, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from blendcap.data.errors import InputError

ANY = -1
RATES = (1e-3, 1e6)  # frames a second: from time lapse to high speed
FILLED: Any = None  # the default of a field that is given its value on construction


def array(values, shape: tuple[int, ...], what: str, *, dtype: Any = np.float64, finite: bool = False) -> np.ndarray:
    """`values` as a read-only C-ordered array of `dtype` and `shape` (ANY: any length)."""
    try:
        given = np.asarray(values)
        result = np.array(given, dtype=dtype, order="C") if given.dtype != dtype else np.ascontiguousarray(given)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what} must be an array of numbers of shape {_text(shape)}: {error}.") from None
    if result.ndim != len(shape) or any(w not in (ANY, n) for w, n in zip(shape, result.shape, strict=True)):
        raise InputError(f"{what} must have the shape {_text(shape)}, but has {result.shape}.")
    if finite and not np.isfinite(result).all():
        where = np.argwhere(~np.isfinite(result))[0].tolist()
        raise InputError(f"{what} holds a NaN or an infinite number, first at {where}; remove or repair it.")
    view = result.view()
    view.flags.writeable = False
    return view


def names(values: Sequence[str], what: str) -> tuple[str, ...]:
    """`values` as a tuple of different, non-empty strings."""
    if isinstance(values, str):
        raise InputError(f"{what} must be a sequence of names, but is the one string {values!r}.")
    if not isinstance(values, Iterable):
        raise InputError(f"{what} must be a sequence of names, but is {values!r}; leave it out if there is none.")
    result = tuple(str(v) for v in values)
    if not all(result):
        raise InputError(f"{what} has an empty name at place {result.index('')}; give it one.")
    if len(set(result)) != len(result):
        double = next(n for n in result if result.count(n) > 1)
        raise InputError(f"{what} has {double!r} {result.count(double)} times; every name must be used once.")
    return result


def indices(values, upper: int, shape: tuple[int, ...], what: str, of_what: str) -> np.ndarray:
    """`values` as int64 indices into `upper` things."""
    given = np.asarray(values)
    if given.size and not np.issubdtype(given.dtype, np.integer):
        raise InputError(f"{what} must be whole numbers (indices of {of_what}), but are {given.dtype}.")
    result = array(given, shape, what, dtype=np.int64)
    if result.size and result.min() < 0:
        raise InputError(f"{what} names {of_what} {int(result.min())}, but {of_what} numbers begin at 0.")
    if result.size and result.max() >= upper:
        worst = int(result.max())
        raise InputError(f"{what} names {of_what} {worst}, but there are {upper} (0 to {upper - 1}).")
    return result


def normal_map(values, what: str) -> np.ndarray:
    """`values` as a normal map (H, W, 3) uint8."""
    given = np.asarray(values)
    if given.dtype != np.uint8:
        raise InputError(f"{what} must hold bytes (uint8, 128 is 0), but is {given.dtype}.")
    result = array(given, (ANY, ANY, 3), what, dtype=np.uint8)
    if not result.size:
        raise InputError(f"{what} has no texels; leave it out instead.")
    return result


def rate(value: float, what: str) -> float:
    """A frame rate in frames a second."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{what} must be a number of frames a second, but is {value!r}.") from None
    if not (np.isfinite(result) and result > 0):
        raise InputError(f"{what} must be a positive number of frames a second, but is {value!r}; state the true rate.")
    if not RATES[0] <= result <= RATES[1]:
        raise InputError(f"{what} is {result:g} frames a second, which no recording has; state the true rate.")
    return result


def _text(shape: tuple[int, ...]) -> str:
    inner = ", ".join("any" if n == ANY else str(n) for n in shape)
    return f"({inner}{',' if len(shape) == 1 else ''})"
