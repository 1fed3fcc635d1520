"""Points on a surface as JSON: marker sets and landmark embeddings."""

from __future__ import annotations

import json
import os

import numpy as np

from blendcap.data import InputError, SurfacePoints
from blendcap.data.names import mirror_name
from blendcap.io.atomic import write_whole
from blendcap.io.opening import read_json, reading


def read_points(path: str | os.PathLike) -> SurfacePoints:
    """Points from `{"rig": name, "points": [{"name", "face", "barycentric"}, ...]}`; other keys are for people."""
    with reading(path, "points file"):
        content = read_json(path)
        if not isinstance(content, dict) or not isinstance(content.get("points"), list) or not content["points"]:
            raise InputError(f'{path} must be a JSON object with a list "points" that is not empty.')
        entries = content["points"]
        names = tuple(str(entry["name"]) for entry in entries)
        barycentric = np.array([entry["barycentric"] for entry in entries], dtype=np.float64)
        return SurfacePoints(names, np.array([entry["face"] for entry in entries]), barycentric)


def write_points(path: str | os.PathLike, points: SurfacePoints, rig_name: str) -> None:
    """Write points with the name of the rig they belong to; `mirror` names the point of the other side."""
    entries = []
    for name, face, weights in zip(points.names, points.faces.tolist(), points.barycentric.tolist(), strict=True):
        other = mirror_name(name)
        mirror = {"mirror": other} if other != name and other in points.names else {}
        entries.append({"name": name, "face": face, "barycentric": weights, **mirror})
    with write_whole(path) as temporary:
        temporary.write_text(json.dumps({"rig": rig_name, "points": entries}, indent=1) + "\n", encoding="utf-8")
