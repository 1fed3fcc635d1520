"""A rig made personal by a take: what markers and tracks show that no weights of the rig explain."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from blendcap.data import Animation, Binding, InputError, MarkerTake, PaintTracks, Rig, Solution, SurfacePoints
from blendcap.data.names import listed
from blendcap.markers.solve import answered, as_solution, check_rig, curves_of_take, problem_of
from blendcap.markers.track_rows import track_deltas
from blendcap.modeling.bends import SCALES, Bends, SeenPoints, bent, fit_bends, moments
from blendcap.modeling.examples import kept_shapes, learned_from
from blendcap.modeling.fields import smooth_functions
from blendcap.solving.answer import Answer
from blendcap.solving.settings import SolveSettings
from blendcap.solving.shares import full_weights, in_shares

ROUNDS = 3  # weights, then shapes, and again
REACH = 0.1  # of the face's extent: how far a change stays alike
WAVES = 120  # smooth functions that span it
NOISE = 3.0  # mm: of a coordinate in a frame, as if frames and points erred each on its own
BLOCK = 2.0  # seconds of a stretch that is left out as a whole, and foretold
FOLDS = 2
LEAST = 0.01  # part of what left-out frames lack; who foretells less has learned from noise
FEW = 150  # points; fewer tell weights, not shapes
MUCH = 0.5  # part of a shape's own largest motion, beyond which a change is no person's way
LEAST_BLOCKS = 4  # of that length: a shorter take would be judged by itself

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class TakeRefinement:
    """A rig refined by a take, and what its making can prove.

    Parameters
    ----------
    rig : Rig
        The same shapes by the same names, each moved a little otherwise.
    solution : Solution
        Of the take on the refined rig.
    change : (N, V) float64
        How far each vertex is from where it was under each shape at full weight, mm; 0 of shapes that the take does not
        use.
    rms : (1 + R,) float64
        What the rig lacks of markers and tracks at first and after each round that changed the shapes, root mean square
        of a coordinate, mm; of the samples that each solve counts: strays are chosen anew.
    foretold : float
        Part of what left-out seconds lack (squared) that changes explain which were learned from the others, in the
        first round. Of captured points only: skin between them is not judged.
    residual : float
        Largest relative residual of the linear solves.
    """

    rig: Rig
    solution: Solution
    change: np.ndarray
    rms: np.ndarray
    foretold: float
    residual: float


def refine_from_take(
    rig: Rig,
    take: MarkerTake,
    binding: Binding,
    *,
    patches: Animation | None = None,
    patches_offset: float | None = None,
    tracks: PaintTracks | None = None,
    settings: SolveSettings | None = None,
    rounds: int = ROUNDS,
    progress: Callable[[str], None] = lambda _: None,
) -> TakeRefinement:
    """Refine a transferred rig with a take of the same person: the very one that is to be solved.

    The take is solved; what its markers and tracks do that the solved weights do not explain becomes a smooth change of
    the shapes that were on (`blendcap.modeling.bends`), how large a one is believed is judged by left-out seconds; and
    again. Contact, eyeballs and solid bodies are kept as by `refine_rig`, which learns from scans of expressions:
    these tell more, but take a scanner. In other takes the changes hold as far as these use the same shapes together.

    Parameters
    ----------
    rig : Rig
        The person's rig, as `transfer_rig` or `refine_rig` makes it.
    take, binding, patches, patches_offset, tracks, settings
        As for `solve`. Tracks tell most: markers alone see too little of each shape to change much.
    rounds : int
        Weights, then shapes, so often.
    progress : callable
        Told what begins.

    Raises
    ------
    InputError
        As `solve`, and if there is no round, the method is live, or the take is shorter than 8 seconds.
    """
    check_rig(rig)
    settings = settings or SolveSettings()
    _check(take, settings, rounds)
    curves = curves_of_take(rig, take, patches, patches_offset)
    shares, full = in_shares(rig), full_weights(rig)
    skin, refined, residual, scale = _Skin.of(shares, binding, tracks), shares, 0.0, None
    _warn_of_few(len(skin.there))
    problem = problem_of(rig, take, binding, tracks, settings, lambda *_: None)
    progress("the first weights")
    answer = answered(problem, curves, settings, lambda *_: None)
    rms, foretold = [_lacking(answer)], None
    for k in range(rounds):
        progress(f"round {k + 1} of {rounds}, shapes")
        found = skin.learned(answer, take.rate, scale)
        foretold = found.foretold if foretold is None else foretold  # later rounds have seen what they would foretell
        if foretold < LEAST:
            log.warning("What was learned of the shapes did not foretell left-out seconds; they stay as they were.")
            break
        scale, (refined, off) = found.scale, skin.applied(found)
        residual = max(residual, off, found.residual)
        progress(f"round {k + 1} of {rounds}, weights")
        problem = replace(problem, rig=refined, rows=problem.rows.with_shapes(skin.sampled(refined)))
        answer = answered(problem, curves, settings, lambda *_: None)
        rms.append(_lacking(answer))
    change = refined.deltas - shares.deltas
    _warn(shares, change)
    return TakeRefinement(
        rig=replace(rig, deltas=rig.deltas + change / full.astype(np.float32)[:, None, None]),
        solution=as_solution(problem, answer, full, curves, settings, {}),
        change=np.linalg.norm(change.astype(np.float64), axis=2),
        rms=np.array(rms),
        foretold=foretold or 0.0,
        residual=residual,
    )


@dataclass(frozen=True, eq=False)
class _Skin:
    """The rig as it was given, its weights as shares, its skin, and the points on it that were captured."""

    rig: Rig
    moving: np.ndarray  # (V,) vertices that may change
    waves: np.ndarray  # (V, K) smooth functions there
    captured: tuple[SurfacePoints, SurfacePoints | None]  # markers and tracks
    there: np.ndarray  # (P, K) smooth functions at the captured points
    moved: np.ndarray  # (P, N, 3) what each shape does to them, mm
    deltas: np.ndarray  # (P, N, 3) the same as far as they may tell it

    @classmethod
    def of(cls, rig: Rig, binding: Binding, tracks: PaintTracks | None) -> _Skin:
        captured = binding.points, None if tracks is None else tracks.points
        moving = learned_from(rig)
        waves = smooth_functions(rig.mesh.vertices[moving], REACH, WAVES)
        rest = np.concatenate([points.positions(rig.mesh) for points in captured if points is not None])
        moved = np.hstack([rig.sample(points)[1] for points in captured if points is not None]).transpose(1, 0, 2)
        return cls(rig, moving, waves(rig.mesh.vertices[moving]), captured, waves(rest), moved, _deltas(rig, *captured))

    def sampled(self, rig: Rig) -> np.ndarray:
        """What each shape does to the captured points (P, N, 3), mm."""
        return _deltas(rig, *self.captured)

    def learned(self, answer: Answer, rate: float, scale: float | None) -> Bends:
        """What an answer's rows have that its weights on the given rig do not explain; a known scale is kept."""
        rows = answer.rows
        axes = np.tile(np.eye(3), (len(self.deltas), 1, 1)) if rows.axes is None else rows.axes
        points = SeenPoints(self.deltas, self.there, axes, (answer.trusted / NOISE) ** 2)
        weights, seen = answer.unknowns[:, : rows.shapes], ~rows.missing
        missed = rows.targets - rows.helmet_part(answer.unknowns)
        missed -= rows.along(np.tensordot(weights, self.moved, axes=(1, 1)))  # a tongue that is out moves lips, too
        fold = (np.arange(len(weights)) / (BLOCK * rate)).astype(int) % FOLDS
        parts = [moments(points, weights[fold == k], missed[fold == k], seen[fold == k]) for k in range(FOLDS)]
        return fit_bends(points, parts, SCALES if scale is None else (scale,))

    def applied(self, found: Bends) -> tuple[Rig, float]:
        """The rig with changed shapes, contact and solid bodies kept, and the residual of that."""
        change = np.zeros(self.rig.deltas.shape)
        old = self.rig.deltas[:, self.moving].astype(np.float64).transpose(1, 0, 2)
        change[:, self.moving] = bent(old, self.waves, found.coefficients).transpose(1, 0, 2)
        deltas, residual = kept_shapes(self.rig, change)
        return replace(self.rig, deltas=deltas.astype(np.float32)), residual


