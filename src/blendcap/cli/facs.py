"""blendcap facs train VIDEO... and facs predict VIDEO...: action units from makeup patches in head-camera video."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines
from blendcap.cli.outputs import PICTURES, check_outputs
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from blendcap.data import Animation
    from blendcap.io.cameras import Cameras
    from blendcap.io.video import Video
    from blendcap.makeup.lesson import Lesson
    from blendcap.makeup.patches import Patches
    from blendcap.makeup.setup import Setup

MODELS, CURVES, VIDEOS = (".npz",), (".csv", ".npz"), (".mp4",)
DOT = 0.011  # radius of a marker's dot that is taken off the paint, of the picture's height

facs = App(name="facs", help="Action units from makeup patches in head-camera video.")
Many = Annotated[tuple[Path, ...], Parameter(negative=(), show_default=False)]


@Parameter(name="*")
@dataclass(frozen=True)
class Footage:
    """Where the patches are in the pictures."""

    cameras: Path
    """A .json of the calibrated cameras, in the space of the takes."""
    rig: Path
    """A rig with the 68 landmarks; the markers lay it over the face."""
    correspondences: Path | None = None
    """A .json that says where each marker sits; found if not given."""
    stable: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """A marker that does not move with the face, by name; repeat it for at least three. Found if not given."""
    threshold: float | None = None
    """How much brighter than the skin around it paint is, in multiples of the patch's median. Found if not given."""


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
    as_json: AsJson = False,
) -> None:
    """Train a classifier on one performer who shows each action unit four or five times.

    Several takes teach together: repeat --take, --turns and --weights, and name the videos take by take.

    Parameters
    ----------
    videos
        The head cameras' videos, one a camera and in their order. They begin with the take, on a neutral face.
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
        What the machine sees of a patch: gabor, hog, edges or motion, or several joined by +. By region if not given.
    warps
        Randomly warped copies of the training pictures that are added.
    seed
        Of clusters and warps.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io.models import write_model
    from blendcap.makeup.packing import KIND, VERSION, pack

    check_outputs([output], MODELS)
    taught, shapes, progress = _by_take(videos, take, turns, weights), _table(table), Progress(quiet=as_json)
    patches, lessons = zip(*(_lesson(*files, footage, progress) for files in taught), strict=True)
    frames = sum(len(cut.sure) for cut in patches)
    with progress.step("train", f"Train on {frames:,} frames"):
        classifier = blendcap.train_classifier(
            patches, lessons, method=method, kind=features, table=shapes, warps=warps, seed=seed
        )
    with progress.step("write", f"Write {output}"):
        write_model(output, KIND, VERSION, *pack(classifier))
    facts: dict[str, Any] = {
        "frames": frames,
        "units": list(classifier.units),
        "left_out": {model.region.name: dict(model.scores) for model in classifier.models},
        "seconds": progress.seconds,
    }
    (print_json if as_json else print_lines)(facts)


def _lesson(
    videos: Sequence[Path], take: Path, turns: Path, weights: Path | None, footage: Footage, progress: Progress
) -> tuple[Patches, Lesson]:
    """The patches of a take, and what the performer did."""
    from blendcap.io import read_animation
    from blendcap.io.turns import read_turns
    from blendcap.makeup.lesson import Lesson
    from blendcap.makeup.patches import collect

    with progress.step("read", f"Read {take}"):
        spans = read_turns(turns)
        solved = None if weights is None else read_animation(weights)
        films, setup = _stage(videos, take, footage)
    cut = collect(_blocks(films, setup, footage.threshold, progress))
    return cut, Lesson.of_spans(spans, len(cut.sure), cut.rate, solved)


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
        The head cameras' videos, one a camera and in their order. They begin with the take, on a neutral face.
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
        Whether the take's strongest blinks shut the eyes, or stay as weak as they were told.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import write_animation
    from blendcap.io.models import read_model
    from blendcap.makeup.packing import KIND, VERSION, unpack

    for path, endings in ((output, CURVES), (overlay, VIDEOS), (picture, PICTURES)):
        check_outputs([path], endings)
    progress = Progress(quiet=as_json)
    with progress.step("read", "Read the model, the rig and the take"):
        classifier = unpack(*read_model(model, KIND, VERSION))
        shapes = _table(table)
        films, setup = _stage(videos, take, footage)
        setup = setup.only(classifier.neutral)
    blocks = _blocks(films, setup, footage.threshold, progress)
    curves = blendcap.classify(classifier, blocks, table=shapes, everywhere=everywhere, full_blinks=full_blinks)
    with progress.step("write", f"Write {output}"):
        write_animation(output, curves)
    _show(films, setup, curves, overlay, picture, progress)
    facts = {
        "frames": len(curves.weights),
        "rate": curves.rate,
        "shapes": list(curves.names),
        "largest": dict(zip(curves.names, curves.weights.max(0).tolist(), strict=True)),
        "seconds": progress.seconds,
    }
    (print_json if as_json else print_lines)(facts)


def _show(films: list[Video], setup: Setup, curves: Animation, overlay, picture, progress: Progress) -> None:
    """The overlay and the picture, if they were asked for."""
    from blendcap.view.patches_film import write_patches_film, write_patches_picture

    if overlay is not None:
        with progress.step("overlay", f"Write {overlay}", total=len(curves.weights)) as tell:
            write_patches_film(overlay, [film.frames(grey=True) for film in films], setup, curves, progress=tell)
    if picture is not None:
        with progress.step("picture", f"Write {picture}"):
            write_patches_picture(picture, [film.frames(grey=True) for film in films], setup, curves)


def _by_take(
    videos: Sequence[Path], takes: Sequence[Path], turns: Sequence[Path], weights: Sequence[Path]
) -> list[tuple[Sequence[Path], Path, Path, Path | None]]:
    """Videos, markers, turns and weights of each take."""
    each, over = divmod(len(videos), len(takes))
    if len(turns) != len(takes) or len(weights) not in (0, len(takes)) or over:
        raise blendcap.InputError(
            f"There are {len(takes)} takes, {len(turns)} turns, {len(weights)} weights and {len(videos)} videos; give "
            "turns for each take, weights for each or none, and every take's videos, take by take."
        )
    films = [videos[k * each : (k + 1) * each] for k in range(len(takes))]
    return list(zip(films, takes, turns, weights or [None] * len(takes), strict=True))


def _stage(videos: Sequence[Path], take: Path, footage: Footage) -> tuple[list[Video], Setup]:
    """The videos, checked against cameras and take, and where things are in them."""
    from blendcap.io import read_correspondences, read_markers, read_rig, read_video
    from blendcap.io.cameras import read_cameras
    from blendcap.makeup.setup import locate
    from blendcap.markers.stabilization import find_stable

    known, the_rig, the_take = read_cameras(footage.cameras), read_rig(footage.rig), read_markers(take)
    films = [read_video(video) for video in videos]
    _check_films(films, known, len(the_take.positions), the_take.rate)
    places = None if footage.correspondences is None else read_correspondences(footage.correspondences)
    binding = blendcap.bind(the_rig, the_take, places)
    lenses, sizes = zip(*known.values(), strict=True)
    bound = the_take.select(binding.points.names)
    setup = locate(the_rig, the_take, binding, lenses, sizes, footage.stable or find_stable(bound))
    return films, setup


def _check_films(films: list[Video], cameras: Cameras, frames: int, rate: float) -> None:
    if len(films) != len(cameras):
        raise blendcap.InputError(
            f"There are {len(films)} videos, but {len(cameras)} cameras ({', '.join(cameras)}); give one a camera."
        )
    for film, (name, (_, size)) in zip(films, cameras.items(), strict=True):
        other = next((n for n in cameras if n in film.path.stem), None)
        if other is not None and name not in film.path.stem:
            raise blendcap.InputError(
                f"{film.path} stands where the video of the camera {name!r} should, but is named after {other!r}; give "
                f"the videos in the order of the cameras: {', '.join(cameras)}."
            )
        if film.size != size:
            raise blendcap.InputError(
                f"{film.path} has pictures of {film.size[0]} x {film.size[1]} pixels, but the camera {name!r} "
                f"of {size[0]} x {size[1]}; the order of the videos must be that of the cameras."
            )
        if abs(film.rate - rate) > 0.01 * rate or film.count != frames:
            raise blendcap.InputError(
                f"{film.path} has {film.count} frames at {film.rate:g} a second, but the take {frames} at {rate:g}; "
                "cut both to the same frames."
            )


def _blocks(films: list[Video], setup: Setup, threshold: float | None, progress: Progress) -> Iterator[Patches]:
    """The patches, block by block, with progress."""
    from blendcap.makeup.patches import each_block

    done, count = 0, films[0].count
    pictures = [film.frames(grey=True) for film in films]
    radius = DOT * films[0].size[1]
    with progress.step("patches", f"Cut the patches of {count:,} frames", total=count) as tell:
        for block in each_block(
            pictures, setup.places, setup.anchors, films[0].rate, dots=setup.dots, dot_radius=radius,
            threshold=threshold,
        ):  # fmt: skip
            done += len(block.sure)
            tell(done)
            yield block


def _table(path: Path | None) -> Mapping[str, Mapping[str, float]]:
    """From units to shapes, ARKit's if there is no file."""
    from blendcap.io.opening import read_json
    from blendcap.makeup.units import ARKIT_TABLE

    if path is None:
        return ARKIT_TABLE
    table = read_json(path)
    fits = isinstance(table, dict) and all(
        isinstance(shapes, dict) and all(isinstance(w, int | float) for w in shapes.values())
        for shapes in table.values()
    )
    if not fits:
        raise blendcap.InputError(
            f'{path} must be a JSON object from units to shapes, such as {{"AU4": {{"browLower_L": 1.0}}}}.'
        )
    return table
