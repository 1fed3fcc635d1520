"""A rig made from a scan as one self-contained page: before and after, where it is off, what it can do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from blendcap.data import Mesh, Rig
from blendcap.data.names import canonical
from blendcap.io.atomic import write_whole
from blendcap.modeling.build import BuiltRig
from blendcap.modeling.contacts import find_contacts, gaps
from blendcap.modeling.scan_repair import SIZES
from blendcap.rendering import face_camera, prepare, prepare_rig, shaped
from blendcap.view import page
from blendcap.view.heatmap import heatmap
from blendcap.view.image import draw_text
from blendcap.view.posing import framed_vertices

MOVES = 0.1  # mm a step, RMS: less is of no account
FEW = 0.5  # of the skin: a scan that shows less is a piece
SIDES = (0.0, 0.7, 1.5708)  # yaw, rad
CELL = (380, 460)
SHOWN = ("jawOpen", "eyeBlinkLeft", "mouthSmileLeft", "browInnerUp", "mouthPucker", "cheekPuff")
CLOSING = {"lids_left": ("eyeBlinkLeft",), "lids_right": ("eyeBlinkRight",), "lips": ()}


def write_rig_report(
    path: str | Path, built: BuiltRig, template: Rig, *, notes: Sequence[str] = (), seconds: Mapping[str, float],
    next_steps: Sequence[str] = (),
) -> None:  # fmt: skip
    """Write what became of a scan as one HTML page that asks nothing from outside.

    Parameters
    ----------
    path : path
        `.html`.
    built : BuiltRig
    template : Rig
        What it was built from.
    notes : sequence of str
        What was found and changed in the scan.
    seconds : {step: float}
    next_steps : sequence of str
        What the reader should open next.
    """
    rig, found = built.rig, built.registration
    facts = rig_facts(built, template)
    sections = [
        ("Summary", _summary(facts)),
        ("Look twice", page.sentences([*notes, *doubts(built, facts)], "concerns")),
        ("The scan, the template before, the rig after", _sides(built)),
        ("Distance to the scan", page.figure(
            page.image(heatmap(rig, found.distance, size=(1140, 520), yaws=SIDES), "heat map"),
            "Grey has no counterpart on the scan: inside the mouth, in holes, beyond its border.")),
        ("What has a place on the scan", _matched(built)),
        ("What the rig can do", page.figure(page.image(_shapes(rig), "shapes"))),
        ("How it converged", _levels(built)),
        ("Time", page.table(["step", "seconds"], [[k, f"{v:.1f}"] for k, v in seconds.items()])),
        ("What to open next", page.sentences(next_steps)),
    ]  # fmt: skip
    lead = f"{len(rig.mesh.vertices):,} vertices, {len(rig.names)} shapes, from {len(built.scan.faces):,} triangles"
    with write_whole(path) as temporary:
        temporary.write_text(page.page(f"Rig from a scan, by {template.name}", lead, sections), encoding="utf-8")


def rig_facts(built: BuiltRig, template: Rig) -> dict[str, Any]:
    """What is known of a built rig: distances to the scan, mm, flipped triangles, and gaps of lids and lips, mm."""
    distance = built.registration.distance
    known = distance[np.isfinite(distance)]
    facts: dict[str, Any] = {
        "median_mm": float(np.median(known)), "p95_mm": float(np.percentile(known, 95)),
        "share_of_skin_on_scan": built.registration.levels[-1].matched,
        "flipped": len(built.registration.flipped), "flipped_in": _places_of_folds(built),
        "size_to_template": float(built.registration.alignment[2]),
    }  # fmt: skip
    contacts = dict(find_contacts(template)) | dict(template.contacts)
    for name, shapes in CLOSING.items():
        pairs = contacts.get(name)
        if pairs is not None and len(pairs):
            facts[f"{name}_gap_mm"] = float(gaps(_posed(built.rig, shapes), pairs).mean())
            facts[f"{name}_gap_template_mm"] = float(gaps(_posed(template, shapes), pairs).mean())
    return facts


def _places_of_folds(built: BuiltRig) -> dict[str, int]:
    """How many triangles are folded over in each region of the rig; a triangle in several counts in the smallest."""
    rig, found = built.rig, {}
    regions = sorted(rig.regions, key=lambda name: len(rig.regions[name]))
    for face in rig.mesh.faces[built.registration.flipped]:
        region = next((name for name in regions if np.isin(face, rig.regions[name]).all()), "elsewhere")
        found[region] = found.get(region, 0) + 1
    return found


def _place(rig: Rig, name: str) -> int | None:
    return next((i for i, own in enumerate(rig.names) if canonical(own) == name), None)


def _posed(rig: Rig, shapes: Sequence[str]) -> np.ndarray:
    weights = np.zeros(len(rig.names))
    for name in shapes:
        place = _place(rig, name)
        if place is not None:
            weights[place] = 1
    return rig.pose(weights)


def _summary(facts: Mapping[str, Any]) -> str:
    cards = [
        ("from the scan, median", f"{facts['median_mm']:.2f} mm", "good" if facts["median_mm"] < 0.6 else "bad"),
        ("95 % are closer than", f"{facts['p95_mm']:.2f} mm", ""),
        ("of the skin has a place on the scan, inside of mouth and nose counted; by region below",
         f"{facts['share_of_skin_on_scan']:.0%}", ""),
        ("triangles are folded over", f"{facts['flipped']}", "bad" if facts["flipped"] else "good"),
        ("times the template's size", f"{facts['size_to_template']:.3f}", ""),
    ]  # fmt: skip
    for name in CLOSING:
        if f"{name}_gap_mm" in facts:
            own, before = facts[f"{name}_gap_mm"], facts[f"{name}_gap_template_mm"]
            label = f"{name.replace('_', ' ')}: gap when closed; the template's {before:.2f} mm"
            cards.append((label, f"{own:.2f} mm", "bad" if own > before + 0.2 else "good"))
    return page.cards(cards)


def doubts(built: BuiltRig, facts: Mapping[str, Any]) -> list[str]:
    """What speaks against a built rig, and what to do about it, a sentence each; `facts` as `rig_facts` gives them."""
    found, lines = built.registration, []
    if facts["median_mm"] > 0.6:
        lines.append("The rig lies far from the scan: check the landmarks, and that the face is neutral.")
    if facts["flipped"]:
        where = ", ".join(f"{count} in {region}" for region, count in facts["flipped_in"].items())
        count = "1 triangle is" if facts["flipped"] == 1 else f"{facts['flipped']} triangles are"
        lines.append(
            f"{count} folded over ({where}); those in ears, or inside of lips, may "
            "be left so, others ask for more landmarks around them."
        )
    if found.levels[-1].matched < FEW:
        lines.append(
            f"Only {found.levels[-1].matched:.0%} of the skin has a place on the scan: the scan, or the template, "
            "lacks parts that the other has, which are extrapolated; cut the template, or scan more of the head."
        )
    for number, level in enumerate(found.levels):
        if not level.converged and level.change > MOVES:
            weighs = "only a start for the levels after it" if number < len(found.levels) - 1 else "the answer"
            lines.append(
                f"At stiffness {level.stiffness:g}, which is {weighs}, the template still moved by {level.change:.2f} "
                f"mm a step after {level.steps} steps; if it is off in the pictures, give landmarks, or cut hair and "
                "clothes off the scan."
            )
    size = facts["size_to_template"]
    if not SIZES[0] < size < SIZES[1]:
        lines.append(f"The face is {size:.2f} times as large as the template's: is the scan's unit right?")
    return lines


def _sides(built: BuiltRig) -> str:
    framed = framed_vertices(built.rig)
    rows = []
    scan, before, after = prepare(_plain(built.scan), None), replace(built.rig, mesh=built.start), built.rig
    for title, surface in (("scan", scan), ("template, aligned", prepare_rig(before)), ("rig", prepare_rig(after))):
        row = [surface.picture(face_camera(framed, CELL, yaw), CELL) for yaw in SIDES]
        draw_text(row[0], title, (14, CELL[1] - 16), height=18, anchor="ls")
        rows.append(np.hstack(row))
    return "".join(page.figure(page.image(row, "three sides")) for row in rows)


def _matched(built: BuiltRig) -> str:
    """How much of each region was fitted to the scan, and how far it lies from it."""
    distance, rows = built.registration.distance, []
    for name, vertices in built.rig.regions.items():
        own = distance[vertices]
        if not len(own):
            continue
        known = np.isfinite(own)
        median = f"{np.median(own[known]):.2f}" if known.any() else ""
        rows.append([name, f"{len(vertices):,}", f"{known.mean():.0%}", median])
    said = (
        "A vertex has a place on the scan if the closest point is near, faces the same way and lies on no border. No "
        "scanner sees the inside of mouth and nose or behind the lids; eyeballs and teeth move as a whole; the rest of "
        "what has none lies in a hole, beyond the scan's end, or where matches folded the skin. All of it follows."
    )
    return page.figure(page.table(["region", "vertices", "with a place", "median, mm"], rows) if rows else "", said)


def _plain(mesh: Mesh) -> Mesh:
    return mesh if mesh.texture is not None else Mesh(mesh.vertices, mesh.faces)


def _shapes(rig: Rig) -> np.ndarray:
    """The neutral and some shapes that most rigs have."""
    neutral, camera, cells = prepare_rig(rig), face_camera(framed_vertices(rig), CELL), []
    for name in SHOWN:
        place = _place(rig, name)
        if place is None:
            continue
        weights = np.zeros(len(rig.names))
        weights[place] = 1
        cells.append(shaped(neutral, rig, weights).picture(camera, CELL))
        draw_text(cells[-1], rig.names[place], (CELL[0] // 2, CELL[1] - 14), height=18, anchor="ms")
    cells = cells or [neutral.picture(camera, CELL)]
    cells += [np.full_like(cells[0], 205)] * (-len(cells) % 3)
    return np.vstack([np.hstack(cells[i : i + 3]) for i in range(0, len(cells), 3)])


def _levels(built: BuiltRig) -> str:
    found = built.registration
    rows = [
        [f"{level.stiffness:g}", f"{level.landmarks:g}", str(level.steps), "yes" if level.converged else "no",
         f"{level.change:.3f}", f"{level.residual:.0e}", f"{level.matched:.0%}",
         *(f"{found.energies[term][k]:.4g}" for term in found.energies)]
        for k, level in enumerate(found.levels)
    ]  # fmt: skip
    head = ["stiffness", "landmarks", "steps", "stood still", "last step, mm", "residual", "matched"]
    return page.table([*head, *(f"{term}, mm²" for term in found.energies)], rows)
