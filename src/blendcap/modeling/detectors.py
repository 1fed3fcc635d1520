"""The trained detectors that come with blendcap."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np

from blendcap.data import InputError, LandmarkModel

VERSION = 1


class Detectors(NamedTuple):
    """What finds features, points of the lines, and whole faces; the last only where pictures have no fixed layout."""

    points: LandmarkModel
    lines: LandmarkModel | None = None
    face: LandmarkModel | None = None


@cache
def shipped(kind: str) -> Detectors:
    """The detectors for a kind of picture: "front" (texture and form), "form", "uv" (the thesis' way)."""
    path = resources.files("blendcap.modeling") / "landmarks.npz"
    with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
        if json.loads(str(stored["meta"])).get("version") != VERSION:
            raise InputError("The detectors that came with blendcap are of another version; install it again.")
        parts = {}
        for part in Detectors._fields:
            start = f"{kind}/{part}/"
            arrays = {name.removeprefix(start): stored[name] for name in stored.files if name.startswith(start)}
            parts[part] = LandmarkModel.from_arrays(arrays) if arrays else None
    return Detectors(**parts)
