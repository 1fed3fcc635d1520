"""Wavefront OBJ, keeping the order of the vertices, the polygons and the texture coordinates."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from blendcap.data import InputError, Mesh, triangulate
from blendcap.io.atomic import write_whole
from blendcap.io.fans import fans_to_polygons
from blendcap.io.obj_materials import read_texture, write_material
from blendcap.io.opening import read_text, reading

CUT = "the file was cut short; export it again."


def read_obj(path: str | os.PathLike, unit_mm: float = 1.0) -> Mesh:
    """A mesh from an OBJ file: `v`, `vt` and `f` lines, one surface, in the order of the file.

    The colour texture is read if the materials name one. Normals and groups are skipped; vertex colors behind the
    positions are ignored.
    """
    with reading(path, "OBJ file"):
        lines = read_text(path).replace("\\\n", " ").splitlines()
        vertices = unit_mm * _floats(lines, "v ", 3)
        uv = _floats(lines, "vt ", 2)
        corners = [line.split()[1:] for line in lines if line.startswith(("f ", "f\t"))]
        if not len(vertices) or not corners:
            raise InputError(
                f"{path} holds no surface (no v or no f lines): it was cut short, or is no mesh; export one."
            )
        polygons, uv_polygons = _polygons(corners, len(vertices), len(uv))
        faces = triangulate(polygons)
        all_triangles = polygons.shape[1] == 3
        has_uv = len(uv) > 0 and (uv_polygons[polygons >= 0] >= 0).all()
        return Mesh(
            vertices,
            faces,
            polygons=None if all_triangles else polygons,
            uv=uv if has_uv else None,
            uv_faces=triangulate(uv_polygons) if has_uv else None,
            texture=read_texture(Path(path), lines) if has_uv else None,
        )


def read_obj_vertices(path: str | os.PathLike, unit_mm: float = 1.0) -> tuple[np.ndarray, list[str]]:
    """The positions (V, 3) of an OBJ file in mm and its face lines, unread: enough to compare with another file."""
    with reading(path, "OBJ file"):
        lines = read_text(path).splitlines()
        return unit_mm * _floats(lines, "v ", 3), [line for line in lines if line.startswith(("f ", "f\t"))]


def write_obj(path: str | os.PathLike, mesh: Mesh) -> None:
    """Write a mesh in mm as OBJ, with its polygons if it has them, its uv, and its texture beside it."""
    lines = ["# blendcap; millimetres"]
    if mesh.uv is not None and mesh.texture is not None:
        lines += write_material(Path(path), mesh.texture)
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    polygons = mesh.faces if mesh.polygons is None else mesh.polygons
    if mesh.uv is None or mesh.uv_faces is None:
        lines += ["f " + " ".join(str(v + 1) for v in row if v >= 0) for row in polygons.tolist()]
    else:
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in mesh.uv.tolist()]
        uv_polygons = fans_to_polygons(mesh.uv_faces, (polygons >= 0).sum(1))
        lines += [
            "f " + " ".join(f"{v + 1}/{t + 1}" for v, t in zip(row, uv_row, strict=True) if v >= 0)
            for row, uv_row in zip(polygons.tolist(), uv_polygons.tolist(), strict=True)
        ]
    with write_whole(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _floats(lines: list[str], start: str, width: int) -> np.ndarray:
    rows = [line.split()[1 : width + 1] for line in lines if line.startswith((start, start.replace(" ", "\t")))]
    short = next((i for i, row in enumerate(rows) if len(row) < width), None)
    if short is not None:
        end = f", and ends the file: {CUT}" if lines[-1].startswith(start.strip()) and short == len(rows) - 1 else "."
        raise InputError(f"The OBJ's line {start.strip()!r} number {short + 1} has fewer than {width} numbers{end}")
    return np.array(rows, dtype=np.float64).reshape(-1, width)


def _polygons(corners: list[list[str]], vertices: int, uvs: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertex and uv indices (P, K) of face lines, padded with -1. Negative numbers in the file count from its end."""
    sizes = np.array([len(row) for row in corners])
    if sizes.min() < 3:
        short = int(sizes.argmin()) + 1
        todo = f", and is the last: {CUT}" if short == len(sizes) else "; remove it."
        raise InputError(f"The OBJ's face number {short} has fewer than 3 corners{todo}")
    fields = [corner.split("/") for row in corners for corner in row]
    flat = np.array([int(f[0]) for f in fields], dtype=np.int64)
    flat_uv = np.array([int(f[1]) if len(f) > 1 and f[1] else 0 for f in fields], dtype=np.int64)
    place = np.arange(int(sizes.max())) < sizes[:, None]
    result = []
    for values, count in ((flat, vertices), (flat_uv, uvs)):
        indices = np.where(values > 0, values - 1, np.where(values < 0, values + count, -1))
        if (indices >= count).any() or (values < -count).any():
            raise InputError(f"The OBJ's faces use entry {int(np.abs(values).max())} of {count}; export it again.")
        table = np.full(place.shape, -1, np.int64)
        table[place] = indices
        result.append(table)
    if (result[0][place] < 0).any():
        raise InputError("The OBJ's faces use vertex 0, but vertices count from 1; export it again.")
    return result[0], result[1]
