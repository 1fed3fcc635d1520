"""What was captured: markers in space, landmarks in pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import checks
from blendcap.data.errors import InputError


@dataclass(frozen=True, eq=False)
class MarkerTake:
    """Positions of named markers over time.

    Parameters
    ----------
    positions : (T, M, 3) float64
        mm; NaN where a marker was not seen.
    names : (M,) str
        One name a marker, each used once.
    rate : float
        Frames a second.
    residuals : (T, M) float64, optional
        The capture system's own residual, mm; NaN where unknown.
    timecode : str, optional
        SMPTE timecode of the first frame, as the file gave it.

    Raises
    ------
    InputError
        If the lengths differ, there is no frame, a position is infinite or the rate is not positive.
    """

    positions: np.ndarray
    names: tuple[str, ...]
    rate: float
    residuals: np.ndarray | None = None
    timecode: str | None = None

    def __post_init__(self):
        put = object.__setattr__
        put(self, "names", checks.names(self.names, "The take's marker names"))
        put(self, "rate", checks.rate(self.rate, "The take's rate"))
        shape = (checks.ANY, len(self.names), 3)
        positions = checks.array(self.positions, shape, "The take's positions")
        if len(positions) == 0 or len(self.names) == 0:
            raise InputError("The take is empty: it needs at least one frame and one marker.")
        if np.isinf(positions).any():
            frame, marker, _ = np.argwhere(np.isinf(positions))[0]
            raise InputError(
                f"Marker {self.names[marker]!r} is at infinity in frame {frame}; mark a missing marker with NaN."
            )
        gaps = np.isnan(positions)
        partly = np.any(gaps, axis=2) & ~np.all(gaps, axis=2)
        if np.any(partly):  # a marker is seen or it is not
            positions = np.where(np.expand_dims(partly, 2), np.nan, positions)
            positions.flags.writeable = False
        put(self, "positions", positions)
        if self.residuals is not None:
            put(self, "residuals", checks.array(self.residuals, positions.shape[:2], "The take's residuals"))

    @property
    def missing(self) -> np.ndarray:
        """(T, M) bool: where a marker was not seen."""
        return np.isnan(self.positions[..., 0])

    def select(self, names) -> MarkerTake:
        """The take with only these markers, in this order.

        Raises
        ------
        InputError
            If it lacks one.
        """
        place = {name: i for i, name in enumerate(self.names)}
        unknown = [n for n in names if n not in place]
        if unknown:
            raise InputError(f"The take has no marker named {unknown[0]!r}; it has {', '.join(self.names[:8])} ...")
        rows = [place[n] for n in names]
        residuals = None if self.residuals is None else self.residuals[:, rows]
        return MarkerTake(self.positions[:, rows], tuple(names), self.rate, residuals, self.timecode)


@dataclass(frozen=True, eq=False)
class LandmarkTake:
    """Positions of named landmarks in the pictures of one camera.

    Parameters
    ----------
    points : (T, L, 2) float64
        Pixels, origin at the top left corner of the picture; NaN where not found.
    names : (L,) str
    rate : float
        Frames a second.
    confidence : (T, L) float64, optional
        0 to 1.
    size : (width, height), optional
        Of the picture, pixels.

    Raises
    ------
    InputError
        If the lengths differ or the rate is not positive.
    """

    points: np.ndarray
    names: tuple[str, ...]
    rate: float
    confidence: np.ndarray | None = None
    size: tuple[int, int] | None = None

    def __post_init__(self):
        put = object.__setattr__
        put(self, "names", checks.names(self.names, "The take's landmark names"))
        put(self, "rate", checks.rate(self.rate, "The take's rate"))
        put(self, "points", checks.array(self.points, (checks.ANY, len(self.names), 2), "The take's points"))
        if self.confidence is not None:
            shape = self.points.shape[:2]
            put(self, "confidence", checks.array(self.confidence, shape, "The take's confidence"))
