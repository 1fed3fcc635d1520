"""sRGB, as files and screens have it, and linear light, in which colors may be added."""

from __future__ import annotations

import numpy as np


def to_linear(color: np.ndarray) -> np.ndarray:
    """Linear light of sRGB values, both 0 to 1."""
    color = np.asarray(color, dtype=np.float64)
    return np.where(color <= 0.04045, color / 12.92, ((np.maximum(color, 0) + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """sRGB of linear light, both 0 to 1."""
    linear = np.asarray(linear, dtype=np.float64)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)


LINEAR = to_linear(np.arange(256) / 255)  # of each byte
STEPS = 16384  # of linear light: fine enough for every byte to come back from its linear value
PIXELS = (to_srgb(np.arange(STEPS) / (STEPS - 1)) * 255 + 0.5).astype(np.uint8)  # the byte of each step
