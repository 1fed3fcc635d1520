"""What a solve answers, and the proof that comes with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from blendcap.data.animation import Animation


@dataclass(frozen=True, eq=False)
class Certificate:
    """How far an answer is from the exact optimum.

    Parameters
    ----------
    max_kkt : float
        The largest optimality residual `|a - clip(a - gradient / (2 diag G), lower, upper)|` over frames and weights;
        0 is exact, NaN or infinite is no answer.
    iterations : float
        Rounds of the active-set method: the mean over frames, or Newton steps of a whole-sequence solve.
    converged : bool
        True if every frame ended at its optimum.
    residuals : (T,) float64
        The largest residual of each frame.
    """

    max_kkt: float
    iterations: float
    converged: bool
    residuals: np.ndarray


@dataclass(frozen=True, eq=False)
class Solution:
    """The answer of a marker or video solve.

    Parameters
    ----------
    animation : Animation
    residuals : (T, M) float64
        Distance of each marker from its place on the posed rig, mm; NaN where the marker was missing.
    rms : (T,) float64
        Root of the mean squared residual of each frame, mm.
    energies : {term: (T,) float64}
        What each term of the objective costs, in mm²; `markers` is of markers and tracks together.
    certificate : Certificate
    marker_names : (M,) str
    helmet : (T, 6) float64, optional
        Motion of the helmet against the head: translation, mm, and rotation vector, rad.
    unseen : {shape: float}
        Shapes that these markers cannot see, with the standard error of their weight, where 1 is all of a shape.
    held : (K,) str
        Those of them that were held at rest; the others follow their partner on the other side.
    trusted : {marker: float}
        How much each marker counted: 1, less for one that went astray.
    targets : (T, M, 3) float64, optional
        The markers in the rig's space, rest offset and head motion removed, mm.
    fitted : (T, M, 3) float64, optional
        Their places on the posed rig, mm.
    conflict : (T, N) float64, optional
        How far each weight is from what the curves of the makeup patches say, by their confidence, where 1 is all of a
        shape.
    track_rms : (T,) float64, optional
        Root of the mean squared error of a coordinate that the tracks tell, mm: smaller than a distance, as `rms` is
        of markers; NaN in a frame in which all were lost.
    settings : {str: str}
        What was asked for and what was learned, to be written beside the answer.
    seconds : {step: float}
    """

    animation: Animation
    residuals: np.ndarray
    rms: np.ndarray
    energies: Mapping[str, np.ndarray]
    certificate: Certificate
    marker_names: tuple[str, ...]
    helmet: np.ndarray | None = None
    unseen: Mapping[str, float] = field(default_factory=dict)
    held: tuple[str, ...] = ()
    trusted: Mapping[str, float] = field(default_factory=dict)
    targets: np.ndarray | None = None
    fitted: np.ndarray | None = None
    conflict: np.ndarray | None = None
    track_rms: np.ndarray | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def rms_mm(self) -> float:
        """Root of the mean squared residual over all markers seen in all frames, mm; NaN if none was seen."""
        seen = np.isfinite(self.residuals)
        return float(np.sqrt(np.mean(self.residuals[seen] ** 2))) if seen.any() else float("nan")

    @property
    def track_rms_mm(self) -> float:
        """Root of the mean of `track_rms` squared, mm; NaN if there are no tracks or none was seen."""
        seen = np.empty(0) if self.track_rms is None else self.track_rms[np.isfinite(self.track_rms)]
        return float(np.sqrt(np.mean(seen**2))) if seen.size else float("nan")

    @property
    def marker_rms(self) -> np.ndarray:
        """(M,) root of the mean squared residual of each marker, mm; NaN where it was never seen."""
        seen = np.isfinite(self.residuals).sum(0)
        squared = np.nansum(self.residuals**2, axis=0)
        return np.sqrt(np.divide(squared, seen, out=np.full(len(seen), np.nan), where=seen > 0))
