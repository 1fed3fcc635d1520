"""What a performer showed and when, as CSV: `start,end,unit` in seconds, a row a showing."""

from __future__ import annotations

import os

import numpy as np

from blendcap.data import InputError
from blendcap.io.opening import reading
from blendcap.io.tables import read_table

COLUMNS = ("start", "end", "unit")
Turn = tuple[float, float, str]


def read_turns(path: str | os.PathLike) -> list[Turn]:
    """The showings (start, end, unit), seconds, in the order of the file; other columns are for people."""
    with reading(path, "CSV file"):
        table = read_table(path)
        lacking = [name for name in COLUMNS if name not in table.header]
        if lacking:
            raise InputError(f"{path} has no column {lacking[0]!r}; the header is start,end,unit (seconds).")
        column = table.header.index("unit")
        turns = []
        for row, (start, end) in enumerate(table.numbers(("start", "end"))):
            if not (np.isfinite([start, end]).all() and 0 <= start < end):
                raise InputError(f"Row {row + 1} of {path} is from {start:g} to {end:g} s; a showing must take time.")
            turns.append((float(start), float(end), table.rows[row][column].strip()))
        if not turns:
            raise InputError(f"{path} holds no showing; write a row for each time that a unit was shown.")
    return turns
