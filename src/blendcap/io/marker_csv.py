"""Markers as comma-separated text: `# unit:` and `# rate:` lines, the header `frame,time,<marker>_x,_y,_z, ...`."""

from __future__ import annotations

import os

import numpy as np

from blendcap.data import InputError, MarkerTake
from blendcap.io.opening import reading
from blendcap.io.rates import stated_rate
from blendcap.io.tables import Table, read_table, write_table
from blendcap.io.units import millimetres

_AXES = ("_x", "_y", "_z")


def is_marker_table(table: Table) -> bool:
    """Whether a table has columns of at least one marker."""
    return bool(_markers(table.header))


def read_marker_csv(path: str | os.PathLike, unit: str | None = None) -> MarkerTake:
    """Read our marker CSV. `unit` overrides the line `# unit:`; one of them must say it. Empty cells are missing."""
    with reading(path, "marker CSV"):
        return take_of_table(read_table(path), unit)


def take_of_table(table: Table, unit: str | None = None) -> MarkerTake:
    """The marker take that a table in our form holds."""
    names = _markers(table.header)
    if not names:
        raise InputError(
            f"{table.where} has no markers; its header should be frame,time,<marker>_x,<marker>_y,<marker>_z, ..."
        )
    unit = unit or table.meta.get("unit")
    if unit is None:
        raise InputError(f"{table.where} does not say its unit; add a line '# unit: mm' at its top.")
    times = table.numbers(["time"])[:, 0] if "time" in table.header else None
    rate = stated_rate(table.meta.get("rate"), times, table.where)
    cells = table.numbers(name + axis for name in names for axis in _AXES)
    positions = millimetres(unit, table.where) * cells.reshape(len(cells), len(names), 3)
    return MarkerTake(positions, names, rate, timecode=table.meta.get("timecode"))


def unit_of_marker_csv(path: str | os.PathLike) -> str:
    """The unit that the line `# unit:` states; empty if there is none."""
    with reading(path, "marker CSV"):
        return read_table(path).meta.get("unit", "")


def write_marker_csv(path: str | os.PathLike, take: MarkerTake) -> None:
    """Write a take in our CSV form, mm."""
    meta = {"unit": "mm", "rate": f"{take.rate:.12g}"}
    if take.timecode is not None:
        meta["timecode"] = take.timecode
    count = len(take.positions)
    header = ["frame", "time", *(name + axis for name in take.names for axis in _AXES)]
    columns = [np.arange(count), np.arange(count) / take.rate, *take.positions.reshape(count, -1).T]
    write_table(path, meta, header, columns)


def _markers(header: tuple[str, ...]) -> tuple[str, ...]:
    """Markers whose three columns are all there, in the order of the file."""
    stems = [name[:-2] for name in header if name.endswith("_x")]
    return tuple(stem for stem in stems if stem and all(stem + axis in header for axis in _AXES))
