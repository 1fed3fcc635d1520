"""Similarity transforms between point sets whose pairs are known: least squares, weighted and robust."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from blendcap.data import InputError

_ROUNDS = 30  # of reweighting; the robust fit settles well before


def align(
    source: np.ndarray, target: np.ndarray, scale: bool = True, *, weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least-squares similarity `target = scale * rotation @ source + translation`.

    The closed form of Umeyama (1991), "Least-squares estimation of transformation parameters between two point
    patterns", IEEE PAMI 13(4), Eqs. 39-42, doi:10.1109/34.88573, with a weight for each pair. The rotation never
    mirrors: its determinant is +1. Leading axes are batches, fitted independently.

    Parameters
    ----------
    source, target : (..., M, 3) float64
        Pairs of points; leading axes broadcast. A pair with a NaN is left out.
    scale : bool
        Fit the scale too; otherwise it is 1.
    weights : (..., M) float64, optional
        Not negative; 1 if not given.

    Returns
    -------
    rotation : (..., 3, 3) float64
    translation : (..., 3) float64
    scale : (...) float64

    Raises
    ------
    InputError
        If fewer than three pairs are complete, or they lie on a line, which leaves the rotation open.
    """
    source, target, weights = _pairs(source, target, weights)
    rotation, translation, size, shape = _umeyama(source, target, weights, scale)
    counted = (weights > 0).sum(-1)
    if (counted < 3).any():
        raise InputError(f"Alignment needs at least three points that both sides have, but has {int(counted.min())}.")
    if (shape[..., 1] <= 1e-9 * shape[..., 0]).any():
        raise InputError("The points to align lie on one line, which leaves the rotation open; add a point beside it.")
    return rotation, translation, size


def align_robust(
    source: np.ndarray,
    target: np.ndarray,
    scale: bool = True,
    *,
    floor: float = 0.05,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`align` that a minority of wrong pairs cannot pull away.

    Iteratively reweighted least squares from the plain fit: each pair counts `1 / (1 + (r / s)²)²` (Geman and McClure)
    at residual r, with s falling from the largest residual to 1.5 times the median one, so that the answer depends
    little on the start.

    Parameters
    ----------
    source, target, scale
        As in `align`.
    floor : float
        The smallest s, mm: residuals well below it are all treated as exact.

    Returns
    -------
    rotation, translation, scale
        As in `align`.
    """
    source, target, weights = _pairs(source, target, None)
    fit = align(source, target, scale, weights=weights)
    seen = weights > 0
    width = np.max(np.where(seen, _residuals(source, target, *fit), 0.0), axis=-1)
    for _ in range(_ROUNDS):
        residuals = _residuals(source, target, *fit)
        typical = 1.5 * _masked_median(residuals, seen)
        width = np.maximum(np.maximum(0.6 * width, typical), floor)
        trust = (1.0 + (residuals / width[..., None]) ** 2) ** -2
        rotation, translation, size, _ = _umeyama(source, target, weights * trust, scale)
        fit = (rotation, translation, size)
    return fit


def apply(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray, scale: ArrayLike = 1.0) -> np.ndarray:
    """Points (..., M, 3) moved by similarities (..., 3, 3), (..., 3), (...): `scale * rotation @ p + translation`."""
    moved = np.asarray(points) @ np.swapaxes(rotation, -1, -2)
    return np.asarray(scale)[..., None, None] * moved + np.asarray(translation)[..., None, :]


def _pairs(source, target, weights) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both sides with incomplete pairs at zero weight and the origin."""
    source, target = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if source.shape[-1:] != (3,) or target.shape[-1:] != (3,) or source.shape[-2:] != target.shape[-2:]:
        raise InputError(
            f"Alignment needs two equally long lists of points, but has {source.shape} and {target.shape}."
        )
    source, target = np.broadcast_arrays(source, target)
    weights = np.broadcast_to(1.0 if weights is None else np.asarray(weights, dtype=np.float64), source.shape[:-1])
    whole = np.isfinite(source).all(-1) & np.isfinite(target).all(-1)
    hole = np.expand_dims(~whole, -1)
    return np.where(hole, 0.0, source), np.where(hole, 0.0, target), np.where(whole, weights, 0.0)


def _umeyama(source, target, weights, scale: bool):
    """The closed form, and the singular values of the source's spread, which tell points on a line."""
    share = (weights / np.maximum(weights.sum(-1, keepdims=True), 1e-300))[..., None]
    mean_source, mean_target = (share * source).sum(-2), (share * target).sum(-2)
    from_mean, to_mean = source - mean_source[..., None, :], target - mean_target[..., None, :]
    left, singular, right = np.linalg.svd(np.swapaxes(to_mean * share, -1, -2) @ from_mean)
    sign = np.ones_like(singular)
    sign[..., 2] = np.where(np.linalg.det(left) * np.linalg.det(right) < 0, -1.0, 1.0)  # no mirror image
    rotation = (left * sign[..., None, :]) @ right
    spread = (share * from_mean**2).sum((-1, -2))
    fitted = (singular * sign).sum(-1) / np.maximum(spread, 1e-300)
    size = fitted if scale else np.ones_like(fitted)
    translation = mean_target - size[..., None] * (rotation @ mean_source[..., None])[..., 0]
    return rotation, translation, size, singular


def _residuals(source, target, rotation, translation, scale) -> np.ndarray:
    return np.linalg.norm(apply(source, rotation, translation, scale) - target, axis=-1)


def _masked_median(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Median along the last axis of the entries under `mask`; every row has at least one."""
    ordered = np.sort(np.where(mask, values, np.inf), axis=-1)
    count = mask.sum(-1)
    low, high = (count - 1) // 2, count // 2
    take = np.take_along_axis
    return 0.5 * (take(ordered, low[..., None], -1) + take(ordered, high[..., None], -1))[..., 0]
