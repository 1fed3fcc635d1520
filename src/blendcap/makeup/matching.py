"""Small windows of the neutral picture found again in another picture, to a fraction of a pixel.

The inverse compositional way of Lucas and Kanade's matching (Baker and Matthews 2004,
doi:10.1023/B:VISI.0000011205.11775.fd): gradients are those of the neutral window and are computed once. Windows are
compared by their correlation, so the light may change, and are warped as the skin is expected to be.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numba import njit

REACH = 7  # pixels from the middle of a window to its border
ROUNDS = 12
SETTLED = 0.01  # pixels: a step that is smaller is the last
LONGEST = 3.0  # pixels that one step may go
STEADY = 0.01  # of the larger eigenvalue: what keeps a window from sliding along its edge


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of the neutral picture.

    Parameters
    ----------
    looks : (K, n, n) float32
        Grey values; their mean is 0 and their mean square 1 over the pixels that count.
    slopes : (K, n, n, 2) float32
        Their gradients, per pixel.
    counts : (K, n, n) float32
        How much each pixel counts; they sum to 1.
    steps : (K, 2, 2) float64
        From what the gradients say to a step: the inverse of their sum of squares, held steady along edges.
    values, directions : (K, 2), (K, 2, 2) float64
        Eigenvalues of the structure tensor (mean squared slope, grey values a pixel), the larger first, and their
        directions.
    """

    looks: np.ndarray
    slopes: np.ndarray
    counts: np.ndarray
    steps: np.ndarray
    values: np.ndarray
    directions: np.ndarray

    @classmethod
    def cut(cls, picture: np.ndarray, middles: np.ndarray, counts: np.ndarray | None = None) -> Windows:
        """Cut windows around pixels (K, 2) out of a picture (H, W) float32; `counts` (K, n, n) say what belongs."""
        middles = np.ascontiguousarray(middles, dtype=np.float64)
        looks = _sampled(picture, middles, np.tile(np.eye(2), (len(middles), 1, 1)))
        belongs = np.ones_like(looks) if counts is None else counts.astype(np.float32)
        shares = belongs / np.maximum(belongs.sum((1, 2), keepdims=True), 1)
        looks = looks - (shares * looks).sum((1, 2), keepdims=True)
        length = np.sqrt((shares * looks**2).sum((1, 2), keepdims=True))
        slopes = np.stack([np.gradient(looks, axis=2), np.gradient(looks, axis=1)], axis=-1)
        squares = np.einsum("kyx,kyxi,kyxj->kij", shares, slopes, slopes, dtype=np.float64)
        values, directions = np.linalg.eigh(squares)
        values, directions = np.maximum(values[:, ::-1], 0), directions.transpose(0, 2, 1)[:, ::-1]
        scale = np.maximum(length, 1e-6)
        steady = squares + (STEADY * values[:, 0] + 1e-12)[:, None, None] * np.eye(2)
        steps = np.linalg.inv(steady) * scale[..., 0, None] ** 2
        return cls(looks / scale, slopes / scale[..., None], shares, steps, values, directions)

    def of(self, chosen: np.ndarray) -> Windows:
        """The chosen windows."""
        return Windows(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def find(self, picture: np.ndarray, start: np.ndarray, warp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the windows are in another picture (H, W) float32.

        Parameters
        ----------
        start : (K, 2)
            Where they are sought, pixels.
        warp : (K, 2, 2)
            From an arm in the neutral picture to one in this.

        Returns
        -------
        places : (K, 2)
            Pixels.
        correlation : (K,)
            Correlation with the neutral window, -1 to 1; -1 where the window left the picture.
        """
        places = np.array(start, dtype=np.float64)
        warp = np.ascontiguousarray(warp, dtype=np.float64)
        return places, _find(picture, self.looks, self.slopes, self.counts, self.steps, places, warp)


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(picture, x, y, warp, window):
    """Fill a window (n, n) with the picture around (x, y), bilinear; False if it is not all inside."""
    height, width = picture.shape
    size = window.shape[0]
    half = size // 2
    for row in range(size):
        for column in range(size):
            u, v = column - half, row - half
            px = x + warp[0, 0] * u + warp[0, 1] * v
            py = y + warp[1, 0] * u + warp[1, 1] * v
            if not (0 <= px < width - 1 and 0 <= py < height - 1):
                return False
            i, j = int(px), int(py)
            a, b = px - i, py - j
            top = (1 - a) * picture[j, i] + a * picture[j, i + 1]
            low = (1 - a) * picture[j + 1, i] + a * picture[j + 1, i + 1]
            window[row, column] = (1 - b) * top + b * low
    return True


@njit(cache=True, nogil=True)
def _sampled(picture, middles, warp):
    size = 2 * REACH + 1
    windows = np.zeros((len(middles), size, size), dtype=np.float32)
    for k in range(len(middles)):
        _sample(picture, middles[k, 0], middles[k, 1], warp[k], windows[k])
    return windows


@njit(cache=True, nogil=True, error_model="numpy")
def _find(picture, looks, slopes, counts, steps, places, warp):
    """Move `places` (K, 2) to where the windows are; and how they correlate there."""
    count, size = len(looks), looks.shape[1]
    correlation, window = np.full(count, -1.0), np.empty((size, size), dtype=np.float32)
    for k in range(count):
        for _ in range(ROUNDS):
            if not _sample(picture, places[k, 0], places[k, 1], warp[k], window):
                correlation[k] = -1.0
                break
            mean = 0.0
            for row in range(size):
                for column in range(size):
                    mean += counts[k, row, column] * window[row, column]
            length, match = 0.0, 0.0
            for row in range(size):
                for column in range(size):
                    value = window[row, column] - mean
                    length += counts[k, row, column] * value * value
                    match += counts[k, row, column] * value * looks[k, row, column]
            length = np.sqrt(max(length, 1e-12))
            correlation[k] = match / length
            along, down = 0.0, 0.0
            for row in range(size):
                for column in range(size):
                    error = counts[k, row, column] * ((window[row, column] - mean) / length - looks[k, row, column])
                    along += slopes[k, row, column, 0] * error
                    down += slopes[k, row, column, 1] * error
            u = steps[k, 0, 0] * along + steps[k, 0, 1] * down
            v = steps[k, 1, 0] * along + steps[k, 1, 1] * down
            far = np.sqrt(u * u + v * v)
            if far > LONGEST:
                u, v = u * LONGEST / far, v * LONGEST / far
            places[k, 0] -= warp[k, 0, 0] * u + warp[k, 0, 1] * v
            places[k, 1] -= warp[k, 1, 0] * u + warp[k, 1, 1] * v
            if far < SETTLED:
                break
    return correlation
