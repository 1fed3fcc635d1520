"""Writing GLB: a mesh, its shapes as sparse morph targets with names, and an animation of their weights."""

from __future__ import annotations

import json
import logging
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np

from blendcap.data import Animation, InputError, Mesh, Rig
from blendcap.io.atomic import write_whole
from blendcap.io.rig_meta import rig_meta

_FLOAT, _VERTEX_DATA, _INDEX_DATA = 5126, 34962, 34963
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_STILL = 1e-7  # m; a vertex that a shape moves less than this is left out of its sparse target

_log = logging.getLogger(__name__)


def write_glb_mesh(path: str | os.PathLike, mesh: Mesh) -> None:
    """Write a mesh as GLB, in metres."""
    binary = _Binary()
    surface = _surface(binary, mesh)
    _write(path, _document(binary, Path(path).stem, surface), binary)


def write_glb_rig(path: str | os.PathLike, rig: Rig, animation: Animation | None = None) -> None:
    """Write a rig as GLB, in metres, with an animation of its weights if one is given.

    Targets are sparse where that is smaller. What glTF has no place for (bounds, mirror, combinations, points,
    regions, contacts, polygons) goes into the mesh's extras as one JSON string: it survives programs that keep
    extras but cannot hold nested lists in them, such as Blender.
    """
    binary = _Binary()
    surface = _surface(binary, rig.mesh)
    weld = _seams(rig.mesh)[0]
    targets = [{"POSITION": binary.sparse(delta[weld] / np.float32(1000))} for delta in rig.deltas]
    gltf = _document(binary, rig.name, surface)
    mesh = gltf["meshes"][0]
    if targets:
        mesh["primitives"][0]["targets"] = targets
        mesh["weights"] = [0.0] * len(targets)
    notes = json.dumps(rig_meta(rig), separators=(",", ":"), allow_nan=False)
    mesh["extras"] = {"targetNames": list(rig.names), "blendcap": notes}
    if animation is not None:
        gltf["animations"] = [_animation(binary, rig, animation)]
    _write(path, gltf, binary)


class _Binary:
    """The binary chunk, and the buffer views and accessors that describe it."""

    def __init__(self):
        self.blob = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, content: bytes, target: int | None = None) -> int:
        self.blob.extend(b"\0" * (-len(self.blob) % 4))
        view = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(content)}
        self.views.append(view if target is None else view | {"target": target})
        self.blob.extend(content)
        return len(self.views) - 1

    def floats(self, values: np.ndarray, target: int | None = None, *, extent: bool = False) -> int:
        """An accessor of float32 rows (count, width); `extent` states their least and largest values."""
        values = np.ascontiguousarray(values, np.float32)
        accessor = {"bufferView": self.view(values.tobytes(), target), "componentType": _FLOAT, "count": len(values),
                    "type": _TYPES[values.shape[1]]}  # fmt: skip
        if extent:
            accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        return self._accessor(accessor)

    def integers(self, values: np.ndarray) -> int:
        """An accessor of triangle corners."""
        kind, dtype = _index_type(int(values.max(initial=0)))
        content = values.astype(dtype).tobytes()
        accessor = {"componentType": kind, "count": values.size, "type": "SCALAR"}
        return self._accessor({"bufferView": self.view(content, _INDEX_DATA)} | accessor)

    def sparse(self, values: np.ndarray) -> int:
        """An accessor of rows (count, 3) most of which are zero."""
        rows = np.flatnonzero(np.abs(values).max(1) > _STILL)
        if 16 * len(rows) > 12 * len(values):
            return self.floats(values, _VERTEX_DATA, extent=True)
        rows = rows if len(rows) else np.array([0])  # a sparse accessor replaces at least one element
        moved = np.where(np.abs(values[rows]).max(1, keepdims=True) > _STILL, values[rows], 0).astype(np.float32)
        low, high = moved.min(0), moved.max(0)
        if len(rows) < len(values):
            low, high = np.minimum(low, 0), np.maximum(high, 0)
        kind, dtype = _index_type(int(rows[-1]))
        indices = {"bufferView": self.view(rows.astype(dtype).tobytes()), "componentType": kind}
        changes = {"bufferView": self.view(moved.tobytes())}
        return self._accessor({
            "componentType": _FLOAT, "count": len(values), "type": "VEC3", "min": low.tolist(), "max": high.tolist(),
            "sparse": {"count": len(rows), "indices": indices, "values": changes},
        })  # fmt: skip

    def _accessor(self, accessor: dict[str, Any]) -> int:
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _surface(binary: _Binary, mesh: Mesh) -> dict[str, Any]:
    """The primitive of a mesh, and the pictures that it has: color and normals."""
    weld, faces, uv = _seams(mesh)
    vertices = (mesh.vertices[weld] / 1000.0).astype(np.float32)
    normals = vertex_normals(mesh.vertices, mesh.faces)[weld]
    attributes = {
        "POSITION": binary.floats(vertices, _VERTEX_DATA, extent=True),
        "NORMAL": binary.floats(normals, _VERTEX_DATA),
    }
    if uv is not None:
        attributes["TEXCOORD_0"] = binary.floats(np.stack([uv[:, 0], 1 - uv[:, 1]], 1), _VERTEX_DATA)
        if mesh.normal_map is not None:
            attributes["TANGENT"] = binary.floats(_tangents(mesh.vertices[weld], faces, uv, normals), _VERTEX_DATA)
    if len(weld) != len(mesh.vertices):
        attributes["_VERTEX"] = binary.floats(weld[:, None], _VERTEX_DATA)
    primitive = {"attributes": attributes, "indices": binary.integers(faces), "material": 0}
    pictures = {"color": mesh.texture, "normals": mesh.normal_map} if uv is not None else {}
    return {"primitive": primitive, "images": {
        use: binary.view(_png(picture)) for use, picture in pictures.items() if picture is not None
    }}  # fmt: skip


