"""Shots on disk: a film or a photograph, and beside it the truth."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from blendcap.data import InputError, MarkerTake
from blendcap.io import write_animation, write_image, write_markers, write_video
from blendcap.io.cameras import write_cameras
from blendcap.io.npz import write_npz
from blendcap.io.video_write import FOR_PROGRAMS
from blendcap.synthetic.shot import Shot
from blendcap.synthetic.unit_curves import unit_curves


def write_shots(folder: str | os.PathLike, shots: Iterable[Shot], take: MarkerTake | None = None) -> list[Path]:
    """Write what cameras saw together, and return the files.

    For each shot NAME.mp4 (H.264 at a constant rate factor of 8, which moves the middle of a dot by some hundredths of
    a pixel) or, of a single frame, NAME.png; and NAME.npz with
    the truth: `intrinsics`, `distortion`, `pose`, `placement` (T, 4, 4), `landmarks` (T, 68, 2), `landmarks_3d`,
    `landmarks_visible`, `dots`, `dots_3d`, `dots_visible`, and the lights as `light_...`. Once for all: cameras.json
    (as `facs` reads it), animation.npz (weights and head), action_units.npz, and markers.c3d if there is a take.

    Raises
    ------
    InputError
        If the folder does not exist or a file cannot be written.
    """
    folder, files, cameras, first = Path(folder), [], {}, None
    if not folder.is_dir():
        raise InputError(f"Cannot write to {folder}: there is no such folder; create it first.")
    for shot in shots:
        first = first or shot
        picture = folder / (shot.name + (".png" if shot.count == 1 else ".mp4"))
        if shot.count == 1:
            write_image(picture, next(shot.frames()))
        else:
            write_video(picture, shot.frames(), shot.rate, shot.size, loss=FOR_PROGRAMS)
        files += [picture, folder / f"{shot.name}.npz"]
        _write_truth(files[-1], shot)
        cameras[shot.name] = shot.camera, shot.size
    if first is not None:
        files += [folder / "cameras.json", folder / "animation.npz", folder / "action_units.npz"]
        write_cameras(files[-3], cameras)
        write_animation(files[-2], first.animation)
        write_animation(files[-1], unit_curves(first.animation))
    if take is not None:
        files.append(folder / "markers.c3d")
        write_markers(files[-1], take)
    return files


def _write_truth(path: Path, shot: Shot) -> None:
    meta = {
        "kind": "shot", "version": 1, "name": shot.name, "size": shot.size, "rate": shot.rate, "unit": "mm",
        "exposure": shot.exposure, "landmarks": shot.landmarks.names,
        "dots": shot.markers.names if shot.markers else [],
    }  # fmt: skip
    arrays: dict[str, np.ndarray] = {
        "intrinsics": shot.camera.intrinsics, "distortion": shot.camera.distortion, "pose": shot.camera.pose,
        "placement": shot.placement,
    }  # fmt: skip
    for kind, seen in (("landmarks", shot.landmarks), ("dots", shot.markers)):
        if seen is not None:
            arrays |= {kind: seen.pixels, f"{kind}_3d": seen.positions, f"{kind}_visible": seen.visible}
    write_npz(path, meta, **arrays, **{f"light_{name}": np.asarray(value) for name, value in shot.lights.items()})
