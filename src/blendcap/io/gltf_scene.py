"""What a glTF scene shows, as one surface: every mesh at its place, and the morph targets merged by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from blendcap.data import InputError, Mesh
from blendcap.io.gltf import Document
from blendcap.io.images import decoded

_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@dataclass
class Surface:
    """The merged surface, still in metres and in the order of the file.

    Attributes
    ----------
    vertices : list of (V_k, 3)
        One block for each vertex buffer used; the blocks follow each other.
    faces : list of (F_k, 3)
        Indices into all blocks.
    uv : list of (V_k, 2) or None
    targets : {name: list of (first vertex, (V_k, 3))}
    extras : list of dict
        The extras of the meshes, in order.
    welds : list of (V_k,) or None
        Our own `_VERTEX` attribute: which vertex of the rig each glTF vertex is.
    """

    vertices: list[np.ndarray] = field(default_factory=list)
    faces: list[np.ndarray] = field(default_factory=list)
    uv: list[np.ndarray | None] = field(default_factory=list)
    targets: dict[str, list[tuple[int, np.ndarray]]] = field(default_factory=dict)
    extras: list[dict[str, Any]] = field(default_factory=list)
    welds: list[np.ndarray | None] = field(default_factory=list)
    material: Any = None
    count: int = 0


def read_surface(document: Document) -> Surface:
    """Merge what the default scene of the document shows."""
    surface = Surface()
    for node, matrix in placed_nodes(document):
        if "mesh" in node:
            # The specification ignores the transform of a skinned mesh's node: its bind pose is in scene space.
            place = np.eye(4) if "skin" in node else matrix
            _add_mesh(surface, document, document.entry("meshes", node["mesh"]), place)
    if not surface.faces:
        raise InputError("The glTF shows no triangles; export a mesh.")
    return surface


def placed_nodes(document: Document) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
    """Each node of the default scene with its transform (4, 4) to the scene, metres."""
    if document.json.get("scenes"):
        roots = document.entry("scenes", document.json.get("scene", 0)).get("nodes", [])
    else:
        nodes = range(len(document.json.get("nodes", [])))
        children = {c for i in nodes for c in document.entry("nodes", i).get("children", [])}
        roots = [i for i in nodes if i not in children]
    waiting, seen = [(index, np.eye(4)) for index in reversed(roots)], set()
    while waiting:
        index, parent = waiting.pop()
        node = document.entry("nodes", index)
        if index in seen:
            raise InputError(f"The glTF's node {index} hangs in the scene twice; export it again.")
        seen.add(index)
        matrix = parent @ _local(node)
        yield node, matrix
        waiting += [(child, matrix) for child in reversed(node.get("children", []))]


def as_mesh(document: Document, surface: Surface) -> Mesh:
    """The surface as a mesh in mm; seams that our own writer cut are closed again."""
    vertices = 1000.0 * np.concatenate(surface.vertices)
    faces = np.concatenate(surface.faces)
    uv = _joined_uv(surface)
    pictures = {} if uv is None else _pictures(document, surface.material)
    weld = surface.welds[0] if len(surface.welds) == 1 else None
    if weld is None:
        return Mesh(vertices, faces, uv=uv, **pictures)
    return Mesh(vertices[first_of(weld)], weld[faces], uv=uv, uv_faces=None if uv is None else faces, **pictures)


def first_of(weld: np.ndarray) -> np.ndarray:
    """For each vertex of the rig the first glTF vertex that stands for it."""
    rows, first = np.unique(weld, return_index=True)
    if len(rows) == 0 or rows[0] != 0 or rows[-1] != len(rows) - 1:
        raise InputError("The glTF's _VERTEX attribute skips vertices; export it again.")
    return first


def _add_mesh(surface: Surface, document: Document, mesh: dict[str, Any], matrix: np.ndarray) -> None:
    extras = mesh.get("extras", {})
    extras = extras if isinstance(extras, dict) else {}
    surface.extras.append(extras)
    blocks: dict[str, tuple[int, int]] = {}  # primitives that differ only in material share their vertices
    for primitive in mesh["primitives"]:
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            continue
        key = repr((primitive["attributes"], primitive.get("targets")))
        if key not in blocks:
            first = surface.count
            _add_block(surface, document, primitive, extras, matrix)
            blocks[key] = first, surface.count - first
        first, size = blocks[key]
        surface.faces.append(_triangles(document, primitive, mode, size) + first)
        if surface.material is None:
            surface.material = primitive.get("material")


def _add_block(surface: Surface, document: Document, primitive: dict, extras: dict, matrix: np.ndarray) -> None:
    attributes = primitive["attributes"]
    positions = _vectors(document, attributes["POSITION"], None)
    count, first = len(positions), surface.count
    surface.vertices.append(positions @ matrix[:3, :3].T + matrix[:3, 3])
    texcoord = attributes.get("TEXCOORD_0")
    surface.uv.append(None if texcoord is None else document.accessor(texcoord, count).astype(np.float64))
    weld = attributes.get("_VERTEX")
    surface.welds.append(None if weld is None else document.accessor(weld, count)[:, 0].astype(np.int64))
    targets = primitive.get("targets", [])
    names = extras.get("targetNames") or (primitive.get("extras") or {}).get("targetNames")
    names = [f"target{i}" for i in range(len(targets))] if names is None else names
    if len(names) != len(targets) or len(set(names)) != len(names) or not all(isinstance(n, str) for n in names):
        raise InputError(f"The glTF gives {len(names)} names to {len(targets)} morph targets; each needs its own name.")
    for name, target in zip(names, targets, strict=True):
        blocks = surface.targets.setdefault(name, [])
        if "POSITION" in target:
            delta = _vectors(document, target["POSITION"], count)
            blocks.append((first, (delta @ (1000.0 * matrix[:3, :3].T)).astype(np.float32)))
    surface.count += count


def _vectors(document: Document, index: Any, count: int | None) -> np.ndarray:
    values = document.accessor(index, count)
    if values.dtype.kind != "f" or values.shape[1] != 3:
        raise InputError("The glTF's positions are not 32-bit floats (quantised?); export without quantisation.")
    return values.astype(np.float64)


def _triangles(document: Document, primitive: dict, mode: int, size: int) -> np.ndarray:
    indices = primitive.get("indices")
    corners = np.arange(size) if indices is None else document.accessor(indices)[:, 0].astype(np.int64)
    if len(corners) and corners.max() >= size:
        raise InputError(f"The glTF's triangles use vertex {corners.max()}, but there are {size}; export it again.")
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode == _FAN:
        return np.stack([np.full(max(len(corners) - 2, 0), corners[0]), corners[1:-1], corners[2:]], 1)
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], 1)
    strip[1::2, 1:] = strip[1::2, :0:-1]  # every other triangle of a strip is turned around
    return strip


def _joined_uv(surface: Surface) -> np.ndarray | None:
    if all(uv is None for uv in surface.uv):
        return None
    blocks = [np.zeros((len(v), 2)) if uv is None else uv for v, uv in zip(surface.vertices, surface.uv, strict=True)]
    uv = np.concatenate(blocks)
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], 1)  # glTF counts v downwards


def _pictures(document: Document, material: Any) -> dict[str, np.ndarray | None]:
    """The pictures of a material as arguments of `Mesh`: base color and normals."""
    if material is None:
        return {}
    entry = document.entry("materials", material)
    color = (entry.get("pbrMetallicRoughness") or {}).get("baseColorTexture")
    normals = entry.get("normalTexture")
    normal_map = _picture(document, normals)
    if normals is not None and normal_map is not None:
        normal_map = _scaled(normal_map, normals.get("scale", 1.0))
    return {"texture": _picture(document, color), "normal_map": normal_map}


def _scaled(normal_map: np.ndarray, scale: float) -> np.ndarray:
    """A normal map with x and y scaled, as the specification (5.20) has it."""
    if scale == 1:
        return normal_map
    normals = normal_map.astype(np.float64) / 127.5 - 1
    normals[..., :2] *= float(scale)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    return np.round(128 + 127 * normals).astype(np.uint8)


def _picture(document: Document, texture: Any) -> np.ndarray | None:
    """The picture (H, W, 3) uint8 that a material uses, or None if there is none or its format is unknown."""
    if texture is None:
        return None
    source = document.entry("textures", texture.get("index")).get("source")
    if source is None:
        return None
    image = document.entry("images", source)
    content = document.view(image["bufferView"])[0] if "bufferView" in image else document.resource(image.get("uri"))
    return decoded(content)


def _local(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_of(np.array(node.get("rotation", [0, 0, 0, 1]), dtype=np.float64))
    matrix[:3, :3] *= np.array(node.get("scale", [1, 1, 1]), dtype=np.float64)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) in glTF's order x, y, z, w."""
    length = np.linalg.norm(quaternion, axis=-1, keepdims=True)
    if not (length > 0).all():
        raise InputError("The glTF has a rotation of length zero; export it again.")
    x, y, z, w = np.moveaxis(quaternion / length, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)
