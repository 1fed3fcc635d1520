"""From a marker take to an animation: the public marker solve."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from blendcap.data import Animation, Binding, InputError, MarkerTake, Rig, Solution
from blendcap.data.names import listed
from blendcap.markers.cleaning import drop_spikes, fill_gaps
from blendcap.markers.filled import FilledStretch, drop_stretches, filled_stretches
from blendcap.markers.helmet import paper_columns, paper_motion, pivot, remove_motion, rigid_columns, rigid_motion
from blendcap.markers.stabilization import stabilize, stabilize_live
from blendcap.solving.answer import Answer
from blendcap.solving.curves import Curves, curves_for
from blendcap.solving.methods import confidence, solve_rows, standard_errors
from blendcap.solving.noise import marker_noise
from blendcap.solving.rows import MarkerRows, marker_rows
from blendcap.solving.settings import SolveSettings
from blendcap.solving.shares import full_weights, in_shares
from blendcap.solving.visibility import UNSEEN

log = logging.getLogger(__name__)

HEAD_MOVES = 3.0  # mm: markers that go farther than this as one body have a head that moves, not a helmet that slips
WARM_UP = 1.0  # seconds in which the live solve measures the noise
NAMED = 12  # stretches that a warning names; the answer's settings name all
NO_NOISE = 0.01  # mm: assumed where a take is too short or too gappy to tell


@dataclass
class _Clock:
    """Seconds by step, and who is told."""

    progress: Callable[[str], None]
    seconds: dict[str, float] = field(default_factory=dict)
    since: float = 0.0
    step: str = ""

    def begin(self, step: str, detail: str = "") -> None:
        self.stop()
        self.step, self.since = step, time.perf_counter()
        self.progress(detail or step)

    def stop(self) -> None:
        if self.step:
            self.seconds[self.step] = self.seconds.get(self.step, 0.0) + time.perf_counter() - self.since
        self.step = ""


def solve(
    rig: Rig,
    take: MarkerTake,
    binding: Binding,
    *,
    patches: Animation | None = None,
    patches_offset: float | None = None,
    settings: SolveSettings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Solution:
    """Weights of the rig's shapes for every frame of a marker take.

    Parameters
    ----------
    rig : Rig
    take : MarkerTake
        Must hold every marker of the binding; others are ignored.
    binding : Binding
        From `bind`.
    patches : Animation, optional
        Curves of weights that makeup patches tell, from `classify`, by shape names; `confidence` is how much they
        count (the hybrid solve: Eq. 4 of the 2016 paper, Eq. 38 of the thesis). 1 is all of a shape, whatever weight
        the rig's upper bound is.
    patches_offset : float, optional
        Seconds by which the patches' video begins after the take; needed only if the two differ in length.
    settings : SolveSettings, optional
        Defaults to what we recommend.
    progress : callable
        Told what begins.

    Returns
    -------
    Solution
        With the certificate of the optimum, the residuals, the helmet's and the head's motion, and the shapes that
        these markers cannot see.

    Raises
    ------
    InputError
        If a bound marker is not in the take or missing in every frame, the rig has no shape that can move, or the
        patches have another length, or speak of a shape that the rig has not.
    """
    settings = settings or SolveSettings()
    _check(rig)
    times = np.arange(len(take.positions)) / take.rate
    full, rig = full_weights(rig), in_shares(rig)
    curves = None if patches is None else curves_for(rig.names, patches, times, patches_offset, rig.name)
    clock = _Clock(progress)
    clock.begin("cleaning")
    cleaned, filled = _cleaned(take, binding, settings)
    clock.begin("head motion")
    surface, deltas = rig.sample(binding.points)
    rest = surface + binding.offsets
    head, still = _without_head(cleaned, rest, binding, settings)
    positions = binding.to_rig(still.positions)
    helmet = _helmet_columns(rest, settings.helmet)
    rows = marker_rows(deltas, helmet, positions - rest, rig.bounds, 0.0 if settings.helmet == "paper" else -1.0)
    known = positions[: math.ceil(WARM_UP * take.rate)] if settings.method == "live" else positions
    noise = _noise(known, settings)
    clock.begin("solving")
    answer = solve_rows(
        rig, rows, take.rate, noise, settings, curves=curves, relinearize=_relinearize(rows, positions, rest, settings),
        progress=lambda detail: clock.begin("solving", f"solving, {detail}"),
    )  # fmt: skip
    clock.stop()
    errors = standard_errors(rig, answer, noise, curves, settings)
    solution = _solution(
        rig, take.rate, binding.points.names, rest, head, answer, errors, curves, settings, clock.seconds
    )
    animation = replace(solution.animation, weights=full * solution.animation.weights)
    made_up = {"filled by other software": "; ".join(map(str, filled))} if filled else {}
    return replace(solution, animation=animation, settings={**solution.settings, **made_up})


def _solution(
    rig: Rig, rate: float, markers: tuple[str, ...], rest: np.ndarray, head: np.ndarray | None, answer: Answer,
    errors: np.ndarray, curves: Curves | None, settings: SolveSettings, seconds: dict[str, float],
) -> Solution:  # fmt: skip
    """All that an answer says, by the names of shapes and markers."""
    rows, unknowns = answer.rows, answer.unknowns
    unseen = {
        name: float(e) for name, e, held in zip(rig.names, errors, answer.held, strict=True) if held or e > UNSEEN
    }
    held = tuple(name for name, still in zip(rig.names, answer.held, strict=True) if still)
    _warn(unseen, held, settings.method)
    weights, motion = unknowns[:, : rows.shapes], _helmet_motion(unknowns[:, rows.shapes :], settings.helmet)
    residuals = rows.errors(unknowns)
    animation = Animation(
        weights, rig.names, rate, head=head, confidence=confidence(errors, rows), meta={"rig": rig.name}
    )
    return Solution(
        animation=animation,
        residuals=residuals,
        rms=_rms(residuals),
        energies=answer.energies,
        certificate=answer.certificate,
        marker_names=markers,
        helmet=motion,
        unseen=unseen,
        held=held,
        trusted=dict(zip(markers, answer.trusted.tolist(), strict=True)),
        targets=rest + np.where(rows.missing[..., None], np.nan, rows.targets) - _helmet_part(rows, unknowns),
        fitted=rest + rows.predict(unknowns) - _helmet_part(rows, unknowns),
        conflict=None if curves is None else curves.conflict(weights),
        settings={**settings.as_text(), "noise (mm)": f"{answer.noise:.3f}"},
        seconds=seconds,
    )


def _check(rig: Rig) -> None:
    if not rig.names:
        raise InputError(f"The rig {rig.name!r} has no shapes, so there is nothing to solve for; read one with shapes.")
    locked = rig.bounds[:, 0] >= rig.bounds[:, 1]
    if locked.any():
        name = rig.names[int(locked.argmax())]
        raise InputError(f"The bounds of the shape {name!r} leave it one value; widen them, or drop it by Rig.select.")


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
    if settings.head == "keep" or len(take.names) < 4:
        return None, take
    if settings.method == "live":
        if not settings.stable:
            if settings.head == "remove":
                raise InputError("The live solve removes head motion by stable markers that you name; name at least 3.")
            return None, take
        head, still = stabilize_live(take, settings.stable, binding.to_take(rest))
    else:
        try:
            head, still = stabilize(
                take, settings.stable or None, rest=binding.to_take(rest), always=settings.head == "remove"
            )
        except InputError as error:
            if settings.head == "remove" or settings.stable:
                raise
            log.info("Head motion, if there is any, stays in the take. %s", error)
            return None, take
    moved = np.linalg.norm(still.positions - take.positions, axis=2)
    if settings.method != "live" and settings.head == "auto" and not np.nanmax(moved, initial=0.0) > HEAD_MOVES:
        return None, take
    to_rig = np.eye(4)
    to_rig[:3, :3], to_rig[:3, 3] = binding.scale * binding.rotation, binding.translation
    return to_rig @ head @ np.linalg.inv(to_rig), still


def _helmet_columns(rest: np.ndarray, kind: str) -> np.ndarray:
    if kind == "none":
        return np.empty((0, *rest.shape))
    return paper_columns(rest) if kind == "paper" else rigid_columns(rest)


def _helmet_motion(unknowns: np.ndarray, kind: str) -> np.ndarray | None:
    if kind == "none":
        return None
    return paper_motion(unknowns) if kind == "paper" else rigid_motion(unknowns)


def _relinearize(
    rows: MarkerRows, positions: np.ndarray, rest: np.ndarray, settings: SolveSettings
) -> Callable[[np.ndarray], np.ndarray] | None:
    """From unknowns (T, N + K) to targets whose helmet rotation is exact: undone as such, put back as columns."""
    if settings.helmet == "none":
        return None

    def targets(unknowns: np.ndarray) -> np.ndarray:
        motion = _helmet_motion(unknowns[:, rows.shapes :], settings.helmet)
        assert motion is not None
        return remove_motion(positions, motion, pivot(rest)) - rest + _helmet_part(rows, unknowns)

    return targets


def _helmet_part(rows: MarkerRows, unknowns: np.ndarray) -> np.ndarray:
    """(T, M, 3) mm: what the helmet's motion, and not the face's, did to the markers."""
    only = unknowns.copy()
    only[:, : rows.shapes] = 0
    return rows.predict(only)


def _noise(positions: np.ndarray, settings: SolveSettings) -> float:
    measured = settings.noise if settings.noise is not None else max(marker_noise(positions), NO_NOISE)
    return float(np.hypot(measured, settings.model_error))


def _warn(unseen: dict[str, float], held: tuple[str, ...], method: str) -> None:
    if not unseen:
        return
    others = [name for name in unseen if name not in held]
    parts = [f"Held at rest: {listed(held)}."] if held else []
    if others:
        how = "A guess" if method == "paper" else "Told only by, or together with, their partner on the other side"
        parts.append(f"{how}: {listed(others)}.")
    log.warning("These markers cannot tell the weights of %d shapes. %s", len(unseen), " ".join(parts))


def _rms(residuals: np.ndarray) -> np.ndarray:
    """(T,) root mean square over the markers seen; NaN in a frame that sees none."""
    seen = np.isfinite(residuals).sum(1)
    squared = np.nansum(residuals**2, axis=1)
    return np.sqrt(np.divide(squared, seen, out=np.full(len(seen), np.nan), where=seen > 0))