def _png(picture: np.ndarray) -> bytes:
    import cv2

    return cv2.imencode(".png", picture[..., ::-1] if picture.shape[2] == 3 else picture)[1].tobytes()


def _document(binary: _Binary, name: str, surface: dict[str, Any]) -> dict[str, Any]:
    shading: dict[str, Any] = {"baseColorFactor": [0.8, 0.62, 0.53, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6}
    gltf: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "blendcap"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"name": name, "primitives": [surface["primitive"]]}],
        "materials": [{"name": "skin", "pbrMetallicRoughness": shading, "doubleSided": True}],
    }
    place = {use: number for number, use in enumerate(surface["images"])}
    if "color" in place:
        shading["baseColorFactor"] = [1.0, 1.0, 1.0, 1.0]
        shading["baseColorTexture"] = {"index": place["color"]}
    if "normals" in place:
        gltf["materials"][0]["normalTexture"] = {"index": place["normals"]}
    if place:
        gltf["textures"] = [{"source": number} for number in place.values()]
        gltf["images"] = [{"bufferView": view, "mimeType": "image/png"} for view in surface["images"].values()]
    return gltf


def _animation(binary: _Binary, rig: Rig, animation: Animation) -> dict[str, Any]:
    unknown = [name for name in animation.names if name not in rig.names]
    if unknown:
        raise InputError(f"The animation moves the shape {unknown[0]!r}, which the rig {rig.name!r} does not have.")
    weights = np.zeros((len(animation.weights), len(rig.names)))
    weights[:, [rig.index(name) for name in animation.names]] = _without_gaps(animation)
    times = binary.floats((animation.times - animation.times[0])[:, None], extent=True)
    curves = [("weights", binary.floats(weights.reshape(-1, 1)))]
    if animation.head is not None and np.isfinite(animation.head).all((1, 2)).any():
        head = _held(animation.head)
        curves.append(("translation", binary.floats(head[:, :3, 3] / 1000.0)))
        curves.append(("rotation", binary.floats(_quaternions(head[:, :3, :3]))))
    return {
        "name": "take",
        "samplers": [{"input": times, "output": output, "interpolation": "LINEAR"} for _, output in curves],
        "channels": [{"sampler": i, "target": {"node": 0, "path": path}} for i, (path, _) in enumerate(curves)],
        "extras": {"rate": animation.rate},
    }


