"""What the `facs` commands read: videos, takes, cameras and tables, held against each other."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from cyclopts import Parameter

import blendcap
from blendcap.cli.film_time import same_rate, take_at_frames, take_of_same_frames
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy as np

    from blendcap.data import Binding, Camera, MarkerTake, Rig
    from blendcap.io.cameras import Cameras
    from blendcap.io.video import Video
    from blendcap.makeup.patches import Patches
    from blendcap.makeup.setup import Setup

DOT = 0.011  # radius of a marker's dot that is taken off the paint, of the picture's height
LOST, OFTEN = 0.5, 0.1  # part of a frame's still points below which it is lost; part of such frames that is told

log = logging.getLogger(__name__)


@Parameter(name="*")
@dataclass(frozen=True)
class Filmed:
    """What the cameras look at."""

    cameras: Path
    """A .json of the calibrated cameras, in the space of the takes."""
    rig: Path
    """A rig; the markers lay it over the face. For patches it needs the 68 landmarks."""
    correspondences: Path | None = None
    """A .json that says where each marker sits; found if not given."""

    def take_of(self, film: Video, take: MarkerTake) -> MarkerTake:
        """The markers in the frames of a film, which must be those of the take: tracks are solved with it."""
        return take_of_same_frames(film, take)


@Parameter(name="*")
@dataclass(frozen=True)
class Footage(Filmed):
    """Where the patches are in the pictures."""

    offset: float | None = None
    """Seconds by which the videos begin after the take, the same for all takes; needed only if they differ in length.
    Their rates may differ: the markers are then told between their frames."""

    stable: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """A marker that does not move with the face, by name, to follow in the pictures; repeat it for at least three. If
    not given, the head's pose, which the markers' places in space tell, holds the pictures still."""
    threshold: float | None = None
    """How much brighter than the skin around it paint is, in multiples of the patch's median. Found if not given."""

    def take_of(self, film: Video, take: MarkerTake) -> MarkerTake:
        """The markers in the frames of a film, which may have another rate and begin later."""
        return take_at_frames(film, take, self.offset)


def by_take(
    videos: Sequence[Path], takes: Sequence[Path], turns: Sequence[Path], weights: Sequence[Path]
) -> list[tuple[Sequence[Path], Path, Path, Path | None]]:
    """Videos, markers, turns and weights of each take."""
    each, over = divmod(len(videos), len(takes))
    if len(turns) != len(takes) or len(weights) not in (0, len(takes)) or over:
        raise blendcap.InputError(
            f"Takes: {len(takes)}; turns: {len(turns)}; weights: {len(weights)}; videos: {len(videos)}. Give turns for "
            "each take, weights for each or none, and every take's videos, take by take."
        )
    films = [videos[k * each : (k + 1) * each] for k in range(len(takes))]
    return list(zip(films, takes, turns, weights or [None] * len(takes), strict=True))


class Stage(NamedTuple):
    """What the files of a filmed take hold, checked against each other."""

    films: list[Video]
    cameras: list[Camera]
    rig: Rig
    take: MarkerTake
    binding: Binding

    def setup(self, stable: Sequence[str]) -> Setup:
        """Where patches, dots and still points are."""
        from blendcap.makeup.setup import locate

        sizes = [film.size for film in self.films]
        return locate(self.rig, self.take, self.binding, self.cameras, sizes, stable)

    def pictures(self) -> list[Iterator[np.ndarray]]:
        """The frames (H, W) uint8 of each camera, from the first."""
        return [film.frames(grey=True) for film in self.films]


def stage(videos: Sequence[Path], take: Path, footage: Filmed) -> Stage:
    """Read the videos, cameras, rig and markers of a take."""
    from blendcap.io import read_correspondences, read_markers, read_rig, read_video
    from blendcap.io.cameras import read_cameras
    from blendcap.makeup.belonging import check_belonging

    known, the_rig, the_take = read_cameras(footage.cameras), read_rig(footage.rig), read_markers(take)
    films = [read_video(video) for video in videos]
    _check_films(films, known)
    the_take = footage.take_of(films[0], the_take)
    places = None if footage.correspondences is None else read_correspondences(footage.correspondences)
    binding = blendcap.bind(the_rig, the_take, places)
    whole = Stage(films, [camera for camera, _ in known.values()], the_rig, the_take, binding)
    first = [next(frames) for frames in whole.pictures()]
    check_belonging(first, the_take.positions[0], whole.cameras, tuple(known))
    return whole


def _check_films(films: list[Video], cameras: Cameras) -> None:
    if len(films) != len(cameras):
        raise blendcap.InputError(
            f"Videos: {len(films)}; cameras: {len(cameras)} ({', '.join(cameras)}). Give one video a camera, in their "
            "order."
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
        if film.count != films[0].count or not same_rate(film.rate, films[0].rate):
            raise blendcap.InputError(
                f"{film.path} has {film.count} frames at {film.rate:g} a second, but {films[0].path} {films[0].count} "
                f"at {films[0].rate:g}; cut the videos to the same frames."
            )


def blocks(films: list[Video], setup: Setup, threshold: float | None, progress: Progress) -> Iterator[Patches]:
    """The patches, block by block, with progress."""
    from blendcap.makeup.patches import each_block

    done, lost, count = 0, 0, films[0].count
    pictures = [film.frames(grey=True) for film in films]
    radius = DOT * films[0].size[1]
    with progress.step("patches", f"Cut the patches of {count:,} frames", total=count) as tell:
        for block in each_block(
            pictures, setup.places, setup.anchors, films[0].rate, dots=setup.dots, dot_radius=radius,
            threshold=threshold,
        ):  # fmt: skip
            done, lost = done + len(block.sure), lost + int((block.sure < LOST).sum())
            tell(done)
            yield block
    if lost > OFTEN * done:
        log.warning(
            "In %d of %d frames half of the markers that hold the picture still, or more, were lost: patches may be "
            "beside the paint there, and are not trusted. Name markers that the cameras see well and that the face "
            "does not move: --stable.", lost, done,
        )  # fmt: skip


def table_of(path: Path | None) -> Mapping[str, Mapping[str, float]]:
    """From units to shapes, ARKit's if there is no file."""
    from blendcap.io.opening import read_json
    from blendcap.makeup.units import ARKIT_TABLE

    if path is None:
        return ARKIT_TABLE
    table = read_json(path)
    fits = isinstance(table, dict) and all(
        isinstance(shapes, dict) and all(isinstance(w, int | float) and 0 < w < math.inf for w in shapes.values())
        for shapes in table.values()
    )
    if not fits:
        raise blendcap.InputError(
            f"{path} must be a JSON object from units to shapes and their weights above 0, such as "
            '{"AU4": {"browLower_L": 1.0}}; leave a unit without a shape empty: {"AU4": {}}.'
        )
    return table


def check_shapes(rig: Rig, table: Mapping[str, Mapping[str, float]], units: Sequence[str]) -> None:
    """Say which units move shapes that the rig has not: a solve would refuse their curves."""
    from blendcap.data.names import match

    moved = [(shape, unit) for unit in units for shape in table.get(unit, {})]
    found = match([shape for shape, _ in moved], rig.names)
    lacking = [f"{shape} ({unit})" for shape, unit in moved if shape not in found]
    if lacking:
        log.warning(
            'The rig %r has no shape for what these units move, and a solve will refuse their curves: %s. Give --table '
            'with the rig\'s own shapes, or none for a unit that it lacks: {"AU1": {}}.', rig.name, ", ".join(lacking),
        )  # fmt: skip
