"""Our own rig archive: arrays for the geometry, JSON for the rest. Exact, and the quickest to read."""

from __future__ import annotations

import os

import numpy as np

from blendcap.data import Mesh, Rig, triangulate
from blendcap.io.npz import read_kind, write_npz
from blendcap.io.opening import reading
from blendcap.io.rig_meta import rig_fields, rig_meta


def read_rig_npz(path: str | os.PathLike) -> Rig:
    """A rig from an archive that `write_rig_npz` wrote."""
    with reading(path, "rig archive"):
        meta, arrays = read_kind(path, "rig")
        names = tuple(str(name) for name in arrays["names"])
        polygons = arrays.get("polygons")
        mesh = Mesh(
            arrays["vertices"],
            arrays["faces"] if polygons is None else triangulate(polygons),
            polygons,
            arrays.get("uv"),
            arrays.get("uv_faces"),
            arrays.get("texture"),
            arrays.get("normal_map"),
        )
        wrinkled = arrays.get("wrinkled", ())
        normal_maps = {str(name): arrays["normal_maps"][row] for row, name in enumerate(wrinkled)}
        return Rig(mesh, arrays["deltas"], names, normal_maps=normal_maps, **rig_fields(meta, names))


def write_rig_npz(path: str | os.PathLike, rig: Rig) -> None:
    """Write a rig as an archive."""
    mesh = rig.mesh
    write_npz(
        path,
        rig_meta(rig),
        vertices=mesh.vertices,
        faces=mesh.faces,
        polygons=mesh.polygons,
        uv=mesh.uv,
        uv_faces=mesh.uv_faces,
        texture=mesh.texture,
        normal_map=mesh.normal_map,
        deltas=rig.deltas,
        names=np.array(rig.names, dtype=np.str_),
        wrinkled=np.array(list(rig.normal_maps), dtype=np.str_) if rig.normal_maps else None,
        normal_maps=np.stack(list(rig.normal_maps.values())) if rig.normal_maps else None,
    )
