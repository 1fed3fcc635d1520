"""Points in a picture, found by filters over histograms of oriented gradients (section 3.2.2 of the thesis)."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError, LandmarkModel
from blendcap.modeling.hog import cell_maps, describe
from blendcap.modeling.mean_shift import mean_shift

KEPT = 200  # of the highest scores
BANDWIDTH = 10.0  # of the mean shift, pixels
NARROW = 5.0  # the same, where likelihoods tell the places apart
LEAST = -5.0  # log-odds: a place where the point should be need not look like it much
DEVIATIONS = 3.0  # of the prior, within which a point is looked for
PLACES = 1500  # that are looked at for one point
CHUNK = 8192  # descriptors in memory at a time


def detect(image: np.ndarray, model: LandmarkModel, *, slack: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (L, 2) of the model's points in a picture, and how sure each is (L,): log-odds of good over bad there.

    What the scores say is weighed against where the point should lie, place by place; the 200 most likely places are
    clustered by mean shift, weighted by their likelihood, and the heaviest cluster wins. A point whose likeliest place
    looks nothing like it is NaN.

    Parameters
    ----------
    image : (H, W, C)
        0 to 1, of the model's size.
    model : LandmarkModel
    slack : float
        Deviation, pixels, by which the whole face may lie off where it should.
    """
    maps = _maps(image, model)
    found, sure = np.full((len(model.names), 2), np.nan), np.full(len(model.names), -np.inf)
    for k, mean in enumerate(model.mean):
        spread = model.covariance[k] + slack**2 * np.eye(2)
        pixels = _disc(mean, DEVIATIONS * float(np.sqrt(np.linalg.eigvalsh(spread)[-1])))
        scores = describe(maps, pixels, model.cells, model.cell) @ model.filters[k].T
        odds = log_odds(scores.max(1), model.good[k], model.bad[k])
        likely = odds + log_prior(pixels, mean, spread)
        best = _highest(likely, KEPT)
        top = best[likely[best].argmax()]
        sure[k] = odds[top]
        if sure[k] > LEAST:
            weights = np.exp(likely[best] - likely[top])
            found[k] = mean_shift(pixels[best], NARROW, weights)[0][0]
    return found, sure


def detect_paper(image: np.ndarray, model: LandmarkModel, step: int) -> tuple[np.ndarray, np.ndarray]:
    """`detect` in the thesis' way: the prior has its word only about whole clusters.

    Of all scores of a point the 200 highest are kept, those that are rather bad are dropped, the rest is clustered by
    mean shift; the cluster wins that is largest times the prior at its center.

    Parameters
    ----------
    image, model
        As in `detect`.
    step : int
        Look at every such pixel.
    """
    pixels, scores = score_map(image, model, step)
    found, sure = np.full((len(model.names), 2), np.nan), np.full(len(model.names), -np.inf)
    for k in range(len(model.names)):
        flat = scores[:, k].ravel()  # of every place and filter
        best = _highest(flat, KEPT)
        odds = log_odds(flat[best], model.good[k], model.bad[k])
        sure[k] = odds.max()
        if (odds > 0).any():
            centers, sizes = mean_shift(pixels[best[odds > 0] // scores.shape[2]], BANDWIDTH)
            value = np.log(sizes) + log_prior(centers, model.mean[k], model.covariance[k])
            found[k] = centers[value.argmax()]
    return found, sure


def _highest(values: np.ndarray, count: int) -> np.ndarray:
    """Where the `count` highest values (P,) are, in the order of the places: the same on every machine."""
    count = min(count, len(values))
    return np.sort(np.argpartition(-values, count - 1)[:count])


def score_map(image: np.ndarray, model: LandmarkModel, step: int) -> tuple[np.ndarray, np.ndarray]:
    """The places looked at (P, 2), pixels, and their scores (P, L, K)."""
    maps = _maps(image, model)
    y, x = np.mgrid[0 : image.shape[0] : step, 0 : image.shape[1] : step]
    pixels = np.stack([x.ravel(), y.ravel()], 1).astype(np.float64)
    return pixels, scores_at(maps, pixels, model)


def _maps(image: np.ndarray, model: LandmarkModel) -> np.ndarray:
    if image.ndim != 3 or image.shape[2] != model.channels:
        raise InputError(f"The landmark model knows pictures of {model.channels} channels, but this has the shape "
                         f"{image.shape}; train one on such pictures.")  # fmt: skip
    return cell_maps(image, model.cell)


def _disc(middle: np.ndarray, radius: float) -> np.ndarray:
    """Places (P, 2) within a radius of the middle, pixels, not more than about `PLACES`."""
    step = max(1.0, radius * float(np.sqrt(np.pi / PLACES)))
    reach = step * np.arange(-np.floor(radius / step), np.floor(radius / step) + 1)
    x, y = np.meshgrid(reach, reach)
    inside = x**2 + y**2 <= radius**2
    return middle + np.stack([x[inside], y[inside]], 1)


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
