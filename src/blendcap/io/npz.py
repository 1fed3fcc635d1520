"""NumPy archives: arrays and one JSON string `meta`, without pickle and without trusting declared sizes."""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.lib import format as npy

from blendcap.data import InputError
from blendcap.io.atomic import write_whole
from blendcap.io.opening import existing_file, parse_json, reading

_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError)  # what zipfile raises on damage
_MOST_SQUEEZED = 1100  # deflate cannot squeeze more than about 1:1032


def read_npz(path: str | os.PathLike, only: str | None = None) -> dict[str, np.ndarray]:
    """All arrays of an archive by name, or the one; sizes are checked before memory is asked for, objects refused."""
    path = existing_file(path)
    with reading(path, ".npz archive"):
        try:
            with zipfile.ZipFile(path) as archive:
                return {
                    entry.filename.removesuffix(".npy"): _read_array(archive, entry)
                    for entry in archive.infolist()
                    if entry.filename.endswith(".npy") and only in (None, entry.filename.removesuffix(".npy"))
                }
        except _BROKEN as error:
            raise InputError(
                f"Cannot read {path}: it is no whole .npz archive ({error}); copy it again, or make it anew."
            ) from error


def read_kind(path: str | os.PathLike, kind: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The meta and the arrays of an archive of a kind (`"rig"`); refuses a file of another."""
    arrays = read_npz(path)
    meta = read_meta(arrays, path)
    if meta.get("kind") != kind:
        raise InputError(
            f"{path} holds no {kind} of ours (its meta says {meta.get('kind', 'nothing')!r}); give the file of one."
        )
    arrays.pop("meta", None)
    return meta, arrays


def read_meta(arrays: dict[str, np.ndarray], path: str | os.PathLike) -> dict[str, Any]:
    """The JSON object `meta` of an archive; empty if there is none."""
    if "meta" not in arrays:
        return {}
    meta = parse_json(str(arrays["meta"]), f"meta of {path}")
    if not isinstance(meta, dict):
        raise InputError(f"Cannot read {path}: its meta is no JSON object.")
    return meta


def write_npz(path: str | os.PathLike, meta: dict[str, Any], **arrays: np.ndarray | None) -> None:
    """Write arrays (None: left out) and `meta` as a compressed archive."""
    kept = {name: values for name, values in arrays.items() if values is not None}
    with write_whole(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, meta=np.array(json.dumps(meta)), **kept)  # pyright: ignore[reportArgumentType]


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> np.ndarray:
    if entry.file_size > _MOST_SQUEEZED * max(entry.compress_size, 1):
        raise InputError(f"The array {entry.filename!r} declares {entry.file_size} bytes, which cannot be true.")
    content = archive.read(entry)
    stream = io.BytesIO(content)
    version = npy.read_magic(stream)
    header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = header(stream)
    if dtype.hasobject:
        raise InputError(f"The array {entry.filename!r} holds pickled objects, which are never loaded.")
    if math.prod(shape) * dtype.itemsize != len(content) - stream.tell():
        raise InputError(
            f"The array {entry.filename!r} declares {shape} of {dtype}, but has other data; save it again."
        )
    return npy.read_array(io.BytesIO(content), allow_pickle=False)


def npz_names(path: str | os.PathLike) -> set[str]:
    """The names of the arrays in an archive."""
    path = existing_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except _BROKEN as error:
        raise InputError(
            f"Cannot read {path}: it is no whole .npz archive ({error}); copy it again, or make it anew."
        ) from error
