"""Attach the markers of a performer to a rig (2016 paper, section 6; thesis, section 4.1.2)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from blendcap.data import Binding, InputError, MarkerTake, Rig, SurfacePoints
from blendcap.data.names import listed
from blendcap.markers.cleaning import neutral_frame
from blendcap.markers.correspondences import resolve
from blendcap.markers.neighbors import candidates, seamless
from blendcap.markers.places import find_places
from blendcap.markers.refinement import CLICK, FOUND, Places, algorithm_4, motion_places, surface_places
from blendcap.markers.stabilization import stabilize
from blendcap.solving.shares import in_shares

log = logging.getLogger(__name__)

METHODS = ("weighed", "paper", "given")
TRIANGLES = 120  # Q: candidates of each marker
FEWEST = 4  # markers
FARTHEST = 20.0  # mm: median distance from marker to place that no face explains
USUAL_SIZE = (0.7, 1.4)  # of the rig beside the performer; beyond it a unit is wrong


def bind(
    rig: Rig,
    take: MarkerTake,
    correspondences: Mapping[str, Any] | SurfacePoints | None = None,
    range_of_motion: MarkerTake | None = None,
    *,
    method: str = "weighed",
    radius: float = 8.0,
    neutral: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Binding:
    """Attach the markers of a take to a rig.

    Parameters
    ----------
    rig : Rig
    take : MarkerTake
        Begins with the neutral face, as in the paper, unless there is a range of motion.
    correspondences : {label: place} or SurfacePoints, optional
        Places on the rig for the markers, or for those that shall be used. If not given they are found: the neutral
        markers are laid on the face from many starts. Look at the picture before you trust that.
    range_of_motion : MarkerTake, optional
        A take of the same markers that begins with the neutral and moves all of the face. Its neutral is used, and
        the places are refined by how well the markers' motion fits, and the neutral by all frames in which a marker is
        back at rest.
    method : {"weighed", "paper", "given"}
        How places are refined within `radius` of where they were given. "weighed": place, neutral position and motion
        count by how much each can tell. "paper": Algorithm 4. "given": not at all.
    radius : float
        How far a marker may move from its given place, mm along the surface; never across the mouth or a lid slit.
    neutral : int
        First frame of the neutral face.
    progress : callable
        Told what begins.

    Returns
    -------
    Binding
        `errors` holds the mean marker error over the range of motion after every pass, mm.

    Raises
    ------
    InputError
        If a label is unknown, a point belongs to another mesh, a marker is missing throughout, fewer than four markers
        are left, or the method needs a range of motion and there is none.
    """
    if method not in METHODS:
        raise InputError(f"The binding method {method!r} is unknown; choose one of {', '.join(METHODS)}.")
    if method == "paper" and range_of_motion is None:
        raise InputError("The paper's binding needs a range-of-motion take; give one or use the method 'weighed'.")
    rig = in_shares(rig)
    source = range_of_motion if range_of_motion is not None else take
    given = _given_places(rig, source, correspondences, neutral, progress)
    given, source, rest = _at_rest(given, source, neutral)
    if range_of_motion is not None and method != "given":
        _, source = stabilize(source, frame=neutral)
    progress("placing the markers on the skin")
    places = Places(rig, given.names, candidates(seamless(rig), given, radius, TRIANGLES))
    errors, shift = np.array([]), 0.0
    if method == "paper":
        points, alignment, errors = algorithm_4(places, given, source, rest)
    else:
        click = 0.0 if method == "given" else FOUND if correspondences is None else CLICK
        points, alignment, deviation = surface_places(places, given, rest, click)
        if range_of_motion is not None and click > 0:
            progress("matching the markers' motion")
            points, shift, errors = motion_places(places, points, alignment, source, rest, deviation)
    offsets = alignment(rest) + shift - points.positions(rig.mesh)
    _check_fit(offsets, _extent(rest) / _extent(points.positions(rig.mesh)))
    _warn(alignment.scale, correspondences is None)
    return Binding(
        points, alignment.rotation, alignment.translation, alignment.scale, offsets, errors, correspondences is None
    )


def _extent(positions: np.ndarray) -> float:
    """How far points (M, 3) are from their middle, root mean square, mm: whatever their labels."""
    return float(np.sqrt(((positions - positions.mean(0)) ** 2).sum(1).mean()))


def _check_fit(offsets: np.ndarray, size: float) -> None:
    away = float(np.median(np.linalg.norm(offsets, axis=1)))
    if away > FARTHEST and not USUAL_SIZE[0] < 1 / size < USUAL_SIZE[1]:
        raise InputError(
            f"The take is {size:.3g} times as large as the rig and does not fit it, so its unit is wrong or these "
            "are no markers of a face; say the unit, or check the labels and the correspondences."
        )
    if away > FARTHEST:
        raise InputError(
            f"Half of the markers lie more than {away:.0f} mm off their places on the rig, so they are not markers of "
            "this face: check the take, its labels and the correspondences."
        )


def _warn(scale: float, found: bool) -> None:
    if not USUAL_SIZE[0] < scale < USUAL_SIZE[1]:
        log.warning(
            "The take is %.3g times as large as the rig, as if its unit were wrong: check that. It is scaled to fit.",
            1 / scale,
        )  # fmt: skip
    if found:
        log.warning("The markers' places were found automatically: look at the picture before you trust the answer.")


def _given_places(
    rig: Rig, take: MarkerTake, correspondences: Mapping[str, Any] | SurfacePoints | None, neutral: int, progress
) -> SurfacePoints:
    if correspondences is None:
        progress("finding the markers' places on the face")
        return find_places(rig, take, frame=neutral)
    if isinstance(correspondences, SurfacePoints):
        take.select(correspondences.names)  # says which label is unknown
        correspondences.matrix(rig.mesh)  # says which point lies on no face of the rig
        return correspondences
    given = resolve(rig, correspondences, take.names)
    unused = [name for name in take.names if name not in given.names]
    if unused:
        log.warning("%d markers have no correspondence and are left out: %s", len(unused), listed(unused))
    return given


def _at_rest(given: SurfacePoints, source: MarkerTake, neutral: int) -> tuple[SurfacePoints, MarkerTake, np.ndarray]:
    """The places, the take and the neutral (M, 3) of the markers seen at rest."""
    source = source.select(given.names)
    lost = source.missing.all(0)
    if lost.any():
        name = source.names[int(lost.argmax())]
        raise InputError(
            f"The marker {name!r} is missing in every frame; take it out of the correspondences or repair the take."
        )
    rest = neutral_frame(source, neutral)
    seen = np.isfinite(rest[:, 0])
    if not seen.all():
        hidden = [name for name, there in zip(source.names, seen, strict=True) if not there]
        log.warning("%d markers are not seen in the neutral and are left out: %s", len(hidden), listed(hidden))
    names = [name for name, there in zip(source.names, seen, strict=True) if there]
    if len(names) < FEWEST:
        raise InputError(f"Only {len(names)} markers can be placed; a binding needs at least {FEWEST}.")
    return given.select(names), source.select(names), rest[seen]
