"""From a marker take to an animation: the public marker solve."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from blendcap.data import Animation, Binding, InputError, MarkerTake, PaintTracks, Rig, Solution
from blendcap.data.names import listed
from blendcap.markers.agreement import check_agreement
from blendcap.markers.helmet import paper_motion, remove_motion, rigid_motion
from blendcap.markers.problem import MarkerProblem, marker_problem
from blendcap.solving.answer import Answer
from blendcap.solving.curves import Curves, curves_for
from blendcap.solving.methods import confidence, solve_rows, standard_errors
from blendcap.solving.rows import MarkerRows
from blendcap.solving.settings import SolveSettings
from blendcap.solving.shares import full_weights, in_shares
from blendcap.solving.visibility import UNSEEN

log = logging.getLogger(__name__)


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
    tracks: PaintTracks | None = None,
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
    tracks : PaintTracks, optional
        Skin between the markers that head cameras followed, from `track_paint`: each a row of the same equation.
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
        If a bound marker is not in the take or missing in every frame, the rig has no shape that can move, the
        patches have another length, or speak of a shape that the rig has not, or the tracks are not of this take and
        rig.
    """
    check_rig(rig)
    settings, clock = settings or SolveSettings(), _Clock(progress)
    curves = curves_of_take(rig, take, patches, patches_offset)
    problem = problem_of(rig, take, binding, tracks, settings, clock.begin)
    answer = answered(problem, curves, settings, clock.begin)
    clock.stop()
    return as_solution(problem, answer, full_weights(rig), curves, settings, clock.seconds)


def curves_of_take(rig: Rig, take: MarkerTake, patches: Animation | None, offset: float | None) -> Curves | None:
    """The patches' curves, frame by frame of the take; None if there are none."""
    times = np.arange(len(take.positions)) / take.rate
    return None if patches is None else curves_for(rig.names, patches, times, offset, rig.name)


def problem_of(
    rig: Rig, take: MarkerTake, binding: Binding, tracks: PaintTracks | None, settings: SolveSettings,
    begin: Callable[..., None],
) -> MarkerProblem:  # fmt: skip
    """The take as rows, with tracks that agree with its markers; `begin` is told the step that begins."""
    problem = marker_problem(in_shares(rig), take, binding, settings, begin, tracks)
    if tracks is not None:
        check_agreement(problem.rows, take.rate)
    return problem


def answered(
    problem: MarkerProblem, curves: Curves | None, settings: SolveSettings, begin: Callable[..., None]
) -> Answer:
    """The problem's solution; `begin` is told the step that begins and, perhaps, its detail."""
    begin("solving")
    return solve_rows(
        problem.rig, problem.rows, problem.rate, problem.noise, settings, curves=curves,
        relinearize=_relinearize(problem, settings.helmet),
        progress=lambda detail: begin("solving", f"solving, {detail}"),
    )  # fmt: skip


def as_solution(
    problem: MarkerProblem, answer: Answer, full: np.ndarray, curves: Curves | None, settings: SolveSettings,
    seconds: dict[str, float],
) -> Solution:  # fmt: skip
    """All that an answer says, by the names of shapes and markers; the weights as the caller's rig counts them."""
    rig, count, rows, unknowns = problem.rig, len(problem.markers), answer.rows.markers, answer.unknowns
    rest = problem.rest[:count]
    errors = standard_errors(rig, answer, problem.noise, curves, settings)
    unseen = {
        name: float(e) for name, e, held in zip(rig.names, errors, answer.held, strict=True) if held or e > UNSEEN
    }
    held = tuple(name for name, still in zip(rig.names, answer.held, strict=True) if still)
    _warn(unseen, held, settings.method)
    shares, helmet = unknowns[:, : rows.shapes], rows.helmet_part(unknowns)
    residuals = rows.errors(unknowns)
    sure = confidence(errors, answer.rows)
    asked = settings.as_text() | {"noise (mm)": f"{answer.noise:.3f}"}
    if problem.filled:
        asked["filled by other software"] = "; ".join(map(str, problem.filled))
    if answer.rows.tracks.any():
        asked["tracks"] = _tracks_in_words(problem.rows, answer.rows)
    return Solution(
        animation=Animation(
            full * shares, rig.names, problem.rate, head=problem.head, confidence=sure, meta={"rig": rig.name}
        ),
        residuals=residuals,
        rms=_rms(residuals),
        energies=answer.energies,
        certificate=answer.certificate,
        marker_names=problem.markers,
        helmet=_helmet_motion(unknowns[:, rows.shapes :], settings.helmet),
        unseen=unseen,
        held=held,
        trusted=dict(zip(problem.markers, answer.trusted[:count].tolist(), strict=True)),
        targets=rest + np.where(rows.missing[..., None], np.nan, rows.targets) - helmet,
        fitted=rest + rows.predict(unknowns) - helmet,
        conflict=None if curves is None else curves.conflict(shares),
        track_rms=_track_rms(answer),
        settings=asked,
        seconds=seconds,
    )


