"""Landmarks of a scan, found or given, and their partners on a template: by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.data.names import listed
from blendcap.modeling.landmark_checks import check_landmarks, far_off
from blendcap.modeling.landmark_names import ENDS, LINES, contact_of, line_names, rig_landmarks
from blendcap.modeling.landmarks import find_landmarks

MISLED = 1 / 3  # of the landmarks that were found: if more lie off, nobody knows which
FEWEST = 3  # landmarks that leave no turn open


def find_pairs(scan: Mesh, template: Rig) -> tuple[tuple[SurfacePoints, np.ndarray] | None, list[str]]:
    """Landmarks found on a scan, with their partners on the template; a sentence where none were.

    Returns
    -------
    pairs : (SurfacePoints (L), (L, 3) float64) or None
        Points on the template and where they are on the scan, as `register` takes them.
    notes : list of str
    """
    try:
        there, here = find_landmarks(scan), rig_landmarks(template)
    except InputError as error:
        return None, [f"No landmarks were found, so the template is aligned by its shape: {error}"]
    names = [name for name in here.names if name in there.names]
    if len(names) < FEWEST:
        return None, ["The template knows too few of the scan's landmarks, so it is aligned by its shape; give some."]
    _, odd = far_off(here.select(names).positions(template.mesh), there.select(names).positions(scan))
    lost = [name for name, off in zip(names, odd, strict=True) if off]
    kept = [name for name in names if name not in {*lost, *_on_lines_of(lost)}]
    if len(lost) > MISLED * len(names) or len(kept) < FEWEST:
        said = (
            "The landmarks that were found contradict each other, so the template is aligned by its shape; give some."
        )
        return None, [said]
    lines = ", with lines that end there" if len(lost) + len(kept) < len(names) else ""
    said = f"Landmarks left out, as they lie where the others do not put them: {listed(lost)}{lines}."
    return (here.select(kept), there.select(kept).positions(scan)), [said] if lost else []


def _on_lines_of(features: Sequence[str]) -> list[str]:
    """The points of the lines that end at one of these features."""
    return [name for line in LINES if set(ENDS[contact_of(line)[0]]) & set(features) for name in line_names(line)]


def check_pairs(template: Rig, pairs: tuple[SurfacePoints, np.ndarray], scan: Mesh) -> None:
    """Refuse pairs of landmarks that cannot be right, before the long work; see `check_landmarks`.

    Parameters
    ----------
    template : Rig
    pairs : (SurfacePoints (L), (L, 3) float64)
        Points on the template and where they are on the scan.
    scan : Mesh
        Made ready: its triangles face outwards.
    """
    points, places = pairs
    if len(places) < FEWEST:
        raise InputError(f"Only {len(places)} landmarks are given; give at least three, or none.")
    check_landmarks(points.names, points.positions(template.mesh), places, template.mesh, scan)


def partners(template: Rig, names: Sequence[str]) -> SurfacePoints:
    """The points of a template that are called so, in the order of `names`.

    Parameters
    ----------
    template : Rig
    names : sequence of str
        A point of any of the template's sets, `"30"` or `"nose_tip"`, or with its set, `"landmarks68/30"`.

    Raises
    ------
    InputError
        If a name is unknown, or stands for different places in two sets.
    """
    places = [_place(template.points, name) for name in names]
    return SurfacePoints(tuple(names), np.array([face for face, _ in places], dtype=np.int64),
                         np.array([weights for _, weights in places]).reshape(-1, 3))  # fmt: skip


def _place(sets: Mapping[str, SurfacePoints], name: str) -> tuple[int, np.ndarray]:
    group, _, short = name.rpartition("/")
    found = {key: points for key, points in sets.items() if short in points.names and group in ("", key)}
    if not found:
        known = ", ".join(f"{key} ({', '.join(points.names[:3])} ...)" for key, points in sets.items()) or "none"
        raise InputError(f"The template has no point named {name!r}; its points are {known}.")
    places = []
    for points in found.values():
        row = points.names.index(short)
        places.append((int(points.faces[row]), points.barycentric[row]))
    if any(face != places[0][0] or np.abs(weights - places[0][1]).max() > 1e-9 for face, weights in places[1:]):
        first, both = next(iter(found)), " and ".join(found)
        raise InputError(f"The template has {short!r} in {both}; write the set too, as in {first}/{short}.")
    return places[0]
