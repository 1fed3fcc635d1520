"""Text tables: `# key: value` lines, one header, rows of numbers; an empty cell is missing."""

from __future__ import annotations

import csv
import io
import logging
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from blendcap.data import InputError
from blendcap.io.atomic import write_whole
from blendcap.io.opening import read_text

_log = logging.getLogger(__name__)

_OTHERS = {"Format Version": "OptiTrack Motive", "Trajectories": "Vicon Nexus", "Marker Trajectories": "Vicon Nexus"}
_MISSING = {"", "nan", "null", "none", "na", "n/a"}


@dataclass(frozen=True)
class Table:
    """A text table as it stands in the file.

    Parameters
    ----------
    meta : {str: str}
        The `# key: value` lines before the header.
    header : tuple of str
    rows : list of lists of str
        As many cells as the header has names.
    where : str
        The file, for errors.
    """

    meta: Mapping[str, str]
    header: tuple[str, ...]
    rows: list[list[str]]
    where: str

    def numbers(self, columns: Iterable[str]) -> np.ndarray:
        """These columns as numbers (T, K), NaN where a cell is empty."""
        places = [self.header.index(name) for name in columns]
        cells = [[row[i] for i in places] for row in self.rows]
        try:
            return np.array(cells, dtype=np.float64).reshape(len(cells), len(places))
        except ValueError:
            numbers = [[self._number(row, i, cell) for i, cell in enumerate(cells[row])] for row in range(len(cells))]
            return np.array(numbers, dtype=np.float64).reshape(len(cells), len(places))

    def _number(self, row: int, column: int, cell: str) -> float:
        if cell.strip().lower() in _MISSING:
            return np.nan
        try:
            return float(cell)
        except ValueError:
            shown = cell if len(cell) < 30 else cell[:27] + "..."
            raise InputError(
                f"Cannot read {self.where}: {shown!r} in row {row + 1} after the header is no number; repair it."
            ) from None


def read_table(path: str | os.PathLike) -> Table:
    """Read a comma-separated file. Columns must have different names; short rows are filled with empty cells."""
    return parse_table(read_text(path), str(path))


def parse_table(text: str, where: str) -> Table:
    """Read a table from text; `where` names it in errors."""
    lines, meta = text.splitlines(), {}
    while lines and (lines[0].startswith("#") or not lines[0].strip()):
        key, colon, value = lines.pop(0).lstrip("# ").partition(":")
        if colon:
            meta[key.strip()] = value.strip()
    try:
        rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(f"Cannot read {where}: it is no comma-separated table ({error}).") from None
    if not rows:
        raise InputError(f"Cannot read {where}: it has no header and no rows.")
    header = tuple(name.strip() for name in rows[0])
    _check_kind(header, where)
    while header and not header[-1]:
        header = header[:-1]  # programs that end every line with a comma
    doubles = sorted({name for name in header if header.count(name) > 1})
    if doubles:
        raise InputError(f"Cannot read {where}: it has {doubles[0]!r} more than once; every column needs its own name.")
    if len(rows) == 1:
        raise InputError(f"Cannot read {where}: it has a header, but no rows.")
    if len(rows[-1]) < min(len(header), *(len(row) for row in rows[1:-1] or rows[-1:])):
        _log.warning(
            "The last row of %s ends after %d of %d cells, as if the file were cut short; the rest counts as missing.",
            where, len(rows[-1]), len(header),
        )  # fmt: skip
    return Table(meta, header, [_fitted(row, len(header), i, where) for i, row in enumerate(rows[1:])], where)


def write_table(path: str | os.PathLike, meta: Mapping[str, str], header: list[str], columns: list[np.ndarray]) -> None:
    """Write columns (T,) under a header and `# key: value` lines; floats with 9 digits, NaN as an empty cell."""
    buffer = io.StringIO()
    for key, value in meta.items():
        buffer.write(f"# {key}: {' '.join(str(value).split())}\n")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    texts = [[_cell(value) for value in np.asarray(column).tolist()] for column in columns]
    writer.writerows(zip(*texts, strict=True))
    with write_whole(path) as temporary:
        temporary.write_text(buffer.getvalue(), encoding="utf-8")


def _check_kind(header: tuple[str, ...], where: str) -> None:
    """Refuse by name what is comma-separated, or looks so, and is no table with one header."""
    if header[0] in _OTHERS:
        raise InputError(f"Cannot read {where}: it is a CSV of {_OTHERS[header[0]]}; export the take as C3D.")
    mark = next((mark for mark in (";", "\t") if header[0].count(mark) > 1 and len(header) == 1), None)
    if mark is not None:
        named = {";": "semicolons", "\t": "tabs"}[mark]
        raise InputError(f"Cannot read {where}: its cells are parted by {named}; export it with commas and points.")


def _cell(value: float | str) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.9g}"
    return str(value)


def _fitted(row: list[str], width: int, number: int, where: str) -> list[str]:
    if len(row) > width and any(cell.strip() for cell in row[width:]):
        raise InputError(
            f"Cannot read {where}: row {number + 1} after the header has {len(row)} cells for {width} columns; "
            "repair it."
        )
    return row[:width] + [""] * (width - len(row))
