"""blendcap solve TAKE -o OUT --rig RIG."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines
from blendcap.cli.films import thin_film, writes
from blendcap.cli.outputs import ANIMATIONS, PAGES, PICTURES, PLACES, VIDEOS, check_outputs
from blendcap.cli.progress import Progress
from blendcap.cli.solve_inputs import Given, Inputs

PLACES_SIZE = (1920, 1080)  # room for the names of the markers

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np

    from blendcap import SolveSettings
    from blendcap.data import Animation, Binding, MarkerTake, Rig, Solution


@Parameter(name="*")
@dataclass(frozen=True)
class Outputs:
    """The files to write."""

    output: Annotated[tuple[Path, ...], Parameter(name=("--output", "-o"), negative=())]
    """The animation to write: .csv, .livelink.csv, .glb or .npz; repeat -o for several."""
    preview: Path | None = None
    """A .mp4 or .gif of the answer with the markers on it, in real time; above 30 frames a second some are left out.
    With --patches or --tracks the markers alone beside it."""
    report: Path | None = None
    """A self-contained .html page: figures, plots, warnings; with --patches or --tracks what these
    changed."""
    picture: Path | None = None
    """A .png of the markers on the rig, with their names, to check the binding."""
    write_places: Path | None = None
    """A .json of where each marker was placed, in the form of --correspondences: correct it by hand, use it again."""

    def check(self, inputs: tuple[Path | None, ...]) -> None:
        """Refuse what cannot be written, before the work."""
        wanted = ((self.preview, VIDEOS), (self.report, PAGES), (self.picture, PICTURES), (self.write_places, PLACES))
        for paths, endings in ((self.output, ANIMATIONS), *(((path,), endings) for path, endings in wanted)):
            check_outputs(paths, endings, inputs)


@Parameter(name="*")
@dataclass(frozen=True)
class Choices:
    """How to solve; what is None keeps the default of SolveSettings."""

    method: Literal["learned", "paper", "live"] = "learned"
    """learned: exact whole-take solve, prior learned from the take. paper: Eq. 3 of the 2016 paper. live: past only."""
    smoothness: float | None = None
    """Strength of the coupling of neighbouring frames: 1, if not given, is as learned, 0 none. Not with --method
    paper."""
    beta: float | None = None
    """The paper's β in mm²: the larger, the sparser and the more muted; 0.3 if not given. Only with --method paper."""
    coupling: float | None = None
    """λ of λ |a_t - a_(t-1)|², in mm²; 0, the paper's, if not given. Only with --method paper."""
    influence: float | None = None
    """Largest γ of Eq. 4 in mm²: how much a fully trusted curve counts; 4 if not given. Only with --method paper."""
    curve_error: float | None = None
    """Standard deviation of a fully trusted curve: the smaller, the more it counts; 0.1 if not given. Not with
    --method paper."""
    helmet: Literal["rigid", "paper", "none"] = "rigid"
    """Small motion of the head rig, solved with the face. rigid: six signed unknowns. paper: the thesis' twelve dummy
    shapes. none: there is none."""
    head: Literal["auto", "remove", "keep"] = "auto"
    """Large motion of the head. auto: removed if there is any. remove: always. keep: never, as from a helmet camera."""
    stable: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """A marker that moves with the skull, by name; repeat it for at least three. Found from the take if not given."""
    longest_gap: float = 0.1
    """Seconds: gaps up to this long are bridged, and what other software filled is kept where it is no longer; longer
    stretches count as missing."""

    def settings(self) -> SolveSettings:
        """As the library takes them; a choice of another method is refused by the name of its option."""
        from blendcap.solving.settings import METHODS_OF

        given = {name: value for name, value in asdict(self).items() if value is not None}
        for name in given:
            owners = METHODS_OF.get(name, (self.method,))
            if self.method not in owners:
                option, wanted = name.replace("_", "-"), " or ".join(owners)
                raise blendcap.InputError(
                    f"--{option} belongs to --method {wanted}, not to {self.method}; leave it out."
                )
        return blendcap.SolveSettings(**given)


def solve(
    take: Path,
    /,
    *,
    outputs: Outputs,
    inputs: Inputs,
    choices: Choices = Choices(),
    as_json: AsJson = False,
) -> None:
    """Solve a take: markers in, weights of the rig's shapes out.

    Parameters
    ----------
    take
        The markers: .c3d, .trc or .csv. The first frames should be neutral.
    as_json
        Print the answer as JSON.
    """
    from blendcap.view.concerns import concerns

    outputs.check((take, *inputs.files))
    settings = choices.settings()
    progress = Progress(quiet=as_json)
    given = inputs.read(take, settings, progress)
    binding, solution = bind_and_solve(given, settings, progress)
    beside = None
    if (given.curves is not None or given.tracks is not None) and (outputs.preview or outputs.report):
        with progress.step("alone", "Solve the markers alone, to compare") as tell, _unwarned():
            beside = blendcap.solve(given.rig, given.take, binding, settings=settings, progress=tell)
    told = _shifted(given.curves, given.offset)
    files = write_answers(given.rig, solution, binding, progress, outputs, alone=beside, patches=told)
    _say(summary(given.take, solution, progress), concerns(given.rig, solution, binding), files, as_json)


