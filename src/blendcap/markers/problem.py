"""A marker take laid against a rig: cleaned, without the motion of its head, and written as rows."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from blendcap.data import Binding, InputError, MarkerTake, PaintTracks, Rig
from blendcap.data.names import listed
from blendcap.markers.cleaning import drop_spikes, fill_gaps
from blendcap.markers.filled import FilledStretch, drop_stretches, filled_stretches
from blendcap.markers.helmet import paper_columns, pivot, rigid_columns
from blendcap.markers.stabilization import stabilize, stabilize_live
from blendcap.markers.track_rows import check_tracks, track_rows
from blendcap.solving.noise import marker_noise
from blendcap.solving.rows import MarkerRows, marker_rows
from blendcap.solving.settings import SolveSettings

log = logging.getLogger(__name__)

HEAD_MOVES = 3.0  # mm: markers that go farther than this as one body have a head that moves, not a helmet that slips
FEWEST = 4  # markers that tell the motion of a head
WARM_UP = 1.0  # seconds in which the live solve measures the noise
NAMED = 12  # stretches that a warning names; the answer's settings name all
NO_NOISE = 0.01  # mm: assumed where a take is too short or too gappy to tell


@dataclass(frozen=True, eq=False)
class MarkerProblem:
    """What is to be solved.

    Parameters
    ----------
    rig : Rig
        Its weights are shares of a full shape (`in_shares`).
    rate : float
        Frames a second.
    markers : (M,) str
    rest : (M + K, 3)
        The markers, and after them the tracks, on the neutral, mm, in the rig's space.
    positions : (T, M + K, 3)
        The same without the motion of the head; NaN where missing.
    rows : MarkerRows
    noise : float
        Standard deviation of a marker coordinate, model error included, mm.
    head : (T, 4, 4), optional
        The motion that was taken out, in the rig's space.
    filled : tuple of FilledStretch
        What other software made up, and counts as missing.
    """

    rig: Rig
    rate: float
    markers: tuple[str, ...]
    rest: np.ndarray
    positions: np.ndarray
    rows: MarkerRows
    noise: float
    head: np.ndarray | None
    filled: tuple[FilledStretch, ...]

    @property
    def center(self) -> np.ndarray:
        """(3,) what the helmet turns about, mm."""
        return pivot(self.rest[: len(self.markers)])


def marker_problem(
    rig: Rig, take: MarkerTake, binding: Binding, settings: SolveSettings, progress: Callable[[str], None],
    tracks: PaintTracks | None = None,
) -> MarkerProblem:  # fmt: skip
    """Rows and noise of a take; `rig` counts weights as shares, `progress` is told what begins.

    Raises
    ------
    InputError
        If a bound marker is not in the take or missing in every frame, or the tracks are not of this take and rig.
    """
    if tracks is not None:
        check_tracks(tracks, rig, take, binding, settings.head)
        settings = replace(settings, head="keep")  # the cameras ride on the helmet, and the tracks with them
    progress("cleaning")
    cleaned, filled = _cleaned(take, binding, settings)
    progress("head motion")
    surface, deltas = rig.sample(binding.points)
    rest = surface + binding.offsets
    head, still = _without_head(cleaned, rest, binding, settings)
    positions, axes = binding.to_rig(still.positions), None
    noise = _noise(_known(positions, take.rate, settings), settings)
    center = pivot(rest)
    if tracks is not None:
        ours = track_rows(tracks, rig, binding)
        deltas = np.concatenate([deltas, ours.deltas], axis=1)
        rest, positions = np.concatenate([rest, ours.rest]), np.concatenate([positions, ours.positions], axis=1)
        axes = np.concatenate([np.tile(np.eye(3), (len(binding.points.names), 1, 1)), ours.axes])
    helmet = _helmet_columns(rest, center, settings.helmet)
    lowest = 0.0 if settings.helmet == "paper" else -1.0
    rows = marker_rows(deltas, helmet, positions - rest, rig.bounds, lowest, axes)
    return MarkerProblem(rig, take.rate, binding.points.names, rest, positions, rows, noise, head, filled)


def _cleaned(
    take: MarkerTake, binding: Binding, settings: SolveSettings
) -> tuple[MarkerTake, tuple[FilledStretch, ...]]:
    """The bound markers as far as they were measured, and the stretches in which they were not."""
    lacking = [name for name in binding.points.names if name not in take.names]
    if lacking:
        raise InputError(
            f"The take has no marker {lacking[0]!r}, which the binding uses; bind again without it or rename it."
        )
    part = take.select(binding.points.names)
    lost = part.missing.all(0)
    if lost.any():
        name = part.names[int(lost.argmax())]
        raise InputError(f"The marker {name!r} is missing in every frame; leave it out of the correspondences.")
    if settings.method == "live":
        return part, ()  # to bridge a gap, or to tell a spike or a bridge, takes the frames after it
    filled = filled_stretches(take, settings.longest_gap)  # markers that are not bound may be their sources
    filled = tuple(stretch for stretch in filled if stretch.marker in part.names)
    if filled:
        log.warning(
            "Other software filled gaps; what it made up counts as missing (as in all gaps longer than longest_gap): "
            "%s.",
            listed([str(stretch) for stretch in filled], NAMED),
        )
    return fill_gaps(drop_spikes(drop_stretches(part, filled)), settings.longest_gap), filled


def _without_head(
    take: MarkerTake, rest: np.ndarray, binding: Binding, settings: SolveSettings
) -> tuple[np.ndarray | None, MarkerTake]:
    """Head motion (T, 4, 4) in the rig's space, or None, and the take without it."""
    keeps = settings.head == "keep" or len(take.names) < FEWEST
    found = None if keeps else _stabilized(take, binding.to_take(rest), settings)
    if found is None:
        return None, take
    to_rig = np.eye(4)
    to_rig[:3, :3], to_rig[:3, 3] = binding.scale * binding.rotation, binding.translation
    return to_rig @ found[0] @ np.linalg.inv(to_rig), found[1]


def _stabilized(take: MarkerTake, rest: np.ndarray, settings: SolveSettings) -> tuple[np.ndarray, MarkerTake] | None:
    """Head motion (T, 4, 4) in the take's space and the take without it; None if it is not known, or hardly any."""
    if settings.method == "live":
        if not settings.stable and settings.head == "remove":
            raise InputError("The live solve removes head motion by stable markers that you name; name at least 3.")
        return stabilize_live(take, settings.stable, rest) if settings.stable else None
    always = settings.head == "remove"
    try:
        head, still = stabilize(take, settings.stable or None, rest=rest, always=always)
    except InputError as error:
        if always or settings.stable:
            raise
        log.info("Head motion, if there is any, stays in the take. %s", error)
        return None
    moved = np.linalg.norm(still.positions - take.positions, axis=2)
    return (head, still) if always or np.nanmax(moved, initial=0.0) > HEAD_MOVES else None


def _helmet_columns(rest: np.ndarray, center: np.ndarray, kind: str) -> np.ndarray:
    if kind == "none":
        return np.empty((0, *rest.shape))
    return paper_columns(rest, center) if kind == "paper" else rigid_columns(rest, center=center)


def _known(positions: np.ndarray, rate: float, settings: SolveSettings) -> np.ndarray:
    """The frames (F, M, 3) that tell the noise: the live solve knows only the first."""
    return positions[: math.ceil(WARM_UP * rate)] if settings.method == "live" else positions


def _noise(positions: np.ndarray, settings: SolveSettings) -> float:
    measured = settings.noise if settings.noise is not None else max(marker_noise(positions), NO_NOISE)
    return float(np.hypot(measured, settings.model_error))
