"""Scans: PLY and STL through trimesh."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np

from blendcap.data import InputError, Mesh
from blendcap.io.atomic import write_whole
from blendcap.io.opening import read_bytes, reading


def read_scan(path: str | os.PathLike, unit_mm: float = 1.0) -> Mesh:
    """A mesh from a .ply or .stl file. PLY keeps the order of its vertices; in STL equal corners become one."""
    import trimesh

    kind = Path(path).suffix.lower().lstrip(".")
    content = read_bytes(path)
    with reading(path, f"{kind.upper()} file"):
        try:
            scan = trimesh.load(io.BytesIO(content), file_type=kind, process=False, maintain_order=True, force="mesh")
        except Exception as error:  # trimesh's readers raise whatever the damaged bytes lead to
            raise InputError(
                f"Cannot read {path}: the {kind.upper()} file is damaged or cut short; export it again."
            ) from error
        if not isinstance(scan, trimesh.Trimesh) or not len(scan.faces):
            raise InputError(f"{path} holds no surface; export triangles, not points.")
        uv = getattr(scan.visual, "uv", None)
        uv = None if uv is None or len(uv) != len(scan.vertices) or kind == "stl" else np.asarray(uv)
        vertices, faces = np.asarray(scan.vertices, np.float64), np.asarray(scan.faces, np.int64)
        if kind == "stl":
            vertices, place = np.unique(vertices, axis=0, return_inverse=True)
            faces = place.reshape(-1)[faces]
        return Mesh(unit_mm * vertices, faces, uv=uv)


def write_scan(path: str | os.PathLike, mesh: Mesh) -> None:
    """Write a mesh in mm as .ply or .stl, triangles only."""
    import trimesh

    scan = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    content = scan.export(file_type=Path(path).suffix.lower().lstrip("."))
    with write_whole(path) as temporary:
        temporary.write_bytes(content if isinstance(content, bytes) else str(content).encode())
