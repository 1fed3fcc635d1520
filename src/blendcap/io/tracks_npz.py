"""Paint tracks as .npz: arrays and a JSON `meta` with the rate and the points' names."""

from __future__ import annotations

import os

import numpy as np

from blendcap.data import PaintTracks, SurfacePoints
from blendcap.io.models import read_model, write_model
from blendcap.io.opening import reading

KIND, VERSION = "paint tracks", 1


def write_tracks(path: str | os.PathLike, tracks: PaintTracks) -> None:
    """Write tracks to a .npz; positions in single precision, which is a ten-thousandth of a millimetre."""
    meta = {"rate": tracks.rate, "names": list(tracks.points.names)}
    write_model(
        path, KIND, VERSION, meta,
        {"faces": tracks.points.faces, "barycentric": tracks.points.barycentric, "cameras": tracks.cameras,
         "rest": tracks.rest, "positions": tracks.positions.astype(np.float32), "axes": tracks.axes},
    )  # fmt: skip


def read_tracks(path: str | os.PathLike) -> PaintTracks:
    """Read the tracks that `write_tracks` has written.

    Raises
    ------
    InputError
        If the file is none of them, or is damaged.
    """
    meta, arrays = read_model(path, KIND, VERSION)
    with reading(path, KIND):
        points = SurfacePoints(tuple(meta["names"]), arrays["faces"], arrays["barycentric"])
        cameras, rest, positions, axes = (arrays[name] for name in ("cameras", "rest", "positions", "axes"))
        return PaintTracks(points, cameras, rest, positions, axes, float(meta["rate"]))
