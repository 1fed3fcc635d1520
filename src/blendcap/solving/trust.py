"""How much each marker is to be believed: one that went astray must not drive the face."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blendcap.solving.rows import MarkerRows

ASTRAY = 2.0  # times the error of half of the markers; beyond it a marker counts less and less
BLAMELESS = 0.3  # mm: an error that no marker is blamed for, however good the others are
LEAST_FREEDOM = 0.25  # part of a marker's coordinates that the fit is taken to leave free
STRAY = 3.0  # times the error of half of the tracks' samples; beyond it a sample is left out
HARMLESS = 0.15  # mm: an error for which no sample of a track is left out


def marker_errors(rows: MarkerRows, unknowns: np.ndarray, leverage: np.ndarray) -> np.ndarray:
    """(M,) standard deviation of each marker's coordinates that the answer leaves, mm; NaN if it was never seen.

    Parameters
    ----------
    rows : MarkerRows
    unknowns : (T, N + K)
    leverage : (M,)
        How many of its coordinates the fit swallows; they are put back.
    """
    squared = np.nansum(rows.errors(unknowns) ** 2, axis=0)
    seen = np.count_nonzero(~rows.missing, axis=0)
    free = seen * np.maximum(rows.coordinates - leverage, LEAST_FREEDOM * rows.coordinates)
    return np.sqrt(np.divide(squared, free, out=np.full(len(free), np.nan), where=free > 0))


def trust(errors: np.ndarray) -> np.ndarray:
    """(M,) factors on each marker's part of the equation: 1, but for markers that err far more than most.

    A robust weight of the redescending kind (Holland and Welsch 1977, doi:10.1080/03610927708827533), for whole
    markers: an exchanged label or a marker that slid off errs by many times the others' error for seconds, and what it
    pulls along is wrong in full.

    Parameters
    ----------
    errors : (M,)
        From `marker_errors`, mm.
    """
    known = np.isfinite(errors)
    usual = max(float(np.median(errors[known])), BLAMELESS) if known.any() else BLAMELESS
    blamed = np.where(known, errors, 0.0)
    return np.minimum(1.0, ASTRAY * usual / np.maximum(blamed, 1e-12)) ** 2


def overall(rows: MarkerRows, unknowns: np.ndarray, leverage: np.ndarray, factors: np.ndarray) -> float:
    """Standard deviation of a coordinate, mm, over markers as far as they are trusted."""
    squared = np.nansum((factors * rows.errors(unknowns)) ** 2)
    seen = np.count_nonzero(~rows.missing, axis=0)
    free = max(float(seen @ (rows.coordinates - leverage)), LEAST_FREEDOM * float(seen @ rows.coordinates), 1.0)
    return float(np.sqrt(squared / free))


def without_strays(rows: MarkerRows, unknowns: np.ndarray) -> MarkerRows:
    """The rows without the tracks' samples that err far more than most: what was followed there was something else.

    Markers are told apart by a label and stay; a track that is lost for a while is as good as ever when it is back.
    """
    if not rows.tracks.any():
        return rows
    errors = np.where(rows.tracks, rows.errors(unknowns), np.nan)
    usual = np.nanmedian(errors) if np.isfinite(errors).any() else 0.0
    with np.errstate(invalid="ignore"):
        stray = errors > max(STRAY * usual, HARMLESS)
    missing = rows.missing | stray
    return replace(rows, missing=missing, targets=np.where(missing[..., None], 0.0, rows.targets))
