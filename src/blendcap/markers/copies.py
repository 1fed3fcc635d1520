"""Markers that were moved along with three others, as one rigid body, and thus were not measured.

The rigid-body fill of Vicon Nexus and the relational fill of Qualisys Track Manager: an origin, a marker towards which
the first axis points, and one in the plane of the second; a filled marker goes by a line or a cubic in these axes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from blendcap.markers.tremble import (
    AT_REST,
    LIKELY,
    SURE,
    WINDOW,
    calm_runs,
    left_by_cubics,
    quantile,
    runs,
    usual_tremble,
)

FOLLOWS = 0.1  # of what is left of its own path: what is left of a copy's place among its sources
ONLY = 3.0  # times as much trembles what is not the true origin, the true axis, or the copy itself


def rigid_copies(positions: np.ndarray, tremble: np.ndarray) -> Iterator[tuple[int, int, int, tuple[int, int]]]:
    """(marker, first frame, last frame, (origin, axis)) of markers that were moved along with others.

    Two that were measured tremble against each other: the distance between them does, and so does how far one lies
    from the other along the way to a third. Neither does of a copy, its origin and the marker on its first axis. This
    tells the copy from its origin too, which no third marker explains from the copy's side.

    Parameters
    ----------
    positions : (T, M, 3)
        mm; NaN where missing.
    tremble : (M,)
        From `usual_tremble`.
    """
    for m in range(positions.shape[1]):
        left, usual = _trembling_apart(positions, tremble, m)
        usual = usual * _most_are_apart(left, usual)[:, None]
        for origin in map(int, np.flatnonzero((left < SURE * usual).any(0))):
            cores = [core for core in calm_runs(left[:, origin], usual[:, origin]) if core[1] - core[0] >= 2 * WINDOW]
            axes = [_along_axes(positions[first : last + 1], m, origin) for first, last in cores]
            limit = LIKELY * min(tremble[m], tremble[origin])
            if not axes or min(values.min() for values in axes) > limit:
                continue
            axis = int(min(axes, key=np.min).argmin())
            for first, last in _whole(positions, m, origin, axis, cores, limit):
                if _is_the_copy(positions[first : last + 1], m, origin):
                    yield m, first, last, (origin, axis)


def share_of_rigid_pairs(positions: np.ndarray, tremble: np.ndarray) -> float:
    """How many pairs of markers keep their distance, of every sixth window: few, or nothing was measured."""
    calm = known = 0
    for m in range(1, positions.shape[1]):
        left, usual = _trembling_apart(positions[:, : m + 1], tremble[: m + 1], m, WINDOW // 2)
        calm += np.count_nonzero(left < LIKELY * usual)
        known += np.count_nonzero(np.isfinite(left))
    return calm / max(known, 1)


def _trembling_apart(
    positions: np.ndarray, tremble: np.ndarray, m: int, step: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """What cubics leave of the distances from m to all markers, (windows, M) mm, and how much they usually tremble."""
    distances = _distances(positions, m)[..., None]
    left = left_by_cubics(distances, step)
    left[:, m] = np.nan
    apart = usual_tremble(distances, 0.75)  # the copy may be half of the take
    return left, np.minimum(np.minimum(tremble, tremble[m]), apart)


def _most_are_apart(left: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """(windows,) bool: where the distances from a marker to most others tremble."""
    relative = np.divide(left, usual, out=np.full_like(left, np.nan), where=usual > 0)
    return quantile(relative.T, AT_REST) > LIKELY


def _distances(positions: np.ndarray, m: int) -> np.ndarray:
    arms = positions - positions[:, [m]]
    return np.sqrt(np.einsum("tkd,tkd->tk", arms, arms))


def _along(positions: np.ndarray, m: int, origin: int) -> np.ndarray:
    """(T, M) how far m lies from the origin on the way to each marker, mm."""
    arms = positions - positions[:, [origin]]
    lengths = np.linalg.norm(arms, axis=2)
    dots = np.einsum("tkd,td->tk", arms, arms[:, m])
    return np.divide(dots, lengths, out=np.full_like(dots, np.nan), where=lengths > 0)


def _along_axes(positions: np.ndarray, m: int, origin: int) -> np.ndarray:
    """(M,) how much `_along` trembles, mm; infinite where there is no axis."""
    values = _over_all(_along(positions, m, origin))
    values[[m, origin]] = np.inf
    return values


def _over_all(coordinates: np.ndarray) -> np.ndarray:
    """(K,) median of what cubics leave of the windows of (T, K), mm; infinite where one is not known."""
    return np.nan_to_num(np.median(left_by_cubics(coordinates[..., None]), axis=0), nan=np.inf)


def _is_the_copy(positions: np.ndarray, m: int, origin: int) -> bool:
    """Whether m goes with one origin and one axis only, and the origin not with m.

    Markers on the skull go with each other whichever is asked.
    """
    distances = _over_all(_distances(positions, m))
    distances[m] = np.inf
    nearest, next_nearest = np.sort(distances)[:2]
    axis, next_axis = np.sort(_along_axes(positions, m, origin))[:2]
    back = _along_axes(positions, origin, m).min()
    return bool(next_nearest > ONLY * nearest and min(next_axis, back) > ONLY * axis)


def _whole(
    positions: np.ndarray, m: int, origin: int, axis: int, cores: list[tuple[int, int]], limit: float
) -> list[tuple[int, int]]:
    """The stretches (first, last) around and between cores in which m goes with its origin and axis.

    A take that was smoothed after it was filled keeps a trace of its motion in them, the more the faster it is.
    """
    distances = _distances(positions, m)
    place = np.stack([distances[:, origin], _along(positions, m, origin)[:, axis]], 1)
    others = np.delete(distances, m, axis=1)
    moving = quantile(left_by_cubics(others[..., None]).T, 0.5)
    whole: list[tuple[int, int]] = []
    for first, last in runs(left_by_cubics(place) < np.maximum(limit, FOLLOWS * moving)):
        if whole and _goes_along(place[whole[-1][0] : last + 1], others[whole[-1][0] : last + 1]):
            whole[-1] = (whole[-1][0], last)
        else:
            whole.append((first, last))
    return [(first, last) for first, last in whole if any(first <= end and begin <= last for begin, end in cores)]


def _goes_along(place: np.ndarray, others: np.ndarray) -> bool:
    """Whether one cubic explains the place (T, 2) among the sources from beginning to end, but not most others (T, K).

    All are distances between markers: a head that moves as a whole proves nothing.
    """
    basis = np.linalg.qr(np.vander(np.linspace(-1, 1, len(place)), 4))[0]
    of_place, of_others = (np.sqrt(((q - basis @ (basis.T @ q)) ** 2).mean(0)) for q in (place, others))
    return bool(of_place.max() < FOLLOWS * quantile(of_others[:, None], 0.5)[0])