def _without_gaps(animation: Animation) -> np.ndarray:
    """The weights with unknown ones bridged in a straight line, for a file that cannot hold NaN."""
    weights = animation.weights.copy()
    gaps = np.isnan(weights)
    if gaps.any():
        _log.warning("%d unknown weights are bridged in the GLB, which cannot say unknown.", gaps.sum())
    for column, gap in zip(weights.T, gaps.T, strict=True):
        column[gap] = 0.0 if gap.all() else np.interp(animation.times[gap], animation.times[~gap], column[~gap])
    return weights


def _held(head: np.ndarray) -> np.ndarray:
    """Head motion (T, 4, 4) in which a frame without it keeps the pose before (the first known pose at the start)."""
    known = np.isfinite(head).all((1, 2))
    last = np.maximum.accumulate(np.where(known, np.arange(len(head)), -1))
    return head[np.where(last < 0, known.argmax(), last)]


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    """Quaternions (T, 4) in the order x, y, z, w, each on the side of the one before."""
    from scipy.spatial.transform import Rotation

    quaternions = Rotation.from_matrix(rotations).as_quat()
    turns = np.sign(np.einsum("tk,tk->t", quaternions[1:], quaternions[:-1]))
    quaternions[1:] *= np.cumprod(np.where(turns < 0, -1.0, 1.0))[:, None]
    return quaternions


def _seams(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Split vertices that have several texture coordinates: rig vertex (W,), faces (F, 3), uv (W, 2) of each."""
    if mesh.uv is None or mesh.uv_faces is None or np.array_equal(mesh.uv_faces, mesh.faces):
        return np.arange(len(mesh.vertices)), mesh.faces, mesh.uv
    pairs = np.stack([mesh.faces.ravel(), mesh.uv_faces.ravel()], 1)
    unique, corner = np.unique(pairs, axis=0, return_inverse=True)
    lonely = np.setdiff1d(np.arange(len(mesh.vertices)), mesh.faces)  # vertices of no face keep their place
    weld = np.concatenate([unique[:, 0], lonely])
    uv = np.concatenate([mesh.uv[unique[:, 1]], np.zeros((len(lonely), 2))])
    return weld, corner.reshape(-1, 3), uv


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3), weighted by area; (0, 0, 1) where a vertex has no surface around it."""
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        for axis in range(3):
            normals[:, axis] += np.bincount(faces[:, corner], areas[:, axis], len(vertices))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])


def _tangents(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Unit tangents (W, 4) along u, and -1 where the texture is seen mirrored (glTF 2.0, section 3.7.2.1)."""
    edges, steps = (rows[faces[:, 1:]] - rows[faces[:, :1]] for rows in (vertices, uv))
    turned = np.stack([steps[:, 1, 1], -steps[:, 0, 1]], 1)
    areas = steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]
    along = np.sign(areas)[:, None] * np.einsum("fk,fkd->fd", turned, edges)
    size = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    along *= size[:, None]  # the renderer weighs by area too
    sums = np.zeros((len(vertices), 4))
    for corner in range(3):
        for axis, values in enumerate([*along.T, areas]):
            sums[:, axis] += np.bincount(faces[:, corner], values, len(vertices))
    tangents = sums[:, :3] - (sums[:, :3] * normals).sum(1, keepdims=True) * normals
    length = np.linalg.norm(tangents, axis=1, keepdims=True)
    beside = np.cross(normals, np.eye(3)[np.abs(normals).argmin(1)])  # where u has no direction, any will do
    tangents = np.where(length > 1e-12, tangents / np.maximum(length, 1e-12), beside)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    return np.concatenate([tangents, np.where(sums[:, 3:] < 0, -1.0, 1.0)], 1)


def _index_type(largest: int) -> tuple[int, str]:
    return (5123, "<u2") if largest < 65535 else (5125, "<u4")  # 65535 itself restarts primitives


def _write(path: str | os.PathLike, gltf: dict[str, Any], binary: _Binary) -> None:
    binary.blob.extend(b"\0" * (-len(binary.blob) % 4))
    gltf |= {"accessors": binary.accessors, "bufferViews": binary.views, "buffers": [{"byteLength": len(binary.blob)}]}
    text = json.dumps(gltf, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    with write_whole(path) as temporary, temporary.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(binary.blob)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(binary.blob), b"BIN\0"))
        file.write(binary.blob)
