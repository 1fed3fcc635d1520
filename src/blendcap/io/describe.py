"""What a file holds, in a few facts."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from blendcap.data import Animation, InputError, MarkerTake, Mesh, Rig
from blendcap.io import formats
from blendcap.io.animation_csv import animation_of_table
from blendcap.io.cameras import read_cameras
from blendcap.io.correspondences import read_correspondences
from blendcap.io.gltf import open_document
from blendcap.io.livelink import animation_of_live_link, is_live_link
from blendcap.io.marker_csv import is_marker_table, take_of_table
from blendcap.io.npz import npz_names, read_meta, read_npz
from blendcap.io.opening import existing_file, read_json, reading
from blendcap.io.points_json import read_points
from blendcap.io.tables import read_table
from blendcap.io.turns import COLUMNS, read_turns
from blendcap.io.units import is_unit
from blendcap.io.video import read_video

FIRST = 10  # frames in which a take is neutral
FILMS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".gif")
Record = Rig | Mesh | MarkerTake | Animation


def read_any(path: str | os.PathLike, unit: str | None = None) -> Record:
    """The record that a file holds, whatever it is: a rig, a mesh, markers or an animation.

    `unit` is its unit of length, in place of what the file states.
    """
    path = Path(path)
    if path.is_dir():
        return formats.read_rig(path, unit)
    kind = existing_file(path).suffix.lower()
    if kind == ".csv":
        return _table_record(path, unit)
    if kind == ".npz":
        return formats.read_animation(path) if "weights" in npz_names(path) else formats.read_rig(path, unit)
    if kind in formats.GLTF:
        return (formats.read_rig if _has_targets(path) else formats.read_mesh)(path, unit)
    if kind in formats.READ["markers"]:
        return formats.read_markers(path, unit)
    if kind in formats.READ["mesh"]:
        return formats.read_mesh(path, unit)
    known = "; ".join(f"{record} {', '.join(endings)}" for record, endings in formats.READ.items())
    raise InputError(
        f"{path} has an ending that is not known: {known}; video {', '.join(FILMS)}; cameras and places .json. "
        "A rig may be a folder of .obj too."
    )


def describe(
    path: str | os.PathLike, unit: str | None = None, *, of_take: Callable[[MarkerTake], dict[str, Any]] = lambda _: {}
) -> dict[str, Any]:
    """What a file holds, ready for JSON.

    `kind` is rig, mesh, markers, animation, video, cameras, points, places, turns or model.

    Parameters
    ----------
    path : path
    unit : str, optional
        Unit of length of a rig, a mesh or markers, in place of what the file states.
    of_take : callable
        What else is to be said of a marker take.

    Raises
    ------
    InputError
        If there is no such file, it is broken, none of these, or has no lengths that a unit could be given for.
    """
    facts = _facts(path, unit, of_take)
    if unit is not None and facts["kind"] not in ("rig", "mesh", "markers"):
        raise InputError(f"{path} holds no lengths that --unit (unit=) could change; leave it out.")
    return facts


def _facts(path: str | os.PathLike, unit: str | None, of_take: Callable[[MarkerTake], dict]) -> dict[str, Any]:
    kind = Path(path).suffix.lower()
    if kind in FILMS:
        return _film(path)
    if kind == ".json":
        return _notes(path)
    if kind == ".npz" and (model := _model(path)):
        return model
    if kind in formats.MARKERS and (kind != ".csv" or _holds_markers(path)):
        return _take(path, unit, of_take)
    if kind == ".csv" and _holds_turns(path):
        return _turns(path)
    record = read_any(path, unit)
    if isinstance(record, Rig):
        return {"kind": "rig", "name": record.name, "shapes": list(record.names), "points": {k: len(v.names) for k, v in
                record.points.items()}, "regions": sorted(record.regions), "contacts": sorted(record.contacts),
                **_surface(record.mesh)}  # fmt: skip
    if isinstance(record, Mesh):
        return {"kind": "mesh", **_surface(record)}
    assert isinstance(record, Animation)
    return {"kind": "animation", "frames": len(record.weights), "rate": record.rate,
            "seconds": float(record.times[-1] - record.times[0]) + 1 / record.rate, "shapes": list(record.names),
            "missing": float(np.isnan(record.weights).mean()), "head": record.head is not None,
            "meta": dict(record.meta)}  # fmt: skip


def _holds_markers(path: str | os.PathLike) -> bool:
    with reading(path, "CSV file"):
        table = read_table(path)
        return not is_live_link(table) and is_marker_table(table)


def _holds_turns(path: str | os.PathLike) -> bool:
    with reading(path, "CSV file"):
        return set(COLUMNS) <= set(read_table(path).header)


def _turns(path: str | os.PathLike) -> dict[str, Any]:
    """What a performer shows in a lesson: how often each unit, and until when."""
    turns = read_turns(path)
    units = [unit for _, _, unit in turns]
    return {"kind": "turns", "showings": len(turns), "seconds": max(end for _, end, _ in turns),
            "units": {unit: units.count(unit) for unit in dict.fromkeys(units)}}  # fmt: skip


def _take(path: str | os.PathLike, unit: str | None, of_take: Callable[[MarkerTake], dict]) -> dict[str, Any]:
    """A marker take; `size` is what its first frames span, in mm if its unit is known, else in the file's own."""
    stated = formats.unit_of_markers(path)
    known = unit is not None or is_unit(stated)
    take = formats.read_markers(path, unit if known else "mm")
    seen = take.positions[:FIRST][np.isfinite(take.positions[:FIRST]).all(2)]
    lost = take.missing.mean(0)
    gaps = {take.names[m]: float(lost[m]) for m in np.argsort(-lost, kind="stable") if lost[m] > 0}
    return {"kind": "markers", "frames": len(take.positions), "rate": take.rate,
            "seconds": len(take.positions) / take.rate, "file_unit": stated or None, "unit": "mm" if known else None,
            "size": _size(seen) if len(seen) else None, "markers": list(take.names), "missing": float(lost.mean()),
            "missing_of_marker": gaps, "timecode": take.timecode, **of_take(take)}  # fmt: skip


