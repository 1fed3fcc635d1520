"""A rig as a folder of OBJ files: one neutral, one file a shape, all of one topology."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from blendcap.data import InputError, Mesh, Rig
from blendcap.data.names import mirror_map
from blendcap.io.obj import read_obj, read_obj_vertices
from blendcap.io.opening import reading

_NEUTRAL = ("neutral", "basis", "base", "rest", "default")


def read_obj_folder(path: str | os.PathLike) -> Rig:
    """A rig from a folder with `neutral.obj` and one OBJ a shape, named after the shape; its numbers count as mm.

    The neutral may also be called basis, base, rest or default, or have `neutral` in its name. Every file needs the
    vertices and faces of the neutral in the same order.
    """
    path = Path(path)
    files = sorted((f for f in path.iterdir() if f.suffix.lower() == ".obj"), key=lambda f: f.name)
    if not files:
        raise InputError(f"{path} is a folder without .obj files; put neutral.obj and one .obj a shape there.")
    neutral = _neutral(path, files)
    mesh, deltas = read_shapes(neutral, [f for f in files if f != neutral], 1.0)
    names = tuple(f.stem for f in files if f != neutral)
    with reading(path, "folder"):
        return Rig(mesh, deltas, names, mirror=mirror_map(names), name=path.name)


def read_shapes(neutral: Path, files: list[Path], unit_mm: float) -> tuple[Mesh, np.ndarray]:
    """The neutral mesh and the deltas (N, V, 3) of files with the same topology, mm."""
    mesh, deltas = read_obj(neutral, unit_mm), []
    if not files:
        raise InputError(f"{neutral.parent} holds a neutral, but no shapes; put one OBJ a shape beside it.")
    faces = read_obj_vertices(neutral)[1]
    for file in files:
        vertices, own = read_obj_vertices(file, unit_mm)
        if len(vertices) != len(mesh.vertices):
            raise InputError(
                f"{file} has {len(vertices)} vertices, but {neutral.name} has {len(mesh.vertices)}; "
                "every shape needs the topology of the neutral."
            )
        if own and own != faces and not _same_faces(read_obj(file), mesh):
            raise InputError(f"{file} has other faces than {neutral.name}; every shape needs the neutral's topology.")
        deltas.append((vertices - mesh.vertices).astype(np.float32))
    return mesh, np.stack(deltas)


def _neutral(path: Path, files: list[Path]) -> Path:
    named = [f for f in files if f.stem.lower() in _NEUTRAL] or [f for f in files if "neutral" in f.stem.lower()]
    if len(named) != 1:
        found = ", ".join(f.name for f in named) or "none"
        raise InputError(f"{path} needs exactly one neutral.obj beside its shapes, but has {found}; name it so.")
    return named[0]


def _same_faces(one: Mesh, other: Mesh) -> bool:
    return np.array_equal(one.faces, other.faces)
