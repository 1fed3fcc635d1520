"""The ICT-FaceKit rig (ICT-VGL/ICT-FaceKit): the original folder of OBJ files, or one .npz packed from it."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from blendcap.data import InputError, Mesh, Rig, SurfacePoints, triangulate
from blendcap.data.names import mirror_map
from blendcap.io.npz import read_npz
from blendcap.io.obj_folder import read_shapes
from blendcap.io.opening import read_json, reading

NEUTRAL = "generic_neutral_mesh.obj"
_CENTIMETRES = 10.0
_PARTS = {  # the first and the last vertex of what the full mesh is made of, as ICT-FaceKit lists them
    "Face": (0, 9408),
    "HeadAndNeck": (9409, 11247),
    "MouthSocket": (11248, 13293),
    "EyeSocketLeft": (13294, 13677),
    "EyeSocketRight": (13678, 14061),
    "GumsAndTongue": (14062, 17038),
    "Teeth": (17039, 21450),
    "EyeballLeft": (21451, 23020),
    "EyeballRight": (23021, 24590),
    "LacrimalFluidLeft": (24591, 24794),
    "LacrimalFluidRight": (24795, 24998),
    "EyeBlendLeft": (24999, 25022),
    "EyeBlendRight": (25023, 25046),
    "EyeOcclusionLeft": (25047, 25198),
    "EyeOcclusionRight": (25199, 25350),
    "EyelashesLeft": (25351, 26034),
    "EyelashesRight": (26035, 26718),
}
_VERTICES = 26719  # of the full mesh


def read_ict_pack(path: str | os.PathLike, identity: np.ndarray | None = None) -> Rig:
    """The rig of a .npz with `neutral`, `faces`, `expression_names`, `expression_deltas`, in centimetres.

    Parameters
    ----------
    path : path
    identity : (K,) float, optional
        Coefficients of the first K identity modes; the neutral of all people if not given. They are about N(0, 1).
    """
    with reading(path, "ICT-FaceKit pack"):
        pack = read_npz(path)
        neutral = pack["neutral"].astype(np.float64)
        if identity is not None:
            neutral = neutral + _identity(pack["identity_deltas"], identity)
        polygons = pack["faces"].astype(np.int64)
        uv = {}
        if "uv" in pack:
            uv = {"uv": pack["uv"], "uv_faces": triangulate(pack["faces_uv"])}
        mesh = Mesh(_CENTIMETRES * neutral, triangulate(polygons), polygons, **uv)
        names = tuple(str(name) for name in pack["expression_names"])
        deltas = np.float32(_CENTIMETRES) * pack["expression_deltas"]
        ranges = zip(pack.get("region_names", ()), pack.get("region_ranges_v0_v1_f0_f1_inclusive", ()), strict=True)
        regions = _regions({str(name): np.arange(row[0], row[1] + 1) for name, row in ranges})
        points = _landmarks(pack["landmarks68_multipie"], mesh) if "landmarks68_multipie" in pack else {}
        return Rig(mesh, deltas, names, mirror=mirror_map(names), points=points, regions=regions, name="ICT-FaceKit")


def read_ict_folder(path: str | os.PathLike) -> Rig:
    """The rig of the original folder (`FaceXModel`): the neutral and every expression OBJ; identities are left out."""
    path = Path(path)
    shapes = [f for f in path.glob("*.obj") if f.name != NEUTRAL and not re.match(r"identity\d+$", f.stem)]
    shapes.sort(key=lambda file: file.name)
    mesh, deltas = read_shapes(path / NEUTRAL, shapes, _CENTIMETRES)
    parts = _PARTS if len(mesh.vertices) == _VERTICES else {}
    regions = _regions({name: np.arange(first, last + 1) for name, (first, last) in parts.items()})
    names = tuple(file.stem for file in shapes)
    notes, points = path / "vertex_indices.json", {}
    with reading(path, "ICT-FaceKit folder"):
        if notes.exists():
            points = _landmarks(np.array(read_json(notes)["idx_to_landmark_verts"], np.int64), mesh)
        return Rig(mesh, deltas, names, mirror=mirror_map(names), points=points, regions=regions, name="ICT-FaceKit")


def _identity(modes: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    coefficients = np.asarray(coefficients, dtype=np.float64)
    if coefficients.ndim != 1 or len(coefficients) > len(modes):
        raise InputError(f"The identity needs up to {len(modes)} coefficients, but has {coefficients.shape}.")
    return np.tensordot(coefficients, modes[: len(coefficients)], 1)


def _landmarks(vertices: np.ndarray, mesh: Mesh) -> dict[str, SurfacePoints]:
    names = tuple(str(i) for i in range(len(vertices)))
    return {f"landmarks{len(vertices)}": SurfacePoints.at_vertices(names, vertices, mesh)}


def _regions(ranges: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The pack's ranges under names like `mouth_socket`, and both eyeballs together as `eyes`."""
    regions = {re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(): rows for name, rows in ranges.items()}
    eyes = [rows for name, rows in ranges.items() if name.startswith("Eyeball")]
    return regions | ({"eyes": np.concatenate(eyes)} if eyes else {})
