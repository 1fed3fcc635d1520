"""blendcap facs train VIDEO... and facs predict VIDEO...: action units from makeup patches in head-camera video."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines
from blendcap.cli.outputs import check_outputs
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Iterator

    from blendcap.io.cameras import Cameras
    from blendcap.io.video import Video
    from blendcap.makeup.patches import Patches
    from blendcap.makeup.setup import Setup

MODELS, CURVES, TABLES = (".npz",), (".csv", ".npz"), (".json",)
DOT = 0.011  # radius of a marker's dot that is taken off the paint, of the picture's height
ANOTHER = 0.5  # seconds by which take and video may differ in length

facs = App(name="facs", help="Action units from makeup patches in head-camera video.")
Stable = Annotated[tuple[str, ...], Parameter(negative=())]


@facs.command
def train(
    videos: Annotated[tuple[Path, ...], Parameter(negative=())],
    /,
    *,
    cameras: Path,
    take: Path,
    rig: Path,
    turns: Path,
    output: Annotated[Path, Parameter(name=("--output", "-o"))],
    correspondences: Path | None = None,
    stable: Stable = (),
    method: Literal["intensity", "svm"] = "intensity",
    features: Literal["gabor", "hog", "edges"] = "gabor",
    warps: int = 0,
    threshold: float | None = None,
    seed: int = 0,
    as_json: AsJson = False,
) -> None:
    """Train a classifier on one performer who shows each action unit four or five times.

    Parameters
    ----------
    videos
        The head cameras' videos, one a camera and in their order. They begin with the take, on a neutral face.
    cameras
        A .json of the calibrated cameras, in the space of the take.
    take
        The markers of the same performance: .c3d, .trc or .csv.
    rig
        A rig with the 68 landmarks; the markers lay it over the face.
    turns
        A .csv with a row for each time that a unit was shown: start,end,unit in seconds.
    output
        The model to write: .npz.
    correspondences
        A .json that says where each marker sits; found if not given.
    stable
        A marker that does not move with the face, by name; repeat it for at least three. Found if not given.
    method
        intensity: regression of intensities. svm: the papers' classes of unit and level.
    features
        What the machine sees of a patch.
    warps
        Randomly warped copies of the training pictures that are added.
    threshold
        How much brighter than the skin around it paint is, in multiples of the patch's median. Found if not given.
    seed
        Of clusters and warps.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io.models import write_model
    from blendcap.io.turns import read_turns
    from blendcap.makeup.lesson import Lesson
    from blendcap.makeup.packing import KIND, VERSION, pack
    from blendcap.makeup.patches import collect

    check_outputs([output], MODELS)
    progress = Progress(quiet=as_json)
    with progress.step("read", "Read the rig, the take and the turns"):
        spans = read_turns(turns)
        films, setup = _stage(videos, cameras, take, rig, correspondences, stable)
    patches = collect(_blocks(films, setup, threshold, progress))
    with progress.step("train", f"Train on {len(patches.sure):,} frames"):
        lesson = Lesson.of_spans(spans, len(patches.sure), patches.rate)
        classifier = blendcap.train_classifier(patches, lesson, method=method, kind=features, warps=warps, seed=seed)
    with progress.step("write", f"Write {output}"):
        write_model(output, KIND, VERSION, *pack(classifier))
    facts: dict[str, Any] = {
        "frames": len(patches.sure),
        "units": list(classifier.units),
        "left_out": {model.region.name: dict(model.scores) for model in classifier.models},
        "seconds": progress.seconds,
    }
    (print_json if as_json else print_lines)(facts)


@facs.command
def predict(
    videos: Annotated[tuple[Path, ...], Parameter(negative=())],
    /,
    *,
    model: Path,
    cameras: Path,
    take: Path,
    rig: Path,
    output: Annotated[Path, Parameter(name=("--output", "-o"))],
    correspondences: Path | None = None,
    stable: Stable = (),
    table: Path | None = None,
    overlay: Path | None = None,
    threshold: float | None = None,
    everywhere: Annotated[bool, Parameter(negative="--shown-only")] = True,
    as_json: AsJson = False,
) -> None:
    """Tell the action units of a performance, of any performer, as curves of the rig's shapes.

    Parameters
    ----------
    videos
        The head cameras' videos, one a camera and in their order. They begin with the take, on a neutral face.
    model
        A classifier from `facs train`.
    cameras
        A .json of the calibrated cameras, in the space of the take.
    take
        The markers of the same performance.
    rig
        A rig with the 68 landmarks, the one that will be solved.
    output
        The curves to write, for `solve --patches`: .csv or .npz.
    correspondences
        A .json that says where each marker sits; found if not given.
    stable
        A marker that does not move with the face, by name; repeat it for at least three. Found if not given.
    table
        A .json from units to the rig's shapes: {"AU4": {"browLower_L": 1.0}}. ARKit's names if not given.
    overlay
        A .mp4 of the cameras with the patches and the curves drawn on.
    threshold
        How much brighter than the skin around it paint is, in multiples of the patch's median. Found if not given.
    everywhere
        Whether the curves also speak at rest, or only where a unit is shown, as in the papers.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import read_animation, write_animation
    from blendcap.io.models import read_model
    from blendcap.makeup.packing import KIND, VERSION, unpack
    from blendcap.makeup.units import ARKIT_TABLE

    check_outputs([output], CURVES)
    check_outputs([overlay], (".mp4",))
    progress = Progress(quiet=as_json)
    with progress.step("read", "Read the model, the rig and the take"):
        classifier = unpack(*read_model(model, KIND, VERSION))
        shapes = ARKIT_TABLE if table is None else _table(table)
        films, setup = _stage(videos, cameras, take, rig, correspondences, stable)
        setup = setup.only(classifier.neutral)
    curves = blendcap.classify(
        classifier, _blocks(films, setup, threshold, progress), table=shapes, everywhere=everywhere
    )
    with progress.step("write", f"Write {output}"):
        write_animation(output, curves)
    if overlay is not None:
        from blendcap.view.patches_film import write_patches_film

        with progress.step("overlay", f"Write {overlay}", total=len(curves.weights)) as tell:
            pictures = [film.frames(grey=True) for film in films]
            write_patches_film(overlay, pictures, setup, read_animation(output), progress=tell)
    facts = {
        "frames": len(curves.weights),
        "rate": curves.rate,
        "shapes": list(curves.names),
        "largest": dict(zip(curves.names, curves.weights.max(0).tolist(), strict=True)),
        "seconds": progress.seconds,
    }
    (print_json if as_json else print_lines)(facts)


def _stage(videos, cameras, take, rig, correspondences, stable) -> tuple[list[Video], Setup]:
    """The videos, checked against cameras and take, and where things are in them."""
    from blendcap.io import read_correspondences, read_markers, read_rig, read_video
    from blendcap.io.cameras import read_cameras
    from blendcap.makeup.setup import locate
    from blendcap.markers.stabilization import find_stable

    known, the_rig, the_take = read_cameras(cameras), read_rig(rig), read_markers(take)
    films = [read_video(video) for video in videos]
    _check_films(films, known, len(the_take.positions), the_take.rate)
    places = None if correspondences is None else read_correspondences(correspondences)
    binding = blendcap.bind(the_rig, the_take, places)
    lenses, sizes = zip(*known.values(), strict=True)
    bound = the_take.select(binding.points.names)
    setup = locate(the_rig, the_take, binding, lenses, sizes, stable or find_stable(bound))
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


def _table(path: Path) -> dict[str, dict[str, float]]:
    from blendcap.io.opening import read_json

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
