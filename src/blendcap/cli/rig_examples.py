"""Scans of expressions, for `blendcap rig build --examples`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

import blendcap
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from blendcap.data import Rig

log = logging.getLogger(__name__)

SCANS = (".obj", ".ply", ".stl", ".glb", ".gltf")


def example_files(folder: Path, neutral: Path) -> list[Path]:
    """The scans of a folder by name, without the neutral."""
    if not folder.is_dir():
        raise blendcap.InputError(f"Cannot read {folder}: there is no such folder; name the folder of the examples.")
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in SCANS and f.resolve() != neutral.resolve())
    if not files:
        raise blendcap.InputError(f"{folder} holds no scans; put .obj, .ply, .stl or .glb files of expressions there.")
    return files


def refined(rig: Rig, files: list[Path], unit_mm: float, template: Rig, progress: Progress) -> Rig:
    """The rig with its shapes refined by scans of expressions, each registered first."""
    from blendcap.io import read_mesh
    from blendcap.modeling.build import register_example
    from blendcap.modeling.examples import asked_for
    from blendcap.modeling.landmark_pairs import find_pairs
    from blendcap.modeling.scan_repair import ready_scan

    meshes = []
    with progress.step("examples", f"Register {len(files)} examples", total=len(files)) as tell:
        for number, file in enumerate(files):
            tell(file.name)
            raw = read_mesh(file, "mm")
            pairs, notes = find_pairs(raw, template)
            ready = ready_scan(raw, unit_mm)
            for note in (*notes, *ready.notes):
                log.warning("%s: %s", file.name, note)
            scaled = None if pairs is None else (pairs[0], unit_mm * pairs[1])
            meshes.append(register_example(rig, ready.mesh, scaled))
            tell(number + 1)
    with progress.step("refine", "Refine the shapes by the examples"):
        return blendcap.refine_rig(rig, meshes, asked_for(rig, [file.stem for file in files]))
