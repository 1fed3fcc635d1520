"""The colour texture of an OBJ: the `.mtl` beside it names the picture.

Only files in the OBJ's own folder, or below it, are opened, whatever path an exporter wrote.
"""

from __future__ import annotations

import logging
from pathlib import Path, PurePosixPath

import numpy as np

from blendcap.data import InputError
from blendcap.io.atomic import write_whole
from blendcap.io.images import decoded, write_image
from blendcap.io.opening import read_bytes, read_text

MATERIAL = "skin"

_log = logging.getLogger(__name__)


def read_texture(path: Path, lines: list[str]) -> np.ndarray | None:
    """The picture (H, W, 3) uint8 that the lines of the OBJ at `path` lead to; None, and a warning, if it is not there.

    A mesh has one texture: an OBJ whose materials use several stays without, and a warning says so.
    """
    pictures = sorted(_pictures(path, lines))
    if not pictures:
        return None
    if len(pictures) > 1:
        _log.warning(
            "%s uses %d textures, but a mesh has one, so it is read without: bake them into one picture.",
            path, len(pictures),
        )  # fmt: skip
        return None
    file = _beside(path, pictures[0])
    picture = None if file is None else decoded(read_bytes(file))
    if picture is None:
        _log.warning(
            "%s names the texture %s, which is not beside it or no picture; it is read without.", path, pictures[0]
        )
    return picture


def write_material(path: Path, texture: np.ndarray) -> list[str]:
    """Write the .mtl and the _color.png of the OBJ at `path`; returns the lines of the OBJ that lead there."""
    picture, material = path.with_name(f"{path.stem}_color.png"), path.with_suffix(".mtl")
    write_image(picture, texture)
    with write_whole(material) as temporary:
        temporary.write_text(f"newmtl {MATERIAL}\nKd 1 1 1\nmap_Kd {picture.name}\n", encoding="utf-8")
    return [f"mtllib {material.name}", f"usemtl {MATERIAL}"]


def _pictures(path: Path, lines: list[str]) -> set[str]:
    """The pictures of the materials that the faces use, or of all if the faces do not say."""
    libraries = [line.split(maxsplit=1)[1].strip() for line in lines if line.startswith("mtllib ") and line[7:].strip()]
    used = {line[7:].strip() for line in lines if line.startswith("usemtl ")}
    found: dict[str, str] = {}
    for library in libraries:
        file = _beside(path, library)
        if file is None:
            _log.warning(
                "%s names the materials %s, which are not beside it; it is read without texture.", path, library
            )
            continue
        found |= _color_maps(read_text(file))
    return {picture for name, picture in found.items() if name in used or not used}


def _color_maps(text: str) -> dict[str, str]:
    """Material -> the file of its `map_Kd`; options before the file's name are skipped."""
    name, maps = "", {}
    for line in text.splitlines():
        key, _, rest = line.strip().partition(" ")
        if key == "newmtl":
            name = rest.strip()
        elif key.lower() == "map_kd" and rest.strip():
            maps[name] = rest.split()[-1] if rest.strip().startswith("-") else rest.strip()
    return maps


def _beside(path: Path, named: str) -> Path | None:
    """The file that an OBJ or its .mtl names: where it says if that is in the OBJ's folder, else by its bare name."""
    folder = path.parent.resolve()
    named = named.replace("\\", "/")
    for place in (folder / named, folder / PurePosixPath(named).name):
        try:
            if place.resolve().is_relative_to(folder) and place.is_file():
                return place
        except (OSError, ValueError) as error:
            raise InputError(f"Cannot read {path}: {named[:60]!r} is no name of a file ({error}).") from None
    return None
