"""Points in a picture, found by filters over histograms of oriented gradients (section 3.2.2 of the thesis)."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError, LandmarkModel
from blendcap.modeling.hog import cell_maps, describe
from blendcap.modeling.mean_shift import mean_shift

KEPT = 200  # of the highest scores
BANDWIDTH = 10.0  # of the mean shift, pixels
STEP = 2  # pixels between the places that are looked at
CHUNK = 8192  # descriptors in memory at a time


def detect(image: np.ndarray, model: LandmarkModel, step: int = STEP) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (L, 2) of the model's points in a picture, and how sure each is (L,): log-odds of good over bad.

    Of all scores of a point the highest are kept, those that are rather bad are dropped, the rest is clustered by
    mean shift; the cluster wins that is largest times the prior at its center. A point without a good score is NaN.

    Parameters
    ----------
    image : (H, W, C)
        0 to 1, of the model's size.
    model : LandmarkModel
    step : int
        Look at every such pixel.
    """
    pixels, scores = score_map(image, model, step)
    found, odds = np.full((len(model.names), 2), np.nan), np.full(len(model.names), -np.inf)
    for k in range(len(model.names)):
        flat = scores[:, k].ravel()  # of every place and filter
        best = np.argpartition(-flat, min(KEPT, len(flat)) - 1)[:KEPT]
        own = log_odds(flat[best], model.good[k], model.bad[k])
        odds[k] = own.max()
        if (own > 0).any():
            centers, sizes = mean_shift(pixels[best[own > 0] // scores.shape[2]], BANDWIDTH)
            value = np.log(sizes) + log_prior(centers, model.mean[k], model.covariance[k])
            found[k] = centers[value.argmax()]
    return found, odds


def score_map(image: np.ndarray, model: LandmarkModel, step: int) -> tuple[np.ndarray, np.ndarray]:
    """The places looked at (P, 2), pixels, and their scores (P, L, K)."""
    if image.ndim != 3 or image.shape[2] != model.channels:
        raise InputError(f"The landmark model knows pictures of {model.channels} channels, but this has the shape "
                         f"{image.shape}; train one on such pictures.")  # fmt: skip
    maps = cell_maps(image, model.cell)
    y, x = np.mgrid[0 : image.shape[0] : step, 0 : image.shape[1] : step]
    pixels = np.stack([x.ravel(), y.ravel()], 1).astype(np.float64)
    return pixels, scores_at(maps, pixels, model)


def scores_at(maps: np.ndarray, pixels: np.ndarray, model: LandmarkModel) -> np.ndarray:
    """Scores (P, L, K) of places (P, 2) in a picture with these cell maps."""
    count, filters, depth = model.filters.shape
    flat = model.filters.reshape(-1, depth).T
    rows = [
        describe(maps, pixels[start : start + CHUNK], model.cells, model.cell) @ flat
        for start in range(0, len(pixels), CHUNK)
    ]
    return np.concatenate(rows).reshape(-1, count, filters)


def log_odds(scores: np.ndarray, good: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """How much more likely scores (P,) come from the good Gaussian than from the bad one; natural logarithm.

    A score above the good ones' mean is as good as that.
    """
    scores = np.minimum(scores, good[0])
    return _log_normal(scores, *good) - _log_normal(scores, *bad)


def log_prior(points: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Logarithm (P,), up to a constant, of the normal density at points (P, 2)."""
    off = points - mean
    return -0.5 * np.einsum("pi,ij,pj->p", off, np.linalg.inv(covariance), off)


def _log_normal(values: np.ndarray, mean: float, deviation: float) -> np.ndarray:
    return -0.5 * ((values - mean) / deviation) ** 2 - np.log(deviation)