def _say(facts: dict[str, Any], doubts: list[str], files: list[Path], as_json: bool) -> None:
    written = [str(file) for file in files]
    if as_json:
        print_json(facts | {"look_twice": doubts, "files": written})
        return
    not_here = ("rms_mm_per_marker", "unseen", "conflict", *([] if facts["left_out"] else ["left_out"]))
    print_lines({k: v for k, v in facts.items() if k not in not_here} | {"wrote": ", ".join(written)})
    for doubt in doubts:
        print(f"look twice: {doubt}")


@contextmanager
def _unwarned() -> Iterator[None]:
    """What the markers alone cannot tell is what the paint is for: no reason to warn of it."""
    logger = logging.getLogger("blendcap.markers.solve")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _shifted(curves: Animation | None, offset: float | None) -> Animation | None:
    """The curves as they lie over the take."""
    return replace(curves, times=curves.times + offset) if curves is not None and offset else curves


def bind_and_solve(given: Given, settings: SolveSettings, progress: Progress) -> tuple[Binding, Solution]:
    """The binding and the solution of a take."""
    binding = given.bound(progress)
    with progress.step("solve", f"Solve {len(given.take.positions):,} frames") as tell:
        solution = blendcap.solve(given.rig, given.take, binding, settings=settings, progress=tell, **given.paint)
    return binding, solution


def write_answers(
    rig: Rig,
    solution: Solution,
    binding: Binding,
    progress: Progress,
    outputs: Outputs,
    *,
    alone: Solution | None = None,
    patches: Animation | None = None,
) -> list[Path]:
    """Write what was asked for; returns the files. `alone` is the solve without the paint, to be shown beside."""
    from blendcap import view
    from blendcap.io import write_animation, write_correspondences

    picture, places, preview, report = outputs.picture, outputs.write_places, outputs.preview, outputs.report
    for path in outputs.output:
        with progress.step("write", f"Write {path}"):
            write_animation(path, solution.animation, rig=rig)
    if picture is not None:
        with progress.step("picture", f"Write {picture}"):
            skin = binding.points.positions(rig.mesh)
            view.write_still(
                picture, rig, size=PLACES_SIZE, targets=skin + binding.offsets, fitted=skin, labels=binding.points.names
            )
    if places is not None:
        with progress.step("places", f"Write {places}"):
            write_correspondences(places, binding.points)
    if preview is not None:
        _write_preview(preview, rig, solution, alone, progress)
    files = [*outputs.output, *(path for path in (picture, places, preview) if path is not None)]
    if report is not None:
        with progress.step("report", f"Write {report}"):
            steps = [f"Open {path.name}." for path in files]
            view.write_report(
                report, rig, solution, binding=binding, alone=alone, patches=patches, video=preview, next_steps=steps
            )
        files.append(report)
    return files


def _write_preview(path: Path, rig: Rig, solution: Solution, alone: Solution | None, progress: Progress) -> None:
    from blendcap.view import write_comparison, write_preview

    whole = solution.animation
    film = thin_film(whole)
    with progress.step("preview", writes(path, film, whole), total=film.count(whole)) as tell:
        if alone is not None:
            half = replace(film, size=(film.size[0] // 2, film.size[1]), yaws=(0.0,))
            write_comparison(path, rig, alone.animation, whole, half, progress=tell)
        else:
            marked = {"targets": solution.targets, "fitted": solution.fitted}
            write_preview(path, rig, whole, film, **marked, progress=tell)


def summary(take: MarkerTake, solution: Solution, progress: Progress) -> dict[str, Any]:
    """The facts of a solve, as `solve --json` prints them."""
    return {
        "frames": len(take.positions),
        "rate": take.rate,
        "markers": len(take.names),
        "left_out": [name for name in take.names if name not in solution.marker_names],
        "rms_mm": solution.rms_mm,
        "rms_mm_per_marker": dict(zip(solution.marker_names, solution.marker_rms.tolist(), strict=True)),
        **({} if solution.track_rms is None else {"track_rms_mm": solution.track_rms_mm}),
        "max_kkt": solution.certificate.max_kkt,
        "converged": solution.certificate.converged,
        "unseen": list(solution.unseen),
        **({} if solution.conflict is None else {"conflict": _conflict(solution.animation.names, solution.conflict)}),
        "seconds": progress.seconds,
    }


def _conflict(names: Sequence[str], conflict: np.ndarray) -> dict[str, Any]:
    """How far the answer is from what the patches say, by their trust: of shapes in the mean, of frames the worst."""
    return {
        "shapes": dict(zip(names, conflict.mean(0).tolist(), strict=True)),
        "frames": conflict.max(1).tolist(),
        "worst_shape": [
            names[n] if frame[n] > 0 else None for n, frame in zip(conflict.argmax(1), conflict, strict=True)
        ],
    }
