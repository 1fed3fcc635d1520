"""Units of length in files; everything inside is millimetres."""

from __future__ import annotations

import logging

import numpy as np

from blendcap.data import InputError

MILLIMETRES = {
    "mm": 1.0,
    "cm": 10.0,
    "dm": 100.0,
    "m": 1000.0,
    "in": 25.4,
    "ft": 304.8,
}
_SPELLINGS = {
    "millimeter": "mm", "millimetre": "mm", "centimeter": "cm", "centimetre": "cm", "decimeter": "dm",
    "decimetre": "dm", "meter": "m", "metre": "m", "inch": "in", "inche": "in", "foot": "ft", "feet": "ft",
}  # fmt: skip

_log = logging.getLogger(__name__)


def millimetres(unit: str, where: str) -> float:
    """How many millimetres one `unit` is; `where` names the file in the error."""
    name = _plain(unit)
    if name not in MILLIMETRES:
        known = ", ".join(MILLIMETRES)
        stated = f"gives lengths in {unit!r}, which is unknown" if unit else "does not say the unit of its lengths"
        raise InputError(f"{where} {stated}; say the unit yourself: {known}.")
    return MILLIMETRES[name]


def is_unit(unit: str) -> bool:
    """Whether a unit of length is known, in any spelling."""
    return _plain(unit) in MILLIMETRES


def _plain(unit: str) -> str:
    name = unit.strip().lower()
    return _SPELLINGS.get(name.rstrip("s"), name)


def warn_if_not_a_head(vertices: np.ndarray, where: str) -> None:
    """Warn if a mesh from a file without a unit cannot be a head in millimetres."""
    size = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if not 50 <= size <= 3000:
        _log.warning(
            "%s is %.3g mm large, which is no head: it may be in another unit: say which by unit= or --unit.",
            where,
            size,
        )
