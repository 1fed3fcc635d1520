"""Animations as comma-separated text: `# key: value` lines, the header `frame,time,<shapes>`, a row a frame."""

from __future__ import annotations

import logging
import os

import numpy as np

from blendcap.data import Animation, InputError, Rig
from blendcap.io.rates import stated_rate
from blendcap.io.tables import Table, write_table

_INFLUENCE = ":influence"
_TIMES = ("time", "time_s")

_log = logging.getLogger(__name__)


def animation_of_table(table: Table) -> Animation:
    """The animation that a table in our form holds: columns `<shape>`, and `<shape>:influence` for the confidence.

    The rate is the line `# rate:` or, without it, that of the column `time`. One of the two must be there.
    """
    time = next((name for name in _TIMES if name in table.header), None)
    curves = [name for name in table.header if name not in ("frame", time)]
    names = [name for name in curves if not name.endswith(_INFLUENCE)]
    if not names:
        raise InputError(f"{table.where} has no columns of shapes; its header should be frame,time,<shape names>.")
    confidence = None
    if len(names) < len(curves):
        confidence = np.ones((len(table.rows), len(names)))
        rated = [name for name in names if name + _INFLUENCE in curves]
        confidence[:, [names.index(name) for name in rated]] = table.numbers(n + _INFLUENCE for n in rated)
    times = None if time is None else table.numbers([time])[:, 0]
    rate = stated_rate(table.meta.get("rate"), times, table.where)
    times = np.arange(len(table.rows)) / rate if times is None else times
    notes = {key: value for key, value in table.meta.items() if key not in ("rate", "unit")}
    return Animation(table.numbers(names), tuple(names), rate, None, confidence, times, notes)


def write_animation_csv(path: str | os.PathLike, animation: Animation, rig: Rig | None = None) -> None:
    """Write an animation in our CSV form. Head motion has no columns in it: NPZ and GLB keep that."""
    if animation.head is not None:
        _log.warning("%s keeps the weights, but not the head motion; .npz and .glb keep both.", path)
    meta = {"rate": f"{animation.rate:.12g}", "unit": "weights 0 to 1; time s", **animation.meta}
    if rig is not None:
        meta["rig"] = rig.name
    header, columns = ["frame", "time"], [np.arange(len(animation.times)), animation.times]
    for i, name in enumerate(animation.names):
        header.append(name)
        columns.append(animation.weights[:, i])
        if animation.confidence is not None:
            header.append(name + _INFLUENCE)
            columns.append(animation.confidence[:, i])
    write_table(path, meta, header, columns)
