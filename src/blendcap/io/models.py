"""Learned models as .npz: arrays and a JSON `meta` with kind and version."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from blendcap.data import InputError
from blendcap.io.npz import read_kind, write_npz
from blendcap.io.opening import reading


def write_model(
    path: str | os.PathLike, kind: str, version: int, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write a model of a kind (`"patch classifier"`) and the version of its form."""
    if not str(path).lower().endswith(".npz"):
        raise InputError(f"Cannot write a model to {path}: end its name with .npz.")
    write_npz(path, {"kind": kind, "version": version, **meta}, **arrays)


def read_model(path: str | os.PathLike, kind: str, version: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The meta and the arrays of a model; refuses a file of another kind, or of a version that is not known."""
    with reading(path, "model"):
        meta, arrays = read_kind(path, kind)
        if meta.get("version") != version:
            raise InputError(
                f"{path} is a {kind} of version {meta.get('version')!r}, but {version} is read here; make it anew."
            )
    return meta, arrays
