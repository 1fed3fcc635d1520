"""The normal maps of shapes as PNG files in a folder beside a rig's GLB, with a manifest: glTF has no place for them.

`face.glb` has its maps in `face.normals/`: `manifest.json` says which file belongs to which shape and to which GLB.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import secrets
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from blendcap.data import InputError, Rig
from blendcap.io.opening import read_bytes, read_json, reading

VERSION = 1
MANIFEST = "manifest.json"

_log = logging.getLogger(__name__)


def normals_folder(path: str | os.PathLike) -> Path:
    """Where the maps of the rig at `path` lie."""
    return Path(path).with_suffix(".normals")


def write_normal_maps(path: str | os.PathLike, rig: Rig) -> None:
    """Write the maps of the rig whose GLB stands at `path` already; without maps, remove the folder of an older rig.

    The folder is written beside its place and takes it in one step.
    """
    folder = normals_folder(path)
    if not rig.normal_maps:
        if (folder / MANIFEST).exists():
            shutil.rmtree(folder)
        return
    temporary = folder.with_name(f".{secrets.token_hex(6)}.{folder.name}")
    try:
        temporary.mkdir()
        files = {name: f"{number:03d}_{_plain(name)}.png" for number, name in enumerate(rig.normal_maps)}
        for name, file in files.items():
            (temporary / file).write_bytes(_png(rig.normal_maps[name]))
        manifest = {
            "kind": "normal maps",
            "version": VERSION,
            "form": "tangent space, +y up (OpenGL); what a shape at weight 1 adds: slopes x/z and y/z add up by weight",
            "rig": Path(path).name,
            "sha256": _digest(path),
            "maps": files,
        }
        (temporary / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
        if folder.exists():
            shutil.rmtree(folder)
        os.replace(temporary, folder)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"Cannot write {folder}: {reason}; check the folder and its rights.") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def with_normal_maps(path: str | os.PathLike, rig: Rig) -> Rig:
    """The rig read from `path` with the maps that lie beside it, if they belong to that very file."""
    folder = normals_folder(path)
    if not (folder / MANIFEST).is_file():
        return rig
    with reading(folder / MANIFEST, "manifest of normal maps"):
        manifest = read_json(folder / MANIFEST)
        if manifest["kind"] != "normal maps" or manifest["version"] != VERSION:
            raise InputError(f"{folder / MANIFEST} is no manifest of normal maps that this version knows.")
        if manifest["sha256"] != _digest(path):
            _log.warning("The normal maps in %s belong to another %s; they are left out.", folder, Path(path).name)
            return rig
        maps = {}
        for name, file in manifest["maps"].items():
            if Path(file).name != file:
                raise InputError(f"{folder / MANIFEST} names the file {file!r}; only files of its own folder may be.")
            maps[name] = _picture(folder / file)
        return replace(rig, normal_maps=maps)


def _digest(path: str | os.PathLike) -> str:
    return hashlib.sha256(read_bytes(path)).hexdigest()


def _plain(name: str) -> str:
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in name)[:60]


def _png(picture: np.ndarray) -> bytes:
    import cv2

    return cv2.imencode(".png", picture[..., ::-1])[1].tobytes()


def _picture(path: Path) -> np.ndarray:
    import cv2

    picture = cv2.imdecode(np.frombuffer(read_bytes(path), np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise InputError(f"Cannot read {path}: it is no whole picture; bake it again.")
    return np.ascontiguousarray(picture[..., ::-1])
