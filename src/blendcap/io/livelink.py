"""Recordings of Live Link Face (Epic Games): CSV with a timecode, 52 shapes and the angles of head and eyes."""

from __future__ import annotations

import itertools
import logging
import os
import re

import numpy as np

from blendcap.data import Animation, InputError
from blendcap.data.names import ARKIT52, HEAD_AND_EYES, in_vocabulary, match, without_place
from blendcap.io.rates import rate_of_times
from blendcap.io.tables import Table, write_table

_BASES = (24, 25, 30, 48, 50, 60, 100, 120)
_TIMECODE = re.compile(r"(\d+):(\d+):(\d+)[:;](\d+(?:\.\d+)?)$")
_BESIDE = ("timecode", "blendshapecount")
_WRITTEN = 60  # the app counts 60 frames a second whatever the rate of the take

_log = logging.getLogger(__name__)


def is_live_link(table: Table) -> bool:
    """Whether a table has the header of a Live Link Face recording."""
    return bool(table.header) and table.header[0].lower() == "timecode"


def animation_of_live_link(table: Table) -> Animation:
    """The animation that a Live Link Face table holds.

    Columns are found by name, and named in camelCase (`eyeBlinkLeft`, `headYaw`). Times come from the timecode and keep
    dropped frames; of frames with the same timecode the last counts. The angles of head and eyes stay what they are,
    numbers in the app's own unit, beside the shapes.
    """
    columns = [name for name in table.header if name.lower() not in _BESIDE]
    if not columns:
        raise InputError(f"{table.where} has a timecode, but no columns of shapes; record it again.")
    times, first = _times(table)
    kept = np.append(np.diff(times) != 0, True)
    if not kept.all():
        _log.warning("%s repeats the timecode of %d frames; the last of each counts.", table.where, (~kept).sum())
    weights = table.numbers(columns)[kept]
    names = tuple(name[:1].lower() + name[1:] for name in columns)
    times = times[kept] - times[0]
    meta = {"timecode": first, **table.meta}
    return Animation(weights, names, rate_of_times(times, table.where), times=times, meta=meta)


def write_live_link(path: str | os.PathLike, animation: Animation) -> None:
    """Write the 52 ARKit shapes and the nine angles as Live Link Face does; what the animation lacks is 0.

    The timecode starts at the animation's own if it has one, else at 00:00:00, and counts 60 frames a second. Other
    spellings are matched, halves move their whole, and shapes that are not among the 52 are left out with a warning; at
    least one must be among them. What the others did is lost: solve on `rig.select` of the 52 to have them tell it.
    """
    columns = (*ARKIT52, *HEAD_AND_EYES)
    if not match(ARKIT52, animation.names):
        raise InputError(f"Cannot write {path}: none of the animation's shapes is one of the 52 ARKit shapes.")
    if without_place(animation, columns):
        _log.warning(
            "%s can hold ARKit's 52 shapes and no others. To let those tell the motion, solve on a rig of them: "
            "blendcap rig convert RIG arkit.glb --shapes arkit. A .csv, .npz or .glb holds every shape.",
            path,
        )
    animation = in_vocabulary(animation, columns)
    values = [_column(animation, name) for name in columns]
    start = _seconds(animation.meta.get("timecode", "00:00:00:00"), _WRITTEN, "The animation's timecode")
    header = ["Timecode", "BlendShapeCount", *(name[:1].upper() + name[1:] for name in columns)]
    stamps = np.array([_stamp(start + t) for t in (animation.times - animation.times[0]).tolist()])
    counts = np.full(len(stamps), len(columns))
    write_table(path, {}, header, [stamps, counts, *values])


def _column(animation: Animation, name: str) -> np.ndarray:
    if name not in animation.names:
        return np.zeros(len(animation.weights))
    return animation.weights[:, animation.names.index(name)]


def _times(table: Table) -> tuple[np.ndarray, str]:
    """Seconds of each frame, and the first timecode."""
    stamps = [row[0].strip() for row in table.rows]
    frames = [_split(stamp, table.where)[1] for stamp in stamps]
    largest = max(frames)
    base = next((base for base in _BASES if base > largest), None)
    wraps = any(b < a for a, b in itertools.pairwise(frames))
    if base is None:
        raise InputError(f"{table.where} has {largest:g} in the frame field of a timecode; more than 120 is unknown.")
    # Only a take that runs into its next second shows how far the field counts; the app counts to 60.
    base = base if wraps else max(base, _WRITTEN)
    times = np.array([_seconds(stamp, base, table.where) for stamp in stamps])
    days = np.cumsum(np.append(0, np.diff(times) < -43200))  # past midnight
    return times + 86400.0 * days, stamps[0]


def _split(stamp: str, where: str) -> tuple[int, float]:
    found = _TIMECODE.match(stamp)
    if not found:
        raise InputError(f"{where} has the timecode {stamp[:30]!r}; the form is HH:MM:SS:FF.fff.")
    hours, minutes, seconds = (int(found.group(i)) for i in (1, 2, 3))
    return 3600 * hours + 60 * minutes + seconds, float(found.group(4))


def _seconds(stamp: str, base: int, where: str) -> float:
    whole, frames = _split(stamp, where)
    return whole + frames / base


def _stamp(seconds: float) -> str:
    milliframes = round(seconds * _WRITTEN * 1000)
    whole, frames = divmod(milliframes, _WRITTEN * 1000)
    return f"{whole // 3600 % 24:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}:{frames // 1000:02d}.{frames % 1000:03d}"
