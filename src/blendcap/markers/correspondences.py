"""From a user's table of marker labels to points on the rig's surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any

import numpy as np

from blendcap.data import InputError, Rig, SurfacePoints

ROUNDED = 1e-3  # how far from 1 weights may sum that somebody typed or rounded


def resolve(rig: Rig, correspondences: Mapping[str, Any], labels: Sequence[str] | None = None) -> SurfacePoints:
    """Points on the rig, one for each entry of a correspondence table, in the table's order.

    Parameters
    ----------
    rig : Rig
    correspondences : {label: place}
        A place is a vertex number of the rig (`4321`), a named point that comes with the rig (`"landmarks68/30"`), or
        `{"face": 17, "barycentric": [0.2, 0.3, 0.5]}`.
    labels : sequence of str, optional
        The markers of the take; if given, the table may name no other.

    Raises
    ------
    InputError
        If the table is empty, names an unknown marker, or a place is not on the rig.
    """
    if not correspondences:
        raise InputError("The correspondences are empty; give at least four markers a place on the rig.")
    if labels is not None:
        unknown = [label for label in correspondences if label not in labels]
        if unknown:
            raise InputError(
                f"The correspondences name the marker {unknown[0]!r}, which the take does not have; "
                f"it has {', '.join(list(labels)[:8])} ..."
            )
    places = [_place(rig, label, place) for label, place in correspondences.items()]
    faces = np.array([face for face, _ in places], dtype=np.int64)
    return SurfacePoints(tuple(correspondences), faces, np.array([weights for _, weights in places]))


def _place(rig: Rig, label: str, place: Any) -> tuple[int, np.ndarray]:
    if isinstance(place, Integral) and not isinstance(place, bool):
        return _vertex(rig, label, int(place))
    if isinstance(place, str):
        return _named(rig, label, place)
    if isinstance(place, Mapping):
        return _barycentric(rig, label, place)
    raise InputError(
        f"The place of marker {label!r} in the correspondences is {place!r}; give a vertex number, a named point such "
        'as "landmarks68/30", or {"face": 17, "barycentric": [0.2, 0.3, 0.5]}.'
    )


def _vertex(rig: Rig, label: str, vertex: int) -> tuple[int, np.ndarray]:
    count = len(rig.mesh.vertices)
    if not 0 <= vertex < count:
        raise InputError(
            f"The correspondences put marker {label!r} on vertex {vertex}, but the rig's are 0 to {count - 1}; "
            "use the vertex numbers of the rig file as it is read."
        )
    point = SurfacePoints.at_vertices([label], [vertex], rig.mesh)
    return int(point.faces[0]), point.barycentric[0]


def _named(rig: Rig, label: str, place: str) -> tuple[int, np.ndarray]:
    group, _, name = place.partition("/")
    if group not in rig.points:
        known = ", ".join(rig.points) or "none"
        raise InputError(
            f"The correspondences put marker {label!r} on {place!r}, but the rig has no point set {group!r}; "
            f"it has {known}."
        )
    points = rig.points[group]
    if name not in points.names:
        raise InputError(
            f"The correspondences put marker {label!r} on {place!r}, but {group!r} has no point {name!r}; "
            f"it has {', '.join(points.names[:8])} ..."
        )
    row = points.names.index(name)
    return int(points.faces[row]), points.barycentric[row]


def _barycentric(rig: Rig, label: str, place: Mapping[str, Any]) -> tuple[int, np.ndarray]:
    where = f"The place of marker {label!r} in the correspondences"
    face, weights = place.get("face"), place.get("barycentric")
    count = len(rig.mesh.faces)
    if not isinstance(face, Integral) or isinstance(face, bool) or not 0 <= int(face) < count:
        raise InputError(f"{where} needs a face from 0 to {count - 1}, but has {face!r}.")
    try:
        array = np.asarray(weights, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != (3,) or not (array >= -1e-6).all() or abs(array.sum() - 1) > ROUNDED:
        raise InputError(f"{where} needs three barycentric weights from 0 that sum to 1, but has {weights!r}.")
    array = np.maximum(array, 0)
    return int(face), array / array.sum()
