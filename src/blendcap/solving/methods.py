"""The one call behind every method: marker rows and settings in, an answer and what it is worth out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from blendcap.data import Rig
from blendcap.solving.answer import Answer
from blendcap.solving.curves import Curves
from blendcap.solving.learned import solve_learned
from blendcap.solving.live import solve_live
from blendcap.solving.paper import solve_paper
from blendcap.solving.prior import START_DEVIATION
from blendcap.solving.rows import MarkerRows
from blendcap.solving.settings import SolveSettings
from blendcap.solving.visibility import Kinship, held_shapes, joint_errors, lasting_noise, weight_errors

ALIKE = 15  # tracks that err alike, being neighbours: together they tell as much as one (errors on the stage, by 14)


def solve_rows(
    rig: Rig,
    rows: MarkerRows,
    rate: float,
    noise: float,
    settings: SolveSettings,
    *,
    curves: Curves | None = None,
    relinearize: Callable[[np.ndarray], np.ndarray] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Answer:
    """Unknowns of the whole take by the method of the settings.

    Parameters
    ----------
    rig : Rig
        Whose shapes the rows are about: their names and partners.
    rows : MarkerRows
    rate : float
        Frames a second.
    noise : float
        Standard deviation of a marker coordinate, model error included, mm.
    settings : SolveSettings
    curves : Curves, optional
        What is known of the weights from elsewhere.
    relinearize : callable, optional
        As in `solve_learned`.
    progress : callable
        Told what begins.
    """
    if settings.method == "paper":
        charges = (settings.beta, settings.gamma, settings.coupling)
        solved = solve_paper(rows, *charges, curves=curves, influence=settings.influence)
        return _as_answer(rows, noise, np.zeros(len(rig.names), dtype=bool), *solved)
    kinship = Kinship.of_rig(rig, settings.symmetry)
    if settings.method == "live":
        told = 0.0 if curves is None else settings.curve_error**-2 * curves.confidence.any(0)
        in_view = replace(rows, missing=np.zeros_like(rows.missing))  # what will be missing is not known yet
        held = held_shapes(in_view, lasting_noise(noise, noise), kinship, told)
        solved = solve_live(
            rows, kinship.mirror, rate, noise, symmetry=settings.symmetry, smoothness=settings.smoothness,
            curves=curves, curve_error=settings.curve_error, held=held,
        )  # fmt: skip
        return _as_answer(rows, noise, held, *solved)
    return solve_learned(
        rows, kinship, rate, noise, smoothness=settings.smoothness, passes=settings.passes, curves=curves,
        curve_error=settings.curve_error, relinearize=relinearize, progress=progress,
    )  # fmt: skip


def _as_answer(rows: MarkerRows, noise: float, held: np.ndarray, unknowns, energies, certificate) -> Answer:
    return Answer(rows, unknowns, energies, certificate, noise, held, np.ones(len(rows.rows)))


def standard_errors(
    rig: Rig, answer: Answer, least: float, curves: Curves | None, settings: SolveSettings
) -> np.ndarray:
    """(N,) standard error of each weight: as if it alone moved, or, for a shape held, with all others at play.

    Parameters
    ----------
    rig : Rig
    answer : Answer
    least : float
        Noise of a marker coordinate before the rig's own errors were seen, mm.
    curves : Curves or None
    settings : SolveSettings
    """
    told = np.zeros(answer.rows.shapes) if curves is None else _told(curves, answer.noise, settings)
    alike = np.where(answer.rows.tracks, ALIKE**-0.5, 1.0)
    rows, noise = answer.rows.weighed(answer.trusted * alike), lasting_noise(answer.noise, least)
    alone = weight_errors(rows, noise, told)
    kinship = Kinship.of_rig(rig, settings.symmetry)
    joint = joint_errors(rows, noise, kinship, told, np.ones(rows.shapes, dtype=bool))
    return np.where(answer.held, np.maximum(alone, joint), alone)


def _told(curves: Curves, noise: float, settings: SolveSettings) -> np.ndarray:
    """(N,) one over variance of what the curves tell of each weight; γ of Eq. 4 is relative to the markers' noise."""
    if settings.method != "paper":
        return curves.precision(settings.curve_error)
    return curves.precision(1.0) * settings.influence / noise**2


def confidence(errors: np.ndarray, rows: MarkerRows) -> np.ndarray:
    """(T, N) part of a weight's variance that the markers, and not the prior, decide: 1 is seen, 0 is not.

    The same in all frames, but 0 in those that see no marker at all. `errors` (N,) are `standard_errors`.
    """
    return np.outer(~rows.missing.all(1), 1 / (1 + (errors / START_DEVIATION) ** 2))
