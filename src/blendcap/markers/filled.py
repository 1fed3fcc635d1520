"""Stretches of a take in which no camera saw a marker and other software filled the gap."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from blendcap.data import MarkerTake
from blendcap.markers.copies import rigid_copies, share_of_rigid_pairs
from blendcap.markers.tremble import AT_REST, LIKELY, SURE, WINDOW, calm_runs, left_by_cubics, quantile, usual_tremble

SELDOM = 0.05  # is a window half calm where something was measured: noise comes and goes less than motion
GRID = 0.05  # of the steps of most markers may be 0, or positions were rounded more coarsely than they tremble
FLICKERS = 2.0  # times as much as others trembles a marker that is measured well where it trembles as they do
LONG = 36  # frames that one cubic explains of a drawn path, but not of one that was smoothed
FEW = 0.01  # of the pairs of markers may keep their distance, or nothing was measured here


@dataclass(frozen=True)
class FilledStretch:
    """Frames in which a marker was filled in.

    Parameters
    ----------
    marker : str
    first, last : int
        Frames, both within the stretch.
    sources : (2,) str, or ()
        The markers that it was moved with, as with a rigid body; none if it is a smooth path.
    """

    marker: str
    first: int
    last: int
    sources: tuple[str, ...] = ()

    def __str__(self) -> str:
        how = f"moved along with {' and '.join(self.sources)}" if self.sources else "a smooth path"
        return f"{self.marker} in frames {self.first} to {self.last} ({how})"


def filled_stretches(take: MarkerTake, longest: float = 0.1) -> tuple[FilledStretch, ...]:
    """Stretches longer than `longest` seconds that other software filled, by marker and frame.

    What is measured trembles. A path that was filled in by a line, a cubic or a spline does not, while most other
    markers do. One that was moved along with three others, as with a rigid body, trembles as they do, but not against
    them (`rigid_copies`). Where nothing trembles, as in simulated takes without noise, nothing is found, nor where
    positions were rounded more coarsely than they tremble; a take that was smoothed as a whole is measured by what it
    still trembles, and a stretch that alone was smoothed is left.

    Parameters
    ----------
    longest : float
        s; shorter bridges are what `fill_gaps` builds as well. Those of less than 12 frames are never found.
    """
    positions = take.positions
    if len(positions) < 2 * WINDOW or np.median(_unmoved(positions)) > GRID:
        return ()
    tremble = usual_tremble(positions)
    level = _levels(positions, tremble)
    if ((level > SURE) & (level < LIKELY)).sum() > SELDOM * np.isfinite(level).sum():
        return ()
    found = [FilledStretch(take.names[m], first, last) for m, first, last in _smooth_paths(positions, tremble, level)]
    positions = _without(take, found)
    if share_of_rigid_pairs(positions, tremble) > FEW:
        return ()
    while more := [
        FilledStretch(take.names[m], first, last, tuple(take.names[k] for k in sources))
        for m, first, last, sources in rigid_copies(positions, tremble)
    ]:  # a copy of a copy hides it until it is gone
        found.extend(more)
        positions = _without(take, found)
    least = np.floor(longest * take.rate + 1e-9)
    return tuple(stretch for stretch in _united(found, take.names) if stretch.last - stretch.first >= least)


def drop_stretches(take: MarkerTake, stretches: Iterable[FilledStretch]) -> MarkerTake:
    """The take with these stretches marked missing, as far as it has their markers."""
    stretches = [stretch for stretch in stretches if stretch.marker in take.names]
    return replace(take, positions=_without(take, stretches)) if stretches else take


def _without(take: MarkerTake, stretches: Iterable[FilledStretch]) -> np.ndarray:
    positions = take.positions.copy()
    for stretch in stretches:
        positions[stretch.first : stretch.last + 1, take.names.index(stretch.marker)] = np.nan
    return positions


def _united(stretches: list[FilledStretch], names: tuple[str, ...]) -> list[FilledStretch]:
    """In the order of markers and frames, with those that overlap or touch made one."""
    united: list[FilledStretch] = []
    for stretch in sorted(stretches, key=lambda s: (names.index(s.marker), s.sources, s.first)):
        before = united[-1] if united else stretch
        alike = (stretch.marker, stretch.sources) == (before.marker, before.sources)
        if united and alike and stretch.first <= before.last + 1:
            united[-1] = replace(before, last=max(before.last, stretch.last))
        else:
            united.append(stretch)
    return sorted(united, key=lambda s: (names.index(s.marker), s.first))


def _unmoved(positions: np.ndarray) -> np.ndarray:
    """(M,) how many steps of each marker's known coordinates are 0."""
    steps = np.diff(positions, axis=0)
    return (steps == 0).sum((0, 2)) / np.maximum(np.isfinite(steps).sum((0, 2)), 1)


def _levels(positions: np.ndarray, tremble: np.ndarray) -> np.ndarray:
    """(T - 11, M) how much each marker trembles in each window, of what it usually does."""
    squared = (np.diff(positions, 4, axis=0) ** 2).mean(2) / 70.0
    level = np.sqrt(sliding_window_view(squared, WINDOW - 4, axis=0).mean(2))
    return np.divide(level, tremble, out=np.full_like(level, np.nan), where=tremble > 0)


def _smooth_paths(positions: np.ndarray, tremble: np.ndarray, level: np.ndarray) -> Iterator[tuple[int, int, int]]:
    """(marker, first frame, last frame) of paths that do not tremble while most markers do."""
    left, others = left_by_cubics(positions), quantile(level.T, AT_REST) > LIKELY
    usual = np.minimum(tremble, FLICKERS * np.median(tremble))
    for m in range(positions.shape[1]):
        for first, last in calm_runs(left[:, m], others * usual[m]):
            path = positions[first : last + 1, m]
            if np.ptp(path, axis=0).max() > LIKELY * tremble[m] and not _was_smoothed(path, usual[m]):  # nor at rest
                yield m, first, last


def _was_smoothed(path: np.ndarray, usual: float) -> bool:
    """Whether a path (T, 3) without a tremble bends more than one that was drawn through a gap: it was measured."""
    return len(path) >= LONG and bool(np.median(left_by_cubics(path, window=LONG)) > LIKELY * usual)
