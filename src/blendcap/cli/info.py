"""blendcap info FILE."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import blendcap
from blendcap.cli.answers import AsJson, print_json, print_lines

ALL = 10_000  # names to print


def info(
    file: Path, /, *, unit: Literal["mm", "cm", "dm", "m", "in", "ft"] | None = None, as_json: AsJson = False
) -> None:
    """Say what a file holds.

    Parameters
    ----------
    file
        A rig, a mesh, a marker take, an animation, a video, cameras, places of markers, turns of a lesson, or a trained
        model.
    unit
        The unit of a rig, a mesh or a take, in place of the one that the file states.
    as_json
        Print the answer as JSON.
    """
    from blendcap.cli.left_out import left_out, left_out_in_words
    from blendcap.io import describe
    from blendcap.io.models import read_model
    from blendcap.makeup.packing import KIND, VERSION, unpack

    facts = describe(file, unit, of_take=_filled)
    if facts["kind"] == "model" and (facts["of"], facts["version"]) == (KIND, VERSION):
        classifier = unpack(*read_model(file, KIND, VERSION))
        facts |= left_out(classifier) if as_json else left_out_in_words(classifier)
    if as_json:
        print_json(facts)
    else:
        print_lines(_for_people(facts, unit), most=ALL)


def _filled(take: blendcap.MarkerTake) -> dict[str, dict[str, list[tuple[int, int]]]]:
    """Where other software filled a marker's gaps: first and last frames."""
    from blendcap.markers.filled import filled_stretches

    spans: dict[str, list[tuple[int, int]]] = {}
    for stretch in filled_stretches(take):
        spans.setdefault(stretch.marker, []).append((stretch.first, stretch.last))
    return {"filled": spans}


def _for_people(facts: dict[str, Any], given: str | None) -> dict[str, Any]:
    """The facts as people read them: sizes with their unit, gaps in words, long lists last."""
    said = dict(facts)
    if facts["kind"] == "markers":
        unit = said.pop("file_unit")
        said["unit"] = f"{unit}, as the file says" if unit else "the file says none; give --unit here and to solve"
        if given is not None:
            said["unit"] = f"{given}, as you say; the file says {unit or 'none'}"
        gaps = said.pop("missing_of_marker")
        said["have gaps"] = [f"{name} {100 * share:.3g}%" for name, share in gaps.items()]
        spans = [(name, *span) for name, some in said.pop("filled").items() for span in some]
        said["filled"] = [f"{name} frames {first} to {last}" for name, first, last in spans]
    if "missing" in facts:
        said["missing"] = f"{100 * facts['missing']:.3g} % of the samples"
    if facts.get("size"):
        said["size"] = _size(facts)
    if facts["kind"] != "markers":
        said.pop("unit", None)  # the size says it
    if facts["kind"] == "cameras":
        said["cameras"] = [f"{name} ({width} x {height} pixels)" for name, (width, height) in facts["cameras"].items()]
    if facts["kind"] == "rig":
        said["points"] = [f"{name} ({count})" for name, count in facts["points"].items()]
    return dict(sorted(said.items(), key=lambda item: isinstance(item[1], list | dict)))


def _size(facts: dict[str, Any]) -> str:
    if facts["kind"] == "video":
        return "{} x {} pixels".format(*facts["size"])
    sides = " x ".join(f"{side:.4g}" for side in facts["size"])
    of_what = ", of the markers in the first frames" if facts["kind"] == "markers" else ""
    return f"{sides} {facts['unit'] or 'in the unit of the file'} (x, y, z{of_what})"
