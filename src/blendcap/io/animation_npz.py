"""Animations as archives: every field, exactly."""

from __future__ import annotations

import os

import numpy as np

from blendcap.data import Animation
from blendcap.io.npz import read_kind, write_npz
from blendcap.io.opening import reading


def read_animation_npz(path: str | os.PathLike) -> Animation:
    """An animation from an archive that `write_animation_npz` wrote."""
    with reading(path, "animation archive"):
        meta, arrays = read_kind(path, "animation")
        names = tuple(str(name) for name in arrays["names"])
        notes = {str(k): str(v) for k, v in meta.get("meta", {}).items()}
        optional = (arrays.get("head"), arrays.get("confidence"), arrays["times"])
        return Animation(arrays["weights"], names, meta["rate"], *optional, notes)


def write_animation_npz(path: str | os.PathLike, animation: Animation) -> None:
    """Write an animation as an archive."""
    meta = {"kind": "animation", "version": 1, "rate": animation.rate, "meta": dict(animation.meta)}
    write_npz(
        path,
        meta,
        names=np.array(animation.names, dtype=np.str_),
        weights=animation.weights,
        times=animation.times,
        head=animation.head,
        confidence=animation.confidence,
    )