def check_rig(rig: Rig) -> None:
    """Refuse a rig in which nothing can move."""
    if not rig.names:
        raise InputError(f"The rig {rig.name!r} has no shapes, so there is nothing to solve for; read one with shapes.")
    locked = rig.bounds[:, 0] >= rig.bounds[:, 1]
    if locked.any():
        name = rig.names[int(locked.argmax())]
        raise InputError(f"The bounds of the shape {name!r} leave it one value; widen them, or drop it by Rig.select.")


def _helmet_motion(unknowns: np.ndarray, kind: str) -> np.ndarray | None:
    if kind == "none":
        return None
    return paper_motion(unknowns) if kind == "paper" else rigid_motion(unknowns)


def _relinearize(problem: MarkerProblem, helmet: str) -> Callable[[np.ndarray], np.ndarray] | None:
    """From unknowns (T, N + K) to targets whose helmet rotation is exact: undone as such, put back as columns."""
    if helmet == "none":
        return None
    positions, rest, rows = problem.positions, problem.rest, problem.rows

    def targets(unknowns: np.ndarray) -> np.ndarray:
        motion = _helmet_motion(unknowns[:, rows.shapes :], helmet)
        assert motion is not None
        still = remove_motion(positions, motion, problem.center) - rest
        return rows.along(still) + rows.helmet_part(unknowns)

    return targets


def _warn(unseen: dict[str, float], held: tuple[str, ...], method: str) -> None:
    if not unseen:
        return
    others = [name for name in unseen if name not in held]
    parts = [f"Held at rest: {listed(held)}."] if held else []
    if others:
        how = "A guess" if method == "paper" else "Told only by, or together with, their partner on the other side"
        parts.append(f"{how}: {listed(others)}.")
    log.warning("These markers cannot tell the weights of %d shapes. %s", len(unseen), " ".join(parts))


def _tracks_in_words(before: MarkerRows, after: MarkerRows) -> str:
    """How many tracks there are, what part of their samples was lost, and what part was left out as astray."""
    lost, left = before.missing[:, before.tracks].mean(), after.missing[:, after.tracks].mean()
    return f"{np.count_nonzero(after.tracks)}, of their samples {lost:.1%} lost, {left - lost:.1%} astray"


def _track_rms(answer: Answer) -> np.ndarray | None:
    """(T,) of the tracks that count, mm a coordinate; None if there are none."""
    tracks = answer.rows.tracks
    if not tracks.any():
        return None
    squared = answer.rows.errors(answer.unknowns)[:, tracks] ** 2
    told = (np.isfinite(squared) * answer.rows.coordinates[tracks]).sum(1)
    return np.sqrt(np.divide(np.nansum(squared, 1), told, out=np.full(len(told), np.nan), where=told > 0))


def _rms(residuals: np.ndarray) -> np.ndarray:
    """(T,) root mean square over the markers seen; NaN in a frame that sees none."""
    seen = np.isfinite(residuals).sum(1)
    squared = np.nansum(residuals**2, axis=1)
    return np.sqrt(np.divide(squared, seen, out=np.full(len(seen), np.nan), where=seen > 0))
