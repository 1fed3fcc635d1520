"""Scans of expressions, for `blendcap rig build --examples`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

import blendcap
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    import numpy as np

    from blendcap.data import Mesh, Rig, SurfacePoints

    Example = tuple[Mesh, tuple[SurfacePoints, np.ndarray] | None]

log = logging.getLogger(__name__)

SCANS = (".obj", ".ply", ".stl", ".glb", ".gltf")
IN_METRES = (".glb", ".gltf")


def example_files(folder: Path, neutral: Path) -> list[Path]:
    """The scans of a folder by name, without the neutral."""
    if not folder.is_dir():
        raise blendcap.InputError(f"Cannot read {folder}: there is no such folder; name the folder of the examples.")
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in SCANS and f.resolve() != neutral.resolve())
    if not files:
        raise blendcap.InputError(f"{folder} holds no scans; put .obj, .ply, .stl or .glb files of expressions there.")
    return files


def read_scan(file: Path, unit: str | None) -> tuple[Mesh, str | None]:
    """A scan, and its unit if one is given or the file states one; otherwise its numbers count as mm."""
    from blendcap.io import read_mesh

    stated = unit or ("m" if file.suffix.lower() in IN_METRES else None)
    return read_mesh(file, stated or "mm"), stated


def read_examples(
    files: list[Path], unit: str | None, unit_mm: float, template: Rig, progress: Progress
) -> dict[Path, Example]:
    """The scans, made ready, so that a bad file is known before the long work; none for no files.

    `unit_mm` is what the neutral's numbers were multiplied by: it counts for examples whose unit nobody states.
    """
    from blendcap.data import Mesh
    from blendcap.modeling.landmark_pairs import find_pairs
    from blendcap.modeling.scan_repair import ready_scan

    found: dict[Path, Example] = {}
    if not files:
        return found
    with progress.step("read examples", f"Read {len(files)} examples", total=len(files)) as tell:
        for number, file in enumerate(files):
            tell(file.name)
            raw, stated = read_scan(file, unit)
            try:
                ready = ready_scan(raw, 1.0 if stated else unit_mm)
            except blendcap.InputError as error:
                raise blendcap.InputError(f"The example {file} cannot be used: {error}") from None
            pairs, notes = find_pairs(raw, template)
            for note in (*notes, *ready.notes):
                log.warning("%s: %s", file.name, note)
            bare = Mesh(ready.mesh.vertices, ready.mesh.faces)  # textures of twenty scans would take gigabytes
            found[file] = bare, None if pairs is None else (pairs[0], ready.unit_mm * pairs[1])
            tell(number + 1)
    return found


def refined(rig: Rig, examples: dict[Path, Example], size: float, progress: Progress) -> Rig:
    """The rig with its shapes refined by scans of expressions, scaled by `size` and registered first."""
    from blendcap.modeling.build import register_example
    from blendcap.modeling.examples import asked_for

    meshes = []
    with progress.step("examples", f"Register {len(examples)} examples", total=len(examples)) as tell:
        for number, (file, (scan, pairs)) in enumerate(examples.items()):
            tell(file.name)
            scaled = None if pairs is None else (pairs[0], size * pairs[1])
            meshes.append(register_example(rig, scan.with_vertices(size * scan.vertices), scaled))
            tell(number + 1)
    with progress.step("refine", "Refine the shapes by the examples"):
        return blendcap.refine_rig(rig, meshes, asked_for(rig, [file.stem for file in examples]))
