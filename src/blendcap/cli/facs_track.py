"""blendcap facs track VIDEO...: the paint itself, followed between the markers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines
from blendcap.cli.facs_inputs import Filmed, Stage, stage
from blendcap.cli.outputs import PICTURES, check_outputs
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from blendcap.data import PaintTracks

TRACKS, VIDEOS = (".npz",), (".mp4",)


def track(
    videos: Annotated[tuple[Path, ...], Parameter(negative=(), show_default=False)],
    /,
    *,
    filmed: Filmed,
    take: Path,
    output: Annotated[Path, Parameter(name=("--output", "-o"))],
    patches: Path | None = None,
    overlay: Path | None = None,
    picture: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Follow the paint, and all else on the skin that has contrast, from picture to picture; no lesson is needed.

    Parameters
    ----------
    videos
        The head cameras' videos, one a camera and in their order. They begin with the take, on a neutral face.
    take
        The markers of the same performance: .c3d, .trc or .csv.
    output
        The tracks to write, for `solve --tracks`: .npz.
    patches
        The curves from `facs predict`, if there are any: they tell where to look for lids that shut.
    overlay
        A .mp4 of the cameras with the points drawn on.
    picture
        A .png of the frame in which they have moved most, as the overlay has it: do they sit on paint and skin?
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import read_animation, write_tracks
    from blendcap.makeup.setup import check_unit

    for path, endings in ((output, TRACKS), (overlay, VIDEOS), (picture, PICTURES)):
        check_outputs([path], endings, (*videos, take, patches, filmed.cameras, filmed.rig, filmed.correspondences))
    progress = Progress(quiet=as_json)
    with progress.step("read", "Read the rig and the take"):
        curves = None if patches is None else read_animation(patches)
        staged = stage(videos, take, filmed)
        if "landmarks68" in staged.rig.points:
            check_unit(staged.rig, staged.binding, staged.cameras, [film.size for film in staged.films])
    with progress.step("solve", "Solve the markers, to know where to look") as tell:
        settings = blendcap.SolveSettings(head="keep")
        first = blendcap.solve(
            staged.rig, staged.take, staged.binding, patches=curves, settings=settings, progress=tell
        )  # fmt: skip
    count = sum(film.count for film in staged.films)
    with progress.step("track", f"Follow the paint in {count:,} pictures", total=count) as tell:
        tracks = blendcap.track_paint(
            staged.pictures(), staged.rig, staged.take, staged.binding, staged.cameras, first, progress=tell
        )
    with progress.step("write", f"Write {output}"):
        write_tracks(output, tracks)
    _show(staged, tracks, overlay, picture, progress)
    (print_json if as_json else print_lines)(_facts(tracks, len(staged.films)) | {"seconds": progress.seconds})


def _facts(tracks: PaintTracks, cameras: int) -> dict[str, Any]:
    """How many points there are, how often they were found, and in which frame least."""
    found = 1 - tracks.lost.mean(1)
    return {
        "frames": len(tracks.positions),
        "points": len(tracks.points.names),
        "points_per_camera": [int((tracks.cameras == view).sum()) for view in range(cameras)],
        "found": float(found.mean()),
        "found_least": float(found.min()),
        "found_least_frame": int(found.argmin()),
    }


def _show(staged: Stage, tracks: PaintTracks, overlay: Path | None, picture: Path | None, progress: Progress) -> None:
    """The overlay and the picture, if they were asked for."""
    from blendcap.view.tracks_film import write_tracks_film, write_tracks_picture

    if overlay is not None:
        with progress.step("overlay", f"Write {overlay}", total=len(tracks.positions)) as tell:
            write_tracks_film(overlay, staged.pictures(), staged.cameras, tracks, progress=tell)
    if picture is not None:
        with progress.step("picture", f"Write {picture}"):
            write_tracks_picture(picture, staged.pictures(), staged.cameras, tracks)
