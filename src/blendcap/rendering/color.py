"""sRGB, as files and screens have it, and linear light, in which colors may be added."""

from __future__ import annotations

import numpy as np


def to_linear(color: np.ndarray) -> np.ndarray:
    """Linear light of sRGB values, both 0 to 1."""
    color = np.asarray(color, dtype=np.float64)
    return np.where(color <= 0.04045, color / 12.92, ((np.maximum(color, 0) + 0.055) / 1.055) ** 2.4)


def to_pixels(linear: np.ndarray) -> np.ndarray:
    """sRGB uint8 of linear light 0 to 1, which is clipped."""
    return _PIXELS[(np.clip(linear, 0, 1) * (len(_PIXELS) - 1) + 0.5).astype(np.int32)]


def _encode(linear: np.ndarray) -> np.ndarray:
    value = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (value * 255 + 0.5).astype(np.uint8)


LINEAR = to_linear(np.arange(256) / 255)  # of each byte
_PIXELS = _encode(np.arange(16384) / 16383)  # fine enough for every byte to come back from its linear value
