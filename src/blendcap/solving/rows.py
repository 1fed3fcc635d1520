"""Markers as rows of the one equation `y_t = H a_t + noise`.

The unknowns of a frame are the weights of the N shapes, followed by the K unknowns of the helmet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class MarkerRows:
    """The data term of a take: `sum over seen markers of |targets - rows a|²`, mm².

    Parameters
    ----------
    rows : (M, 3, N + K)
        How each marker moves with each unknown, mm.
    targets : (T, M, 3)
        Displacement of each marker from its rest, mm; 0 where missing.
    missing : (T, M) bool
    shapes : int
        N; the unknowns after it belong to the helmet.
    lower, upper : (N + K,)
        Bounds of the unknowns.
    axes : (M, 3, 3), optional
        The directions along which each tells its place, by how much each counts; the unit matrix if not given. One that
        is 0 makes it a track: a point that one camera follows. Rows and targets are along them.
    """

    rows: np.ndarray
    targets: np.ndarray
    missing: np.ndarray
    shapes: int
    lower: np.ndarray
    upper: np.ndarray
    axes: np.ndarray | None = None

    @property
    def coordinates(self) -> np.ndarray:
        """(M,) how many coordinates each marker tells: 3, and of a track as many as its axes are sure."""
        return np.full(len(self.rows), 3.0) if self.axes is None else (self.axes**2).sum((1, 2))

    @property
    def tracks(self) -> np.ndarray:
        """(M,) bool: which of them are no markers, but tracks."""
        return np.zeros(len(self.rows), dtype=bool) if self.axes is None else ~np.all(np.any(self.axes, axis=2), axis=1)

    @property
    def markers(self) -> MarkerRows:
        """The markers alone, which come before the tracks."""
        kept = ~self.tracks
        return replace(
            self, rows=self.rows[kept], targets=self.targets[:, kept], missing=self.missing[:, kept], axes=None
        )

    def along(self, displacements: np.ndarray) -> np.ndarray:
        """Displacements (T, M, 3), mm, along the axes of each marker."""
        return displacements if self.axes is None else _along(self.axes, displacements)

    @property
    def gram(self) -> np.ndarray:
        """(N + K, N + K) `H'H` with every marker seen, mm²."""
        flat = self.rows.reshape(-1, self.rows.shape[2])
        return flat.T @ flat

    @property
    def mean_gram(self) -> np.ndarray:
        """(N + K, N + K) `H'H` averaged over the take: each marker counts as often as it was seen, mm²."""
        seen = np.sqrt(1 - self.missing.mean(0))
        flat = (self.rows * seen[:, None, None]).reshape(-1, self.rows.shape[2])
        return flat.T @ flat

    @property
    def linear(self) -> np.ndarray:
        """(T, N + K) `-H'y`, mm²; missing markers give nothing."""
        return -self.targets.reshape(len(self.targets), -1) @ self.rows.reshape(-1, self.rows.shape[2])

    def with_shapes(self, deltas: np.ndarray) -> MarkerRows:
        """The same markers on other shapes: what each does to each marker (M, N, 3), mm at weight 1."""
        columns = deltas.transpose(0, 2, 1)
        columns = columns if self.axes is None else self.axes @ columns
        return replace(self, rows=np.concatenate([columns, self.rows[..., self.shapes :]], axis=2))

    def helmet_part(self, unknowns: np.ndarray) -> np.ndarray:
        """Displacements (T, M, 3) that the helmet's part of unknowns (T, N + K) explains, mm."""
        only = unknowns.copy()
        only[:, : self.shapes] = 0
        return self.predict(only)

    def with_targets(self, targets: np.ndarray) -> MarkerRows:
        """The same rows for other targets (T, M, 3), mm."""
        return replace(self, targets=np.where(self.missing[..., None], 0.0, targets))

    def weighed(self, factors: np.ndarray) -> MarkerRows:
        """The same equation with each marker's part of it multiplied by a factor (M,)."""
        return replace(self, rows=self.rows * factors[:, None, None], targets=self.targets * factors[:, None])

    def predict(self, unknowns: np.ndarray) -> np.ndarray:
        """Displacements (T, M, 3) that unknowns (T, N + K) explain, mm."""
        flat = self.rows.reshape(-1, self.rows.shape[2])
        return (unknowns @ flat.T).reshape(-1, *self.rows.shape[:2])

    def errors(self, unknowns: np.ndarray) -> np.ndarray:
        """(T, M) distance of each marker from where the unknowns put it, mm; NaN where missing."""
        distance = np.linalg.norm(self.targets - self.predict(unknowns), axis=2)
        return np.where(self.missing, np.nan, distance)


def marker_rows(
    deltas: np.ndarray, helmet: np.ndarray, displacements: np.ndarray, bounds: np.ndarray, helmet_lower: float,
    axes: np.ndarray | None = None,
) -> MarkerRows:  # fmt: skip
    """Rows of a take.

    Parameters
    ----------
    deltas : (N, M, 3)
        What each shape does to each marker at weight 1, mm.
    helmet : (K, M, 3)
        What each unknown of the helmet does to each marker at 1, mm.
    displacements : (T, M, 3)
        Markers minus their rest, mm; NaN where missing.
    bounds : (N, 2)
        Of the shapes' weights.
    helmet_lower : float
        Lowest value of the helmet's unknowns: -1 (signed) or 0 (the thesis' pairs). The highest is 1.
    axes : (M, 3, 3), optional
        The directions along which each marker tells its place, by how much each counts: the unit matrix if not given.
    """
    columns = np.concatenate([deltas, helmet]) if len(helmet) else deltas
    missing = np.isnan(displacements[..., 0])
    extra = len(helmet)
    rows = columns.transpose(1, 2, 0)
    if axes is not None:
        rows, displacements = axes @ rows, _along(axes, displacements)
    return MarkerRows(
        rows=np.ascontiguousarray(rows),
        targets=np.where(missing[..., None], 0.0, displacements),
        missing=missing,
        shapes=len(deltas),
        lower=np.r_[bounds[:, 0], np.full(extra, helmet_lower)],
        upper=np.r_[bounds[:, 1], np.ones(extra)],
        axes=axes,
    )


def _along(axes: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    return np.einsum("mij,tmj->tmi", axes, displacements, optimize=True)