def _deltas(rig: Rig, markers: SurfacePoints, tracks: SurfacePoints | None) -> np.ndarray:
    deltas = rig.sample(markers)[1]
    return (deltas if tracks is None else np.hstack([deltas, track_deltas(rig, tracks)])).transpose(1, 0, 2)


def _check(take: MarkerTake, settings: SolveSettings, rounds: int) -> None:
    if rounds < 1:
        raise InputError(f"Refining takes at least one round, but rounds is {rounds}.")
    if settings.method == "live":
        raise InputError("A rig is refined by a whole take, and the live solve looks at the past only; choose another.")
    seconds = len(take.positions) / take.rate
    if seconds < LEAST_BLOCKS * BLOCK:
        raise InputError(
            f"The take lasts {seconds:.1f} s; to refine a rig takes {LEAST_BLOCKS * BLOCK:g} s, of which parts judge "
            "what the others teach."
        )


def _warn_of_few(points: int) -> None:
    """Say it before the work that some fifty markers do not tell shapes, but weights only."""
    if points < FEW:
        log.warning(
            "Only %d points tell how the shapes differ, and a few hundred are needed: follow paint and skin, too "
            "(blendcap facs track, then --tracks), or leave the rig as it is.",
            points,
        )


def _warn(rig: Rig, change: np.ndarray) -> None:
    """Say which shapes changed by more than people differ: they took up something else."""
    moved, before = (np.linalg.norm(part, axis=2).max(1) for part in (change, rig.deltas))
    odd = [name for name, far, own in zip(rig.names, moved, before, strict=True) if far > MUCH * own]
    if odd:
        log.warning(
            "Do not use this rig unseen: these shapes changed by more than half of their own motion, which no two "
            "faces differ by: %s. The rig that was given is not this actor's (blendcap rig build makes one), or the "
            "points are too few (blendcap facs track finds more).",
            listed(odd, 12),
        )


def _lacking(answer: Answer) -> float:
    """Root mean square of what the answer leaves, mm a coordinate, of markers and tracks as far as they count."""
    rows = answer.rows
    squared = np.nansum((answer.trusted * rows.errors(answer.unknowns)) ** 2)
    told = (~rows.missing).sum(0) @ (answer.trusted**2 * rows.coordinates)
    return float(np.sqrt(squared / max(told, 1e-12)))
