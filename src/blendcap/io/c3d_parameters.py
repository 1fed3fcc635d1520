"""Header and parameters of a C3D file, every length checked before it is trusted.

C3D user guide (C3D.ORG), "The header section" and "The parameter section".
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from blendcap.data import InputError

BLOCK = 512
_INTEL, _DEC, _MIPS = 84, 85, 86
_DTYPES = {1: "<u1", 2: "<i2", 4: "<f4"}


@dataclass(frozen=True)
class Skeleton:
    """What a C3D says about its data.

    Parameters
    ----------
    points : int
        Points a frame.
    analog : int
        Analog samples a frame.
    frames : int
        The largest count of frames that header or parameters state.
    offset : int
        Byte where the data start.
    scale : float
        mm or other units per integer step; negative if the samples are floats.
    dec : bool
        Floats are in the form of DEC machines.
    parameters : {(group, name): values}
        A list of str, or an array of numbers, flat.
    """

    points: int
    analog: int
    frames: int
    offset: int
    scale: float
    dec: bool
    parameters: Mapping[tuple[str, str], list[str] | np.ndarray]

    def texts(self, name: str) -> list[str]:
        """The strings of the parameter POINT:name; empty if there are none."""
        values = self.parameters.get(("POINT", name), [])
        return values if isinstance(values, list) else []

    def number(self, group: str, name: str, default: float) -> float:
        """The first number of a parameter."""
        values = self.parameters.get((group, name))
        return float(values[0]) if isinstance(values, np.ndarray) and len(values) else default


def read_skeleton(content: bytes) -> Skeleton:
    """Header and parameters of the bytes of a C3D file; InputError where it is no whole C3D."""
    if len(content) < 2 * BLOCK or content[1] != 0x50 or not content[0]:
        raise _damaged("it has no C3D header")
    section = (content[0] - 1) * BLOCK
    if section + 4 > len(content):
        raise _damaged("it ends before its parameters")
    processor = content[section + 3]
    if processor not in (_INTEL, _DEC):
        maker = "a MIPS (SGI) machine" if processor == _MIPS else "an unknown machine"
        raise InputError(f"it is a C3D of {maker}; export it again as Intel C3D.")
    points, analog, first, last = struct.unpack_from("<HHHH", content, 2)
    offset = (struct.unpack_from("<H", content, 16)[0] - 1) * BLOCK
    if not section < offset <= len(content):
        raise _damaged("its header points outside the file")
    dec = processor == _DEC
    parameters = _parameters(content, section, offset, dec)
    scale = float(floats_of(np.frombuffer(content, "<u2", 2, 12), dec)[0])
    skeleton = Skeleton(points, analog, last - first + 1, offset, scale, dec, parameters)
    if skeleton.number("POINT", "USED", points) != points:
        raise _damaged("its header and its parameter POINT:USED count different points")
    return Skeleton(points, analog, _frames(skeleton), offset, scale, dec, parameters)


def floats_of(words: np.ndarray, dec: bool) -> np.ndarray:
    """32-bit floats (K,) of pairs of 16-bit words (2K,). DEC stores the upper word first, and four times the value."""
    if not dec:
        return np.ascontiguousarray(words).view("<f4")
    return np.ascontiguousarray(words.reshape(-1, 2)[:, ::-1]).view("<f4").ravel() / 4


def _frames(skeleton: Skeleton) -> int:
    """The largest count stated: 16 bits overflow, and POINT:FRAMES as a float or TRIAL:ACTUAL_* then hold the truth."""
    stated = int(skeleton.number("POINT", "FRAMES", 0))
    counts = [skeleton.frames, stated % 65536 if stated < 0 else stated]
    fields = [skeleton.parameters.get(("TRIAL", f"ACTUAL_{end}_FIELD")) for end in ("START", "END")]
    if all(isinstance(field, np.ndarray) and len(field) == 2 for field in fields):
        start, end = (int(low) % 65536 + 65536 * int(high) for low, high in fields)  # pyright: ignore
        counts.append(end - start + 1)
    return max(counts)


def _parameters(content: bytes, section: int, end: int, dec: bool) -> dict[tuple[str, str], list[str] | np.ndarray]:
    groups: dict[int, str] = {}
    found = []
    for number, name, record in _records(content, section, end):
        if number < 0:
            groups[-number] = name
        else:
            found.append((number, name, _values(record, name, dec)))
    return {(groups.get(number, ""), name): values for number, name, values in found}


def _records(content: bytes, section: int, end: int) -> Iterator[tuple[int, str, bytes]]:
    """Number, name and body of each group (number < 0) and parameter (the number of its group)."""
    place = section + 4
    while place + 2 <= end:
        length, number = struct.unpack_from("<bb", content, place)
        length = abs(length)  # negative: locked
        if length == 0 or number == 0:
            return
        name = content[place + 2 : place + 2 + length].decode("latin-1").strip().upper()
        body = place + 2 + length
        if body + 2 > end:
            raise _damaged("a parameter's name runs out of the parameter section")
        (step,) = struct.unpack_from("<H", content, body)
        if step == 1 or body + step > end:
            raise _damaged(f"the parameter {name!r} points outside the parameter section")
        following = body + step if step else end
        yield number, name, content[body + 2 : following]
        if not step:
            return
        place = following


def _values(record: bytes, name: str, dec: bool) -> list[str] | np.ndarray:
    """The strings or numbers of one parameter: type, number of dimensions, dimensions, data."""
    kind, rank = struct.unpack_from("<bB", record) if len(record) >= 2 else (0, 0)
    shape = tuple(record[2 : 2 + rank])
    size = abs(kind) * math.prod(shape)
    data = record[2 + rank : 2 + rank + size]
    if kind not in (-1, *_DTYPES) or len(shape) < rank or len(data) < size:
        raise _damaged(f"the parameter {name!r} is longer than its place")
    if kind == -1:
        width = shape[0] if shape else 1
        starts = range(0, size, width) if width else ()
        return [data[i : i + width].decode("latin-1").strip(" \0") for i in starts]
    if kind == 4:
        return floats_of(np.frombuffer(data, "<u2"), dec)
    return np.frombuffer(data, _DTYPES[kind])


def _damaged(why: str) -> InputError:
    return InputError(f"it is no whole C3D file ({why}); check that it was copied completely, or export it again.")
