"""Which reader and writer a path gets: by its ending, and by what stands inside where an ending has several uses."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from blendcap.data import Animation, InputError, MarkerTake, Mesh, Rig
from blendcap.io.animation_csv import animation_of_table, write_animation_csv
from blendcap.io.animation_npz import read_animation_npz, write_animation_npz
from blendcap.io.c3d import read_c3d, unit_of_c3d, write_c3d
from blendcap.io.gltf_rig import read_glb_animation, read_glb_mesh, read_glb_rig
from blendcap.io.gltf_write import write_glb_mesh, write_glb_rig
from blendcap.io.ict import NEUTRAL, read_ict_folder, read_ict_pack
from blendcap.io.livelink import animation_of_live_link, is_live_link, write_live_link
from blendcap.io.marker_csv import read_marker_csv, unit_of_marker_csv, write_marker_csv
from blendcap.io.meshes import read_scan, write_scan
from blendcap.io.normal_maps import with_normal_maps, write_normal_maps
from blendcap.io.npz import npz_names
from blendcap.io.obj import read_obj, write_obj
from blendcap.io.obj_folder import read_obj_folder
from blendcap.io.opening import existing_file, reading
from blendcap.io.rig_npz import read_rig_npz, write_rig_npz
from blendcap.io.tables import read_table
from blendcap.io.trc import read_trc, unit_of_trc, write_trc
from blendcap.io.units import millimetres, warn_if_not_a_head

LIVE_LINK = ".livelink.csv"
GLTF = (".glb", ".gltf")
MARKERS = {
    ".c3d": (read_c3d, write_c3d, unit_of_c3d),
    ".trc": (read_trc, write_trc, unit_of_trc),
    ".csv": (read_marker_csv, write_marker_csv, unit_of_marker_csv),
}
READ = {  # the endings that a record is read from
    "mesh": (".obj", ".ply", ".stl", *GLTF),
    "rig": (*GLTF, ".npz"),
    "markers": tuple(MARKERS),
    "animation": (".csv", ".npz", *GLTF),
}
WRITTEN = {  # and those that it is written to
    "mesh": (".obj", ".ply", ".stl", ".glb"),
    "rig": (".glb", ".npz"),
    "markers": tuple(MARKERS),
    "animation": (LIVE_LINK, ".csv", ".npz", ".glb"),
}
_A = {"mesh": "a mesh", "rig": "a rig", "markers": "markers", "animation": "an animation"}


def read_mesh(path: str | os.PathLike, unit: str | None = None) -> Mesh:
    """Read a surface: .obj, .ply, .stl, .glb, .gltf.

    Parameters
    ----------
    path : path
    unit : str, optional
        Unit of length, in place of what the file states. If not given, OBJ, PLY and STL are in mm, glTF in metres.

    Returns
    -------
    mesh : Mesh
        In mm. A size that no head has brings a warning, unless the unit is given.

    Raises
    ------
    InputError
        If there is no such file, it is broken, or its ending or the unit is not known.
    """
    kind = _reading(path, "mesh")
    if kind in GLTF:
        mesh = read_glb_mesh(path)
        return mesh if unit is None else mesh.with_vertices(mesh.vertices * millimetres(unit, str(path)) / 1000)
    scale = millimetres(unit or "mm", str(path))
    mesh = read_obj(path, scale) if kind == ".obj" else read_scan(path, scale)
    if unit is None:
        warn_if_not_a_head(mesh.vertices, str(path))
    return mesh


def read_rig(path: str | os.PathLike, unit: str | None = None) -> Rig:
    """Read a rig: .glb or .gltf with morph targets, .npz (ours or an ICT-FaceKit pack), a folder of OBJ files.

    Parameters
    ----------
    path : path
    unit : str, optional
        Unit of length, in place of what is known of the file: glTF is in metres, ICT-FaceKit in cm, the rest in mm.

    Returns
    -------
    rig : Rig
        In mm, with the normal maps that lie beside a .glb. A size that no head has brings a warning, unless the unit is
        given.

    Raises
    ------
    InputError
        If there is no such file or folder, it is broken, has no shapes, or its shapes do not share their vertices.
    """
    rig, known_mm = _rig_and_unit(path)
    if unit is None:
        warn_if_not_a_head(rig.mesh.vertices, str(path))
        return rig
    scale = millimetres(unit, str(path)) / known_mm
    return replace(rig, mesh=rig.mesh.with_vertices(scale * rig.mesh.vertices), deltas=scale * rig.deltas)


def _rig_and_unit(path: str | os.PathLike) -> tuple[Rig, float]:
    """A rig in mm, and the mm that one unit of its file was taken for."""
    if Path(path).is_dir():
        ict = (Path(path) / NEUTRAL).exists()
        return (read_ict_folder(path), 10.0) if ict else (read_obj_folder(path), 1.0)
    kind = _reading(path, "rig", "a folder of OBJ files")
    if kind != ".npz":
        return with_normal_maps(path, read_glb_rig(path)), 1000.0
    return (read_ict_pack(path), 10.0) if "expression_deltas" in npz_names(path) else (read_rig_npz(path), 1.0)


def read_markers(path: str | os.PathLike, unit: str | None = None) -> MarkerTake:
    """Read a marker take: .c3d, .trc, .csv (ours).

    Parameters
    ----------
    path : path
    unit : str, optional
        Unit of length, in place of the one that the file states.

    Returns
    -------
    take : MarkerTake
        In mm; NaN where a marker is missing.

    Raises
    ------
    InputError
        If there is no such file, it is broken or empty, or states no unit and none is given.
    """
    return MARKERS[_reading(path, "markers")][0](path, unit)


def unit_of_markers(path: str | os.PathLike) -> str:
    """The unit of length that a marker file states, as it stands there; empty if it states none.

    Raises
    ------
    InputError
        If there is no such file, it is broken, or its ending is not known.
    """
    return MARKERS[_reading(path, "markers")][2](path)


def read_animation(path: str | os.PathLike) -> Animation:
    """Read weights over time: .csv (ours, or Live Link Face by its header), .npz, .glb, .gltf.

    Returns
    -------
    animation : Animation
        With head motion and confidence where the format holds them; times in s.

    Raises
    ------
    InputError
        If there is no such file, it is broken, or holds no curves or no rate.
    """
    kind = _reading(path, "animation")
    if kind == ".npz":
        return read_animation_npz(path)
    if kind != ".csv":
        return read_glb_animation(path)
    with reading(path, "CSV file"):
        table = read_table(path)
        return animation_of_live_link(table) if is_live_link(table) else animation_of_table(table)


def write_mesh(path: str | os.PathLike, mesh: Mesh) -> None:
    """Write a surface: .obj, .ply, .stl (mm), .glb (metres).

    Raises
    ------
    InputError
        If the ending is not known or the file cannot be written; what was there before stays.
    """
    kind = _writing(path, "mesh")
    {".obj": write_obj, ".glb": write_glb_mesh}.get(kind, write_scan)(path, mesh)


def write_rig(path: str | os.PathLike, rig: Rig, animation: Animation | None = None) -> None:
    """Write a rig: .glb, with an animation if one is given, or .npz without.

    The normal maps of shapes go into a folder beside the .glb (see `normal_maps`); an .npz holds them itself.

    Raises
    ------
    InputError
        If the ending is not known, the file cannot be written (what was there before stays), or the animation has
        shapes that the rig lacks.
    """
    kind = _writing(path, "rig")
    if kind == ".glb":
        write_glb_rig(path, rig, animation)
        write_normal_maps(path, rig)
    elif animation is not None:
        raise InputError(f"Cannot write {path}: a rig .npz holds no animation; write .glb, or the animation by itself.")
    else:
        write_rig_npz(path, rig)


def write_markers(path: str | os.PathLike, take: MarkerTake) -> None:
    """Write a marker take: .c3d, .trc, .csv, all in mm.

    Raises
    ------
    InputError
        If the ending is not known or the file cannot be written; what was there before stays.
    """
    MARKERS[_writing(path, "markers")][1](path, take)


def write_animation(path: str | os.PathLike, animation: Animation, rig: Rig | None = None) -> None:
    """Write weights over time: .csv, .livelink.csv (Live Link Face), .npz, .glb (needs the rig).

    Raises
    ------
    InputError
        If the ending is not known, the file cannot be written (what was there before stays), or a .glb has no rig.
    """
    kind = _writing(path, "animation")
    if kind == LIVE_LINK:
        write_live_link(path, animation)
    elif kind == ".csv":
        write_animation_csv(path, animation, rig)
    elif kind == ".npz":
        write_animation_npz(path, animation)
    elif rig is None:
        raise InputError(f"Cannot write {path}: a .glb holds the face too; give the rig, or write .csv or .npz.")
    else:
        write_glb_rig(path, rig, animation)


def _reading(path: str | os.PathLike, record: str, also: str = "") -> str:
    """The ending of a file to read, in small letters."""
    kind = _ending(path, READ[record])
    if kind is None:
        existing_file(path)
        known = ", ".join(READ[record]) + (f" or {also}" if also else "")
        raise InputError(f"Cannot read {_A[record]} from {path}: its ending is not one of {known}; convert it first.")
    return kind


def _writing(path: str | os.PathLike, record: str) -> str:
    """The ending of a file to write, in small letters."""
    kind = _ending(path, WRITTEN[record])
    if kind is None:
        known = ", ".join(WRITTEN[record])
        raise InputError(f"Cannot write {_A[record]} to {path}: its ending must be one of {known}.")
    return kind


def _ending(path: str | os.PathLike, endings: tuple[str, ...]) -> str | None:
    name = Path(path).name.lower()
    return next((ending for ending in endings if name.endswith(ending)), None)
