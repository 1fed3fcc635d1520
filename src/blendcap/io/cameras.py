"""Calibrated cameras as JSON: names, sizes of their pictures, lens and place."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping

import numpy as np

from blendcap.data import Camera, InputError
from blendcap.io.atomic import write_whole
from blendcap.io.opening import read_json, reading
from blendcap.io.units import millimetres

Cameras = dict[str, tuple[Camera, tuple[int, int]]]


def read_cameras(path: str | os.PathLike) -> Cameras:
    """Name -> camera and (width, height), in the order of the file.

    The form is `{"cameras": [{"name", "size": [w, h], "intrinsics": 3x3, "distortion": [k1, k2, p1, p2, k3], "pose":
    4x4}], "unit": "mm"}`: OpenCV's conventions, pose from world to camera, its translation in the unit (mm if not
    given). `distortion` may be left out.
    """
    with reading(path, "camera file"):
        content = read_json(path)
        entries = content.get("cameras") if isinstance(content, dict) else None
        if not isinstance(entries, list) or not entries:
            raise InputError(f'{path} must be a JSON object with a list "cameras" that is not empty.')
        unit_mm = millimetres(str(content.get("unit", "mm")), str(path))
        cameras = {str(entry["name"]): _camera(entry, unit_mm, str(path)) for entry in entries}
        if len(cameras) < len(entries):
            raise InputError(f"Two cameras in {path} have the same name; give each its own.")
    return cameras


def _camera(entry: Mapping, unit_mm: float, path: str) -> tuple[Camera, tuple[int, int]]:
    width, height = (int(n) for n in entry["size"])
    if not (0 < width <= 20000 and 0 < height <= 20000):
        raise InputError(f"A camera in {path} has pictures of {width} x {height} pixels, which cannot be.")
    distortion = np.array(entry.get("distortion", [0.0] * 5), dtype=np.float64)
    intrinsics, pose = np.array(entry["intrinsics"]), np.array(entry["pose"], dtype=np.float64)
    pose[:3, 3] *= unit_mm
    return Camera(intrinsics, pose, distortion), (width, height)


def write_cameras(path: str | os.PathLike, cameras: Cameras) -> None:
    """Write cameras in the form that `read_cameras` reads."""
    entries = [
        {"name": name, "size": list(size), "intrinsics": camera.intrinsics.tolist(),
         "distortion": camera.distortion.tolist(), "pose": camera.pose.tolist()}
        for name, (camera, size) in cameras.items()
    ]  # fmt: skip
    with write_whole(path) as temporary:
        temporary.write_text(json.dumps({"unit": "mm", "cameras": entries}, indent=1) + "\n", encoding="utf-8")
