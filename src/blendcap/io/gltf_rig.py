"""Rigs and their animation in glTF: named morph targets, a weights channel, and our notes in the extras."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from blendcap.data import Animation, InputError, Mesh, Rig
from blendcap.data.names import mirror_map
from blendcap.io.fans import fans_to_polygons, from_run_lengths
from blendcap.io.gltf import Document, open_document
from blendcap.io.gltf_scene import Surface, as_mesh, first_of, read_surface, rotation_of
from blendcap.io.opening import parse_json, reading
from blendcap.io.rates import rate_of_times
from blendcap.io.rig_meta import rig_fields

NOTES = "blendcap"  # the key of our notes in the extras of the mesh

_log = logging.getLogger(__name__)


def read_glb_mesh(path: str | os.PathLike) -> Mesh:
    """The surface of a .glb or .gltf file without its morph targets, mm."""
    with reading(path, "glTF file"):
        document = open_document(Path(path))
        surface = read_surface(document)
        mesh = as_mesh(document, surface)
        return _with_polygons(mesh, _notes(surface, mesh))


def read_glb_rig(path: str | os.PathLike) -> Rig:
    """A rig from a .glb or .gltf file with morph targets, mm.

    Meshes and primitives of the default scene are put in place and joined in the order of the file; morph targets of
    the same name become one shape. Draco, meshopt and quantised files are refused by name.
    """
    with reading(path, "glTF file"):
        document = open_document(Path(path))
        surface = read_surface(document)
        if not surface.targets:
            raise InputError(
                f"Cannot read {path} as a rig: it has no morph targets; export it with shape keys, "
                "or read it as a mesh."
            )
        mesh = as_mesh(document, surface)
        notes = _notes(surface, mesh)
        names = tuple(surface.targets)
        fields = {"name": Path(path).stem, "mirror": mirror_map(names)}
        return Rig(
            _with_polygons(mesh, notes), _deltas(surface), names, **(rig_fields(notes, names) if notes else fields)
        )


def read_glb_animation(path: str | os.PathLike) -> Animation:
    """The first animation of a .glb or .gltf file: weights by target name, and the motion of the node as the head's."""
    with reading(path, "glTF file"):
        document = open_document(Path(path))
        if not document.json.get("animations"):
            raise InputError(f"{path} has no animation; export it with one.")
        animation = document.entry("animations", 0)
        tracks = {
            (c["target"].get("node"), c["target"]["path"]): _track(document, animation["samplers"][c["sampler"]])
            for c in animation["channels"]
        }
        weights: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        face = None
        for (node, kind), (times, values) in tracks.items():
            if kind == "weights":
                face = node if face is None else face
                names = document.entry("meshes", document.entry("nodes", node)["mesh"])["extras"]["targetNames"]
                for name, curve in zip(names, values.reshape(len(times), -1).T, strict=True):
                    weights.setdefault(name, (times, curve))
        if not weights:
            raise InputError(f"{path} has an animation, but none of weights; export it with shape keys animated.")
        times = next(iter(weights.values()))[0]
        columns = [np.interp(times, own, curve) for own, curve in weights.values()]
        rate = (animation.get("extras") or {}).get("rate") or rate_of_times(times, str(path))
        head = _head(tracks, face, times)
        return Animation(np.stack(columns, 1), tuple(weights), rate, head, times=times)


def _deltas(surface: Surface) -> np.ndarray:
    deltas = np.zeros((len(surface.targets), surface.count, 3), np.float32)
    for row, blocks in zip(deltas, surface.targets.values(), strict=True):
        for first, delta in blocks:
            row[first : first + len(delta)] += delta
    weld = surface.welds[0] if len(surface.welds) == 1 else None
    return deltas if weld is None else deltas[:, first_of(weld)]


def _notes(surface: Surface, mesh: Mesh) -> dict[str, Any] | None:
    """Our notes, if they are there and belong to this mesh."""
    notes = next((extras[NOTES] for extras in surface.extras if NOTES in extras), None)
    notes = parse_json(notes, "the notes in the glTF's extras") if isinstance(notes, str) else notes
    if notes is None or notes.get("vertices") == len(mesh.vertices):
        return notes
    _log.warning("The notes in the glTF are for %s vertices, but it has %d; points, regions and contacts are left out.",
                 notes.get("vertices"), len(mesh.vertices))  # fmt: skip
    return None


def _with_polygons(mesh: Mesh, notes: dict[str, Any] | None) -> Mesh:
    if not notes or not notes.get("polygons"):
        return mesh
    polygons = fans_to_polygons(mesh.faces, from_run_lengths(notes["polygons"], len(mesh.faces)))
    return replace(mesh, polygons=polygons)


def _track(document: Document, sampler: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    times = document.accessor(sampler["input"])[:, 0].astype(np.float64)
    values = document.accessor(sampler["output"]).astype(np.float64)
    if len(times) == 0 or len(values) % len(times):
        raise InputError(f"The glTF's animation has {len(values)} values for {len(times)} times; export it again.")
    values = values.reshape(len(times), -1, values.shape[1])
    if sampler.get("interpolation") == "CUBICSPLINE":  # in-tangent, value, out-tangent
        values = values.reshape(len(times), 3, -1, values.shape[2])[:, 1]
    return times, values


def _head(tracks: dict, node: Any, times: np.ndarray) -> np.ndarray | None:
    """The motion (T, 4, 4) in mm of the node that carries the face, if it moves."""
    move, turn = tracks.get((node, "translation")), tracks.get((node, "rotation"))
    if move is None and turn is None:
        return None
    head = np.tile(np.eye(4), (len(times), 1, 1))
    if move is not None:
        head[:, :3, 3] = 1000.0 * _at(times, *move)
    if turn is not None:
        head[:, :3, :3] = rotation_of(_at(times, *turn))
    return head


def _at(times: np.ndarray, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(times, own, column) for column in values[:, 0].T], 1)
