"""Correspondences: which place of a rig each marker belongs to, as JSON."""

from __future__ import annotations

import json
import os
from typing import Any

from blendcap.data import InputError, SurfacePoints
from blendcap.io.atomic import write_whole
from blendcap.io.opening import read_json

Place = int | str | dict[str, Any]


def read_correspondences(path: str | os.PathLike) -> dict[str, Place]:
    """Marker label -> place, checked for form only; what a place means depends on the rig.

    A place is a vertex number (`4321`), a named point (`"landmarks68/30"`), or a point of a triangle
    (`{"face": 17, "barycentric": [0.2, 0.3, 0.5]}`).
    """
    entries = read_json(path)
    if not isinstance(entries, dict) or not entries:
        raise InputError(
            f'Cannot read {path}: it must be a JSON object {{"marker": place, ...}} with a place a marker.'
        )
    for label, place in entries.items():
        if not _is_place(place):
            raise InputError(
                f"Cannot read {path}: the place of {label!r} is {str(place)[:60]!r}; use a vertex number, a point name "
                'such as "landmarks68/30", or {"face": 17, "barycentric": [0.2, 0.3, 0.5]}.'
            )
    return entries


def write_correspondences(path: str | os.PathLike, points: SurfacePoints) -> None:
    """Write where each marker sits, as `read_correspondences` reads it: to correct by hand, or to use again."""
    places = {
        label: json.dumps({"face": face, "barycentric": _rounded(weights)})
        for label, face, weights in zip(points.names, points.faces.tolist(), points.barycentric.tolist(), strict=True)
    }
    lines = ",\n".join(f" {json.dumps(label)}: {place}" for label, place in places.items())
    with write_whole(path) as temporary:
        temporary.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")


def _rounded(weights: list[float]) -> list[float]:
    """Six digits each, and still 1 in all: the largest takes up what rounding left."""
    short = [round(weight, 6) for weight in weights]
    largest = short.index(max(short))
    short[largest] = round(short[largest] + 1 - sum(short), 6)
    return short


def _is_place(place: Any) -> bool:
    if isinstance(place, dict):
        weights = place.get("barycentric")
        return (
            set(place) == {"face", "barycentric"}
            and _is_index(place["face"])
            and isinstance(weights, list)
            and len(weights) == 3
            and all(isinstance(w, int | float) and not isinstance(w, bool) for w in weights)
            and abs(sum(weights) - 1) < 1e-3
        )
    return bool(place) if isinstance(place, str) else _is_index(place)


def _is_index(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
