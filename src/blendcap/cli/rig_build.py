"""blendcap rig build SCAN -o RIG."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines
from blendcap.cli.outputs import PAGES, check_outputs
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    import numpy as np

    from blendcap.data import Mesh, Rig, SurfacePoints
    from blendcap.modeling.build import BuiltRig
    from blendcap.modeling.scan_repair import ReadyScan

    Pairs = tuple[SurfacePoints, np.ndarray]

RIGS = (".glb", ".npz")


def build(
    scan: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=("--output", "-o"))],
    template: Path | None = None,
    landmarks: Path | None = None,
    examples: Path | None = None,
    unit: Literal["mm", "cm", "dm", "m", "in"] | None = None,
    report: Path | None = None,
    backend: Literal["auto", "cholmod", "splu"] = "auto",
    as_json: AsJson = False,
) -> None:
    """Build an actor's rig from a neutral scan: the template's neutral is laid onto it, its shapes are carried over.

    Parameters
    ----------
    scan
        A mesh of the head: .obj, .ply, .stl or .glb, in any topology; holes may be.
    output
        The rig to write: .glb or .npz.
    template
        The rig whose topology and shapes the actor gets; the mannequin if not given.
    landmarks
        A .json of points on the scan by the names of the template's points: {"landmarks68/30": 4321}, or a points
        file. Without it they are found from the scan's form and texture.
    examples
        A folder of scans of the same person's expressions, in the same unit: they refine the shapes. If every file is
        named after a shape of the template, as in jawOpen.obj, each counts as that shape; otherwise weights are solved.
    unit
        The scan's unit, in place of what the file states; found from the size of a head if neither says.
    report
        A self-contained .html page: before and after, distances, shapes, convergence.
    backend
        The sparse solver; cholmod needs the extra `fast` (cvxopt, GPL-3).
    as_json
        Print the answer as JSON.
    """
    from blendcap.cli.rig_examples import example_files, read_examples, read_scan, refined
    from blendcap.io import read_rig
    from blendcap.io.units import millimetres

    check_outputs([output], RIGS, [scan, template])
    check_outputs([report], PAGES)
    files = [] if examples is None else example_files(examples, scan)
    progress = Progress(quiet=as_json)
    with progress.step("read", f"Read {scan}"):
        raw, stated = read_scan(scan, unit)
        base = blendcap.mannequin() if template is None else read_rig(template)
    with progress.step("landmarks", "Find landmarks" if landmarks is None else f"Read {landmarks}"):
        ready, pairs, free, notes = _ready(raw, base, landmarks, stated)
    _tell(notes, as_json)
    given = read_examples(files, unit, ready.unit_mm, base, progress)
    with progress.step("build", "Lay the template onto the scan and carry its shapes over") as tell:
        built, sized = _built(base, ready, pairs, free, stated, backend, tell)
    if given:
        built = replace(built, rig=refined(built.rig, given, sized.unit_mm / ready.unit_mm, progress))
    later = sized.notes[len(ready.notes) :]
    wrote = _write(output, report, built, base, [*notes, *later], progress)
    facts = _facts(built, base, millimetres(stated or "mm", str(scan)) * sized.unit_mm) | {
        "seconds": progress.seconds,
        "wrote": wrote,
    }
    if as_json:
        print_json({"notes": [*notes, *later], **facts})
    else:
        print_lines({name: fact for name, fact in facts.items() if name != "concerns"} | {"wrote": ", ".join(wrote)})
        _tell([*later, *facts["concerns"]], as_json)


def _tell(sentences: Iterable[str], as_json: bool) -> None:
    if not as_json:
        for sentence in sentences:
            print(sentence, flush=True)


def _ready(
    raw: Mesh, base: Rig, landmarks: Path | None, stated: str | None
) -> tuple[ReadyScan, Pairs | None, np.ndarray, list[str]]:
    """The scan made ready, landmarks in mm if there are any, vertices that shut eyes leave free, what to say of all."""
    from blendcap.modeling.landmark_pairs import check_pairs, find_pairs
    from blendcap.modeling.scan_repair import check_unit, ready_scan, unit_by_landmarks
    from blendcap.modeling.shut_eyes import keep_eyes_open

    given, notes = find_pairs(raw, base) if landmarks is None else (_read_landmarks(landmarks, raw, base), [])
    unit_mm, note = (1.0, None) if stated else unit_by_landmarks(given, base)
    ready = ready_scan(raw, unit_mm)
    pairs = None if given is None else (given[0], ready.unit_mm * given[1])
    if pairs is not None:
        check_pairs(base, pairs, ready.mesh)
    if stated:
        note = check_unit(stated, ready.mesh, pairs, base)
    pairs, free, said = keep_eyes_open(base, pairs)
    return ready, pairs, free, [*notes, *([note] if note else []), *ready.notes, *said]


def _built(
    base: Rig, ready: ReadyScan, pairs: Pairs | None, free: np.ndarray, stated: str | None, backend, tell
) -> tuple[BuiltRig, ReadyScan]:
    """The rig, and the scan in the size that it was built from: a guessed unit is held against the face."""
    from blendcap.modeling.build import build_rig
    from blendcap.modeling.scan_repair import resized

    built = build_rig(base, ready.mesh, pairs, free=free, backend=backend, tell=tell)
    if stated or pairs is not None:
        return built, ready
    sized = resized(ready, float(built.registration.alignment[2]))
    if sized is ready:
        return built, ready
    tell("again in the size of the template")
    return build_rig(base, sized.mesh, None, backend=backend, tell=tell), sized


def _write(
    output: Path, report: Path | None, built: BuiltRig, base: Rig, notes: list[str], progress: Progress
) -> list[str]:
    """Write the rig, and the page if one is asked for; returns the files."""
    from blendcap.io import write_rig
    from blendcap.view.rig_report import write_rig_report

    with progress.step("write", f"Write {output}"):
        write_rig(output, built.rig)
    if report is None:
        return [str(output)]
    with progress.step("report", f"Write {report}"):
        steps = [f"Open {output.name} in Blender or any viewer of glTF files."]
        write_rig_report(report, built, base, notes=notes, seconds=progress.seconds, next_steps=steps)
    return [str(output), str(report)]


def _facts(built: BuiltRig, base: Rig, unit_mm: float) -> dict[str, Any]:
    from blendcap.view.rig_report import doubts, rig_facts

    found = rig_facts(built, base)
    return {
        "vertices": len(built.rig.mesh.vertices), "shapes": len(built.rig.names), "unit_mm": unit_mm,
        "concerns": doubts(built, found), **found, "solver": built.registration.backend,
        "last_step_mm": built.registration.levels[-1].change,
    }  # fmt: skip


def _read_landmarks(path: Path, scan: Mesh, template: Rig) -> tuple[SurfacePoints, np.ndarray]:
    """Landmarks of a file, on the scan as it was read: their partners on the template, and their places (L, 3)."""
    import numpy as np

    from blendcap.data import Rig, landmarks68
    from blendcap.io import read_correspondences, read_points
    from blendcap.io.opening import read_json
    from blendcap.markers.correspondences import resolve
    from blendcap.modeling.landmark_pairs import partners

    if not template.points:
        landmarks68(template)  # says how to give it some
    content = read_json(path)
    if isinstance(content, dict) and "points" in content:
        points = read_points(path)
    else:
        bare = Rig(scan, np.zeros((0, len(scan.vertices), 3), np.float32), (), name=path.name)
        points = resolve(bare, read_correspondences(path))
    return partners(template, points.names), points.positions(scan)
