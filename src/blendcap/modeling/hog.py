"""Histograms of oriented gradients (Dalal and Triggs 2005) at any places of a picture, all at once."""

from __future__ import annotations

import cv2
import numpy as np

BINS = 9  # of gradient directions, without sign, over half a turn
SMOOTH = 1.0  # deviation of the Gaussian that a picture is smoothed with first, pixels
FAINT = 0.01  # gradients of this size, of a picture's range 0 to 1, count half
CLIP = 0.2  # no direction may make up more of a descriptor


def cell_maps(image: np.ndarray, cell: int) -> np.ndarray:
    """For every pixel the histogram of the cell around it, (H, W, C * BINS) float32.

    Parameters
    ----------
    image : (H, W, C)
        0 to 1.
    cell : int
        Side of a cell, pixels.
    """
    image = np.asarray(image, dtype=np.float32)
    maps = [_directions(image[..., c]) for c in range(image.shape[2])]
    box = (cell, cell)
    return np.concatenate([cv2.boxFilter(m, -1, box, borderType=cv2.BORDER_REPLICATE) for m in maps], axis=2)


def describe(maps: np.ndarray, pixels: np.ndarray, cells: int, cell: int) -> np.ndarray:
    """Descriptors (P, C * cells**2 * BINS) float32 of the squares around `pixels` (P, 2), each of length 1.

    Channels are normalised each by itself, so that a faint one speaks too. Beyond the border the picture goes on.
    """
    height, width, depth = maps.shape
    reach = (np.arange(cells) - (cells - 1) / 2) * cell
    corner = np.round(np.asarray(pixels)[:, None] + np.stack([reach, reach], 1)[None]).astype(int)  # (P, cells, 2)
    columns, rows = np.clip(corner[..., 0], 0, width - 1), np.clip(corner[..., 1], 0, height - 1)
    values = maps[rows[:, :, None], columns[:, None, :]]  # (P, cells, cells, C * BINS)
    values = values.reshape(len(values), cells, cells, depth // BINS, BINS).transpose(0, 3, 1, 2, 4)
    values = values.reshape(len(values), depth // BINS, -1)
    values = np.minimum(_unit(values, FAINT * np.sqrt(values.shape[2]) / BINS), CLIP)
    return _unit(values, 1e-6).reshape(len(values), -1) / np.float32(np.sqrt(values.shape[1]))


def _directions(channel: np.ndarray) -> np.ndarray:
    """The gradient of (H, W), its size shared out to the two nearest directions, (H, W, BINS)."""
    smooth = cv2.GaussianBlur(channel, (0, 0), SMOOTH, borderType=cv2.BORDER_REPLICATE)
    dy, dx = np.gradient(smooth)
    size = np.hypot(dx, dy)
    turn = (np.arctan2(dy, dx) % np.pi) * (BINS / np.pi)
    low = np.floor(turn)
    share = turn - low
    bins = np.zeros((*channel.shape, BINS), dtype=np.float32)
    first = low.astype(int) % BINS
    np.put_along_axis(bins, first[..., None], (size * (1 - share))[..., None], 2)
    second = (first + 1) % BINS
    np.put_along_axis(bins, second[..., None], (size * share)[..., None], 2)
    return bins


def _unit(values: np.ndarray, floor: float) -> np.ndarray:
    squares = np.einsum("...i,...i->...", values, values)
    return values / np.sqrt(squares + np.float32(floor**2))[..., None]
