"""Lines between lips and lids, traced from corner to corner (section 3.2.2 of the thesis).

A line is a row for each column of a ribbon, a strip of the picture laid along the straight line between its corners.
Its energy asks for dark, even and smooth: the intensity of each place, the squared change of intensity and the squared
step between neighbors. The thesis lowers it place by place until nothing changes (iterated conditional modes);
`trace_exact` finds its least value by dynamic programming.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

ROUNDS = 50


class Weights(NamedTuple):
    """Of the three wishes: even intensity, low intensity, smoothness (a squared step of a pixel)."""

    even: float = 1.0
    dark: float = 1.0
    smooth: float = 0.02


def ribbon(start: np.ndarray, end: np.ndarray, half: int) -> np.ndarray:
    """Pixels (2 * half + 1, W, 2) of a strip along the line from `start` to `end` (2,), its middle row on the line."""
    along = np.asarray(end, dtype=np.float64) - start
    length = max(float(np.hypot(*along)), 1.0)
    along = along / length
    across = np.array([-along[1], along[0]])
    columns = np.linspace(0, length, max(round(length) + 1, 3))
    offsets = np.arange(-half, half + 1)
    return start + columns[None, :, None] * along + offsets[:, None, None] * across


def sampled(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values (...) of an image (H, W) at pixels (..., 2); beyond its border it goes on."""
    x, y = (pixels[..., k].astype(np.float32) for k in (0, 1))
    return cv2.remap(image.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def line_energy(cost: np.ndarray, rows: np.ndarray, weights: Weights) -> float:
    """The energy of a line: `rows` (W,) through a cost (H, W)."""
    values = cost[rows, np.arange(cost.shape[1])]
    steps = np.diff(rows) ** 2
    return float(weights.dark * values.sum() + (weights.even * np.diff(values) ** 2 + weights.smooth * steps).sum())


def trace_icm(cost: np.ndarray, weights: Weights) -> np.ndarray:
    """The line (W,) that the thesis' way finds: from the straight one, column by column, until nothing changes.

    Places that are more than a standard deviation darker or brighter than the line so far are not considered.
    """
    height, width = cost.shape
    rows = np.full(width, height // 2)
    every = np.arange(height)
    for _ in range(ROUNDS):
        before = rows.copy()
        for x in range(1, width - 1):
            line = cost[rows, np.arange(width)]
            local = weights.dark * cost[:, x]
            for side in (x - 1, x + 1):
                local = local + weights.even * (cost[:, x] - line[side]) ** 2
                local = local + weights.smooth * (every - rows[side]) ** 2
            strange = cost[:, x] > line.mean() + line.std()
            strange[rows[x]] = False
            rows[x] = np.where(strange, np.inf, local).argmin()
        if np.array_equal(rows, before):
            break
    return rows


def trace_exact(cost: np.ndarray, weights: Weights) -> np.ndarray:
    """The line (W,) of least energy, its ends in the middle row."""
    height, width = cost.shape
    every = np.arange(height)
    steps = weights.smooth * (every[:, None] - every[None]) ** 2
    middle = height // 2
    best = np.where(every == middle, weights.dark * cost[:, 0], np.inf)
    back = np.zeros((width, height), dtype=np.int64)
    for x in range(1, width):
        change = weights.even * (cost[:, x][:, None] - cost[:, x - 1][None]) ** 2
        total = best[None] + steps + change
        back[x] = total.argmin(1)
        best = total.min(1) + weights.dark * cost[:, x]
    rows = np.full(width, middle)
    for x in range(width - 1, 0, -1):
        rows[x - 1] = back[x][rows[x]]
    return rows
