"""blendcap facs train, predict and track VIDEO...: what makeup patches in head-camera video tell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines
from blendcap.cli.facs_inputs import Footage, blocks, by_take, check_shapes, stage, table_of
from blendcap.cli.facs_track import track
from blendcap.cli.film_time import weights_at_frames
from blendcap.cli.left_out import left_out, left_out_in_words
from blendcap.cli.outputs import PICTURES, check_outputs
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from blendcap.data import Animation
    from blendcap.io.video import Video
    from blendcap.makeup.lesson import Lesson
    from blendcap.makeup.setup import Setup

MODELS, CURVES, VIDEOS = (".npz",), (".csv", ".npz"), (".mp4",)

facs = App(name="facs", help="Action units from makeup patches in head-camera video, and paint that is followed.")
facs.command(track)
Many = Annotated[tuple[Path, ...], Parameter(negative=(), show_default=False)]


@facs.command
def train(
    videos: Many,
    /,
    *,
    footage: Footage,
    take: Many,
    turns: Many,
    output: Annotated[Path, Parameter(name=("--output", "-o"))],
    weights: Many = (),
    table: Path | None = None,
    method: Literal["intensity", "svm"] = "intensity",
    features: str | None = None,
    warps: int = 0,
    seed: int = 0,
    picture: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Train a classifier on one performer who shows each action unit four or five times.

    Several takes teach together: repeat --take, --turns and --weights, and name the videos take by take.

    Parameters
    ----------
    videos
        The head cameras' videos, one a camera and in their order. They begin with the take (or see --offset), on a
        neutral face.
    take
        The markers of the same performance: .c3d, .trc or .csv.
    turns
        A .csv with a row for each time that a unit was shown: start,end,unit in seconds.
    output
        The model to write: .npz.
    weights
        The solved take, .npz or .csv: tells how strongly each unit is shown, better than the pictures do.
    table
        A .json from units to the shapes of the weights: {"AU4L": {"browLower_L": 1.0}}. ARKit's names if not given.
    method
        intensity: regression of intensities. svm: the papers' classes of unit and level.
    features
        What the machine sees of a patch: gabor, hog, edges, motion or fine, or several joined by +. By region if not
        given.
    warps
        Randomly warped copies of the training pictures that are added.
    seed
        Of clusters and warps.
    picture
        A .png of which unit was taken for which in showings that were left out of the training.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io.models import write_model
    from blendcap.makeup.features import check_features
    from blendcap.makeup.lesson import check_lessons, regions_of
    from blendcap.makeup.packing import KIND, VERSION, pack
    from blendcap.makeup.patches import collect
    from blendcap.view.confusion import plot_confusion
    from blendcap.view.style import write_plot

    read = (*videos, *take, *turns, *weights, table, footage.cameras, footage.rig, footage.correspondences)
    check_outputs([output], MODELS, read)
    check_outputs([picture], PICTURES, read)
    if warps < 0:
        raise blendcap.InputError(f"--warps is {warps}, but must be 0 or more.")
    if features is not None:
        check_features(features)
    taught, shapes, progress = by_take(videos, take, turns, weights), table_of(table), Progress(quiet=as_json)
    films, setups, lessons = zip(*(_lesson(*files, footage, progress) for files in taught), strict=True)
    check_lessons(lessons, regions_of(method), method, shapes)  # all refusals come before the long work
    patches = [
        collect(blocks(film, setup, footage.threshold, progress)) for film, setup in zip(films, setups, strict=True)
    ]
    frames = sum(len(cut.sure) for cut in patches)
    with progress.step("train", f"Train on {frames:,} frames"):
        classifier = blendcap.train_classifier(
            patches, lessons, method=method, kind=features, table=shapes, warps=warps, seed=seed
        )
    with progress.step("write", f"Write {output}"):
        write_model(output, KIND, VERSION, *pack(classifier))
    if picture is not None:
        with progress.step("picture", f"Write {picture}"):
            write_plot(picture, plot_confusion(classifier))
    said = left_out(classifier) if as_json else left_out_in_words(classifier)
    facts = {"frames": frames, "units": list(classifier.units), **said, "seconds": progress.seconds}
    (print_json if as_json else print_lines)(facts)


def _lesson(
    videos: Sequence[Path], take: Path, turns: Path, weights: Path | None, footage: Footage, progress: Progress
) -> tuple[list[Video], Setup, Lesson]:
    """A take's videos, where its patches are, and what the performer did."""
    from blendcap.io import read_animation
    from blendcap.io.turns import read_turns
    from blendcap.makeup.lesson import Lesson

    with progress.step("read", f"Read {take}"):
        spans = read_turns(turns)
        solved = None if weights is None else read_animation(weights)
        staged = stage(videos, take, footage)
        films, setup, late = staged.films, staged.setup(footage.stable), footage.offset or 0.0
        known = None if solved is None else weights_at_frames(films[0], solved, late)
        return films, setup, Lesson.of_spans(spans, films[0].count, films[0].rate, known, late)


