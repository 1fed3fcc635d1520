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
from blendcap.cli.solve_inputs import check_inputs

PLACES_SIZE = (1920, 1080)  # room for the names of the markers

if TYPE_CHECKING:
    from collections.abc import Iterator

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
    rig: Path,
    rom: Path | None = None,
    correspondences: Path | None = None,
    patches: Path | None = None,
    patches_offset: float | None = None,
    tracks: Path | None = None,
    unit: Literal["mm", "cm", "dm", "m", "in", "ft"] | None = None,
    choices: Choices = Choices(),
    as_json: AsJson = False,
) -> None:
    """Solve a take: markers in, weights of the rig's shapes out.

    Parameters
    ----------
    take
        The markers: .c3d, .trc or .csv. The first frames should be neutral.
    rig
        The rig to drive: .glb, .npz, a folder of .obj files or an ICT-FaceKit folder.
    rom
        A range-of-motion take of the same markers; it places the markers on the rig more exactly.
    correspondences
        A .json that says where each marker sits: {"NoseTip": 4321, "ChinL": "landmarks68/9"}. Found from the shape of
        the marker cloud if not given: check the picture then.
    patches
        A .csv of curves by shape names that makeup patches tell, from `blendcap facs predict`: the hybrid solve.
    patches_offset
        Seconds by which the video of the patches begins after the take; needed only if they differ in length.
    tracks
        A .npz of paint that was followed between the markers, from `blendcap facs track`.
    unit
        The unit of the take, in place of the one that the file states.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import read_animation, read_correspondences, read_markers, read_rig, read_tracks
    from blendcap.view.concerns import concerns

    outputs.check((take, rig, rom, correspondences, patches, tracks))
    if patches is None and patches_offset is not None:
        raise blendcap.InputError(
            "--patches-offset says when the curves of --patches begin; give these, or leave it out."
        )
    settings = choices.settings()
    progress = Progress(quiet=as_json)
    with progress.step("read", "Read the rig and the take"):
        the_rig, the_take = read_rig(rig), read_markers(take, unit=unit)
        motion = None if rom is None else read_markers(rom, unit=unit)
        places = None if correspondences is None else read_correspondences(correspondences)
        curves = None if patches is None else read_animation(patches)
        followed = None if tracks is None else read_tracks(tracks)
    check_inputs(take, the_take, the_rig, places, settings)
    hybrid = {"patches": curves, "patches_offset": patches_offset, "tracks": followed}
    binding, solution = bind_and_solve(the_rig, the_take, places, motion, settings, progress, **hybrid)
    beside = None
    if (curves is not None or followed is not None) and (outputs.preview or outputs.report):
        with progress.step("alone", "Solve the markers alone, to compare") as tell, _unwarned():
            beside = blendcap.solve(the_rig, the_take, binding, settings=settings, progress=tell)
    told = _shifted(curves, patches_offset)
    files = write_answers(the_rig, solution, binding, progress, outputs, alone=beside, patches=told)
    _say(summary(the_take, solution, progress), concerns(the_rig, solution, binding), files, as_json)


def _say(facts: dict[str, Any], doubts: list[str], files: list[Path], as_json: bool) -> None:
    written = [str(file) for file in files]
    if as_json:
        print_json(facts | {"look_twice": doubts, "files": written})
        return
    not_here = ("rms_mm_per_marker", "unseen", *([] if facts["left_out"] else ["left_out"]))
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


def bind_and_solve(
    rig: Rig, take: MarkerTake, places, motion: MarkerTake | None, settings, progress: Progress, **hybrid
):
    """The binding and the solution of a take; `hybrid` is what `solve` takes of the paint."""
    with progress.step("bind", "Place the markers on the rig") as tell:
        binding = blendcap.bind(rig, take, places, motion, progress=tell)
    with progress.step("solve", f"Solve {len(take.positions):,} frames") as tell:
        solution = blendcap.solve(rig, take, binding, settings=settings, progress=tell, **hybrid)
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
        "seconds": progress.seconds,
    }
