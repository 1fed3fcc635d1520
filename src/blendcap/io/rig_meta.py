"""What a rig knows beside its geometry, as plain JSON values: the one form that GLB and NPZ share."""

from __future__ import annotations

from typing import Any

import numpy as np

from blendcap.data import InputError, Rig, SurfacePoints
from blendcap.io.fans import run_lengths

VERSION = 1


def rig_meta(rig: Rig) -> dict[str, Any]:
    """Name, bounds, mirror, combinations, points, regions, contacts and polygon sizes of a rig."""
    polygons = rig.mesh.polygons
    return {
        "kind": "rig",
        "version": VERSION,
        "unit": "mm",
        "name": rig.name,
        "vertices": len(rig.mesh.vertices),
        "bounds": {n: b for n, b in zip(rig.names, rig.bounds.tolist(), strict=True) if b != [0.0, 1.0]},
        "mirror": {n: rig.names[m] for n, m in zip(rig.names, rig.mirror, strict=True) if rig.names[m] != n},
        "combinations": {corrective: list(drivers) for corrective, drivers in rig.combinations.items()},
        "points": {name: points_meta(points) for name, points in rig.points.items()},
        "regions": {name: vertices.tolist() for name, vertices in rig.regions.items()},
        "contacts": {name: pairs.tolist() for name, pairs in rig.contacts.items()},
        "polygons": None if polygons is None else run_lengths((polygons >= 0).sum(1)),
    }


def points_meta(points: SurfacePoints) -> dict[str, Any]:
    """Points on a surface as JSON values."""
    return {
        "names": list(points.names),
        "faces": points.faces.tolist(),
        "barycentric": points.barycentric.tolist(),
    }


def rig_fields(meta: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    """The keyword arguments of `Rig` that `rig_meta` wrote, for a rig with these shapes."""
    place = {name: i for i, name in enumerate(names)}
    bounds, mirror = np.tile([0.0, 1.0], (len(names), 1)), np.arange(len(names))
    for name, pair in meta.get("bounds", {}).items():
        bounds[_place(place, name)] = pair
    for name, other in meta.get("mirror", {}).items():
        mirror[_place(place, name)] = _place(place, other)
    return {
        "name": str(meta.get("name", "rig")),
        "bounds": bounds,
        "mirror": mirror,
        "combinations": {name: tuple(drivers) for name, drivers in meta.get("combinations", {}).items()},
        "points": {name: _points(entry) for name, entry in meta.get("points", {}).items()},
        "regions": {name: np.array(rows, np.int64) for name, rows in meta.get("regions", {}).items()},
        "contacts": {k: np.array(pairs, np.int64).reshape(-1, 2) for k, pairs in meta.get("contacts", {}).items()},
    }  # fmt: skip


def _points(entry: dict[str, Any]) -> SurfacePoints:
    names = tuple(entry["names"])
    return SurfacePoints(names, np.array(entry["faces"], np.int64), np.array(entry["barycentric"]).reshape(-1, 3))


def _place(place: dict[str, int], name: str) -> int:
    if name not in place:
        raise InputError(f"The rig's notes name the shape {name!r}, which it does not have; export it again.")
    return place[name]