@facs.command
def predict(
    videos: Many,
    /,
    *,
    footage: Footage,
    take: Path,
    model: Path,
    output: Annotated[Path, Parameter(name=("--output", "-o"))],
    table: Path | None = None,
    overlay: Path | None = None,
    picture: Path | None = None,
    everywhere: Annotated[bool, Parameter(negative="--shown-only")] = True,
    full_blinks: Annotated[bool, Parameter(negative="--blinks-as-told")] = True,
    as_json: AsJson = False,
) -> None:
    """Tell the action units of a performance, of any performer, as curves of the rig's shapes.

    Parameters
    ----------
    videos
        The head cameras' videos, one a camera and in their order. They begin with the take (or see --offset), on a
        neutral face.
    take
        The markers of the same performance: .c3d, .trc or .csv.
    model
        A classifier from `facs train`.
    output
        The curves to write, for `solve --patches`: .csv or .npz.
    table
        A .json from units to the rig's shapes: {"AU4L": {"browLower_L": 1.0}}. ARKit's names if not given.
    overlay
        A .mp4 of the cameras with the patches and the curves drawn on.
    picture
        A .png of the frame that shows most, as the overlay has it: are the patches where they should be?
    everywhere
        Whether the curves also speak at rest, or only where a unit is shown, as in the papers.
    full_blinks
        Whether the take's strongest blinks shut the eyes, or all stay as they were told.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import write_animation
    from blendcap.io.models import read_model
    from blendcap.makeup.packing import KIND, VERSION, unpack

    read = (*videos, take, model, table, footage.cameras, footage.rig, footage.correspondences)
    for path, endings in ((output, CURVES), (overlay, VIDEOS), (picture, PICTURES)):
        check_outputs([path], endings, read)
    progress = Progress(quiet=as_json)
    with progress.step("read", "Read the model, the rig and the take"):
        classifier = unpack(*read_model(model, KIND, VERSION))
        shapes = table_of(table)
        staged = stage(videos, take, footage)
        check_shapes(staged.rig, shapes, classifier.units)
        films, setup = staged.films, staged.setup(footage.stable).only(classifier.neutral)
    cut = blocks(films, setup, footage.threshold, progress)
    curves = blendcap.classify(classifier, cut, table=shapes, everywhere=everywhere, full_blinks=full_blinks)
    with progress.step("write", f"Write {output}"):
        write_animation(output, curves)
    _show(films, setup, curves, overlay, picture, progress)
    facts = {
        "frames": len(curves.weights),
        "rate": curves.rate,
        "shapes": list(curves.names),
        "largest": dict(zip(curves.names, curves.weights.max(0).tolist(), strict=True)),
        "trusted": dict(zip(curves.names, _trusted(curves), strict=True)),
        "seconds": progress.seconds,
    }
    (print_json if as_json else print_lines)(facts)


def _trusted(curves: Animation) -> list[float]:
    """How far each curve is trusted, 0 to 1, in the mean over the take."""
    return [1.0] * len(curves.names) if curves.confidence is None else curves.confidence.mean(0).tolist()


def _show(films: list[Video], setup: Setup, curves: Animation, overlay, picture, progress: Progress) -> None:
    """The overlay and the picture, if they were asked for."""
    from blendcap.view.patches_film import write_patches_film, write_patches_picture

    if overlay is not None:
        with progress.step("overlay", f"Write {overlay}", total=len(curves.weights)) as tell:
            write_patches_film(overlay, [film.frames(grey=True) for film in films], setup, curves, progress=tell)
    if picture is not None:
        with progress.step("picture", f"Write {picture}"):
            write_patches_picture(picture, [film.frames(grey=True) for film in films], setup, curves)
