"""The lines of lips and lids in a picture, from corner to corner."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from blendcap.data import LandmarkModel
from blendcap.modeling.contours import Weights, ribbon, sampled, trace_exact, trace_icm
from blendcap.modeling.detection import log_odds, scores_at
from blendcap.modeling.hog import cell_maps
from blendcap.modeling.landmark_names import ENDS, LINES, ON_A_LINE, along, contact_of, line_names

REACH = 0.35  # of a line's length, how far it may leave the straight line
PAPER_REACH = 50  # pixels of a texture of 1024
LEARNED = Weights(even=0.0, dark=1.0, smooth=3.0)  # for log-odds
PAPER = Weights(even=1.0, dark=1.0, smooth=0.02)  # for brightness over its own deviation
DARK = 2.0  # log-odds that a standard deviation of brightness is worth
TOGETHER, BESIDE = 0.1, 0.15  # of a line's length: two lines nearer than this fell together; a gap shows so far off
RIM = 2  # pixels from a line within which its surface must be seen
THROUGH = 0.2  # share of a line that may lie over a gap
BEYOND = 1e6  # mm: the depth where a picture sees nothing
LOWEST = -20.0  # log-odds; one odd place must not decide


def trace_learned(image: np.ndarray, found: Mapping[str, np.ndarray], model: LandmarkModel) -> dict[str, np.ndarray]:
    """Pixels (W, 2) of each line whose corners were found: of high log-odds, dark and smooth."""
    maps = cell_maps(image, model.cell)
    lines = {}
    for line in LINES:
        start, end = (found[name] for name in ENDS[contact_of(line)[0]])
        if not np.isfinite([start, end]).all():
            continue
        strip = ribbon(start, end, max(round(REACH * float(np.hypot(*(end - start)))), 2))
        rows = [model.names.index(name) for name in line_names(line)]
        scores = scores_at(maps, strip.reshape(-1, 2), model)[:, rows].max(2)
        odds = np.stack([log_odds(scores[:, k], model.good[r], model.bad[r]) for k, r in enumerate(rows)], 1)
        odds = np.maximum(odds, LOWEST).reshape(*strip.shape[:2], -1)
        cost = -np.einsum("hwk,wk->hw", odds, _shares(strip.shape[1])) + DARK * _brightness(image, strip)
        lines[line] = strip[trace_exact(cost, LEARNED), np.arange(strip.shape[1])]
    return lines


def _brightness(image: np.ndarray, strip: np.ndarray) -> np.ndarray:
    """Mean brightness of the channels along a strip, each over its own deviation there, no more than two of them."""
    values = np.stack([sampled(image[..., c], strip) for c in range(image.shape[2])])
    spread = np.maximum(values.std((1, 2), keepdims=True), 1e-6)
    return np.clip((values - values.mean((1, 2), keepdims=True)) / spread, -2, 2).mean(0)


def trace_paper(image: np.ndarray, found: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Pixels (W, 2) of each line in the thesis' way: the dark one, the same above and below."""
    lines = {}
    for line in LINES:
        start, end = (found[name] for name in ENDS[contact_of(line)[0]])
        if not np.isfinite([start, end]).all():
            continue
        strip = ribbon(start, end, PAPER_REACH)
        values = sampled(image, strip)
        cost = (values - values.mean()) / max(float(values.std()), 1e-6)
        lines[line] = strip[trace_icm(cost, PAPER), np.arange(strip.shape[1])]
    return lines


def without_lost(lines: Mapping[str, np.ndarray], depth: np.ndarray, gap: float) -> dict[str, np.ndarray]:
    """The lines (W, 2) without pairs, upper and lower, of which one was lost, as at sockets without an eyeball.

    A line is lost if it runs through a gap, or lies on the gap's other rim: then the two fall together, as shut lids
    or lips do, but the picture looks past them into the gap.

    Parameters
    ----------
    lines : {name: (W, 2)}
        Pixels.
    depth : (H, W) float
        Of the picture, mm; infinite where it sees nothing.
    gap : float
        The step in depth that is one, mm.
    """
    solid = np.where(np.isfinite(depth), depth, BEYOND)
    kept = dict(lines)
    for upper in (line for line in LINES if "_upper" in line and line in lines):
        lower = upper.replace("_upper", "_lower")
        pair = np.stack([lines[upper], lines[lower]])
        length = float(np.linalg.norm(pair[0, -1] - pair[0, 0]))
        inner = pair[:, pair.shape[1] // 4 : -(pair.shape[1] // 4) or None]
        nearer = _rim(solid, pair[:, [0, -1]]).min()  # of the two corners, of which one lies farther back
        through = ((_rim(solid, inner) > nearer + 2 * gap).mean(1) > THROUGH).any()
        together = np.linalg.norm(inner[0] - inner[1], axis=1).mean() < TOGETHER * length
        middle = inner.mean(0)
        steps = [np.median(_at(solid, middle, y * length) - _rim(solid, middle)) for y in (-BESIDE, BESIDE)]
        if through or (together and max(steps) > gap):
            del kept[upper], kept[lower]
    return kept


def _rim(depth: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The depth of what is nearest at or beside pixels (..., 2)."""
    return np.min([_at(depth, pixels, below) for below in range(-RIM, RIM + 1)], axis=0)


def _at(depth: np.ndarray, pixels: np.ndarray, below: float) -> np.ndarray:
    x, y = np.moveaxis(np.round(pixels + np.array([0, below])).astype(int), -1, 0)
    return depth[np.clip(y, 0, depth.shape[0] - 1), np.clip(x, 0, depth.shape[1] - 1)]


def line_points(line: str, pixels: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Names and pixels of evenly spaced points on a line of pixels (W, 2)."""
    return line_names(line), along(pixels)[0]


def _shares(width: int) -> np.ndarray:
    """How much each learned point of a line speaks for each column, (W, ON_A_LINE): the two nearest share it."""
    at = np.clip(np.linspace(0, ON_A_LINE + 1, width) - 1, 0, ON_A_LINE - 1)
    return np.maximum(1 - np.abs(at[:, None] - np.arange(ON_A_LINE)), 0)
