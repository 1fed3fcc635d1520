"""TRC (Motion Analysis, OpenSim): markers as tab-separated text with five lines of header."""

from __future__ import annotations

import logging
import math
import os
from pathlib import Path

import numpy as np

from blendcap.data import InputError, MarkerTake
from blendcap.io.atomic import write_whole
from blendcap.io.opening import read_text, reading
from blendcap.io.rates import stated_rate
from blendcap.io.units import millimetres

_log = logging.getLogger(__name__)


def read_trc(path: str | os.PathLike, unit: str | None = None) -> MarkerTake:
    """Read a .trc file; `unit` overrides the file's own. Empty cells, and markers at exactly (0, 0, 0), are missing."""
    with reading(path, "TRC file"):
        rows = _rows(path)
        facts = _facts(rows)
        names = [cell for cell in rows[3][2:] if cell]
        if "NumMarkers" in facts and int(facts["NumMarkers"]) != len(names):
            raise InputError(f"{path} declares {facts['NumMarkers']} markers, but names {len(names)}; export it again.")
        data = [row for row in rows[4:] if row[0].isdigit()]
        if not data:
            raise InputError(f"{path} holds no frames; export it again.")
        if int(facts.get("NumFrames", len(data))) != len(data):
            _log.warning("%s states %s frames, but holds %d.", path, facts["NumFrames"], len(data))
        width = 2 + 3 * len(names)
        cells = [row[2:width] + [""] * (width - len(row)) for row in data]
        values = np.array([[_number(cell, path) for cell in row] for row in cells])
        positions = values.reshape(len(data), len(names), 3)
        positions[(positions == 0).all(2)] = np.nan
        scale = millimetres(unit or facts.get("Units", ""), str(path))
        return MarkerTake(scale * positions, tuple(names), stated_rate(facts.get("DataRate"), None, str(path)))


def unit_of_trc(path: str | os.PathLike) -> str:
    """`Units` as it stands in a .trc file; empty if it states none."""
    with reading(path, "TRC file"):
        return _facts(_rows(path)).get("Units", "")


def write_trc(path: str | os.PathLike, take: MarkerTake) -> None:
    """Write a take as .trc, mm; a missing marker is three empty cells."""
    count, rate = len(take.positions), f"{take.rate:.10g}"
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{count}\t{len(take.names)}\tmm\t{rate}\t1\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(take.names),
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(take.names) + 1)),
        "",
    ]
    for frame, row in enumerate(take.positions.reshape(count, -1).tolist()):
        cells = ("" if math.isnan(value) else f"{value:.9g}" for value in row)
        lines.append(f"{frame + 1}\t{frame / take.rate:.9g}\t" + "\t".join(cells))
    with write_whole(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rows(path: str | os.PathLike) -> list[list[str]]:
    lines = [line.rstrip("\r\n") for line in read_text(path).splitlines()]
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{path} is no TRC file: it does not start with PathFileType and five lines of header.")
    comma = "\t" not in lines[0]  # some spreadsheets save it with commas
    return [[cell.strip() for cell in line.split("," if comma else "\t")] for line in lines]


def _facts(rows: list[list[str]]) -> dict[str, str]:
    return dict(zip(rows[1], rows[2], strict=False))


def _number(cell: str, path: str | os.PathLike) -> float:
    try:
        return float(cell) if cell else np.nan
    except ValueError:
        raise InputError(f"{path} has {cell[:30]!r} where a coordinate is needed; repair it.") from None