def _film(path: str | os.PathLike) -> dict[str, Any]:
    video = read_video(path)
    seconds = video.count / video.rate
    return {"kind": "video", "frames": video.count, "rate": video.rate, "seconds": seconds, "size": list(video.size),
            "unit": "pixels"}  # fmt: skip


def _notes(path: str | os.PathLike) -> dict[str, Any]:
    """Cameras, points, or places of markers."""
    with reading(path, "JSON file"):
        content = read_json(path)
        if isinstance(content, dict) and "cameras" in content:
            return {"kind": "cameras", "cameras": {name: list(size) for name, (_, size) in read_cameras(path).items()}}
        if isinstance(content, dict) and isinstance(content.get("points"), list):
            return {"kind": "points", "rig": content.get("rig"), "points": list(read_points(path).names)}
    return {"kind": "places", "markers": list(read_correspondences(path))}


def _model(path: str | os.PathLike) -> dict[str, Any] | None:
    """Kind, version and action units, if it tells such, of an archive of ours that is neither rig nor animation."""
    meta = read_meta(read_npz(path, "meta"), path)
    if meta.get("kind") in (None, "rig", "animation"):
        return None
    units = meta.get("units")
    told = {"units": [str(unit) for unit in units]} if isinstance(units, list) else {}
    return {"kind": "model", "of": meta["kind"], "version": meta.get("version"), **told,
            "arrays": sorted(npz_names(path))}  # fmt: skip


def _surface(mesh: Mesh) -> dict[str, Any]:
    return {"vertices": len(mesh.vertices), "faces": len(mesh.faces), "uv": mesh.uv is not None,
            "texture": mesh.texture is not None, "size": _size(mesh.vertices), "unit": "mm"}  # fmt: skip


def _size(points: np.ndarray) -> list[float]:
    """The box of points (K, 3) along x, y and z."""
    box = np.ptp(points, axis=0) if len(points) else np.zeros(3)
    return [round(float(side), 3) for side in box]


def _has_targets(path: Path) -> bool:
    with reading(path, "glTF file"):
        meshes = open_document(path).json.get("meshes", [])
        return any(primitive.get("targets") for mesh in meshes for primitive in mesh["primitives"])


def _table_record(path: Path, unit: str | None) -> MarkerTake | Animation:
    with reading(path, "CSV file"):
        table = read_table(path)
        if is_live_link(table):
            return animation_of_live_link(table)
        return take_of_table(table, unit) if is_marker_table(table) else animation_of_table(table)
