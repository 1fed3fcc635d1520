"""The skeleton of a C3D file, walked before ezc3d sees it: its reader trusts every length and can crash on a bad one.

C3D user guide (C3D.ORG), "The header section" and "The parameter section".
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from blendcap.data import InputError

BLOCK = 512
MOST_COUNTED = 65535  # frames are counted in 16 bits
_INTEL, _DEC, _MIPS = 84, 85, 86


@dataclass(frozen=True)
class Header:
    """What a C3D says about its size, and how much the file has room for.

    Parameters
    ----------
    points : int
        Points a frame.
    analog : int
        Analog samples a frame.
    stated : int
        Frames, by the header or by POINT:FRAMES, whichever is fewer.
    offset : int
        Byte where the data start.
    available : int
        Frames that fit between there and the end of the file.
    floats : bool
        Samples are Intel floats.
    """

    points: int
    analog: int
    stated: int
    offset: int
    available: int
    floats: bool

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame of Intel floats."""
        return 4 * (4 * self.points + self.analog)

    @property
    def too_long(self) -> bool:
        """More frames in the file than 16 bits can count; what is left of the last block is no frame."""
        spare = BLOCK // max(self.frame_bytes, 1)
        return self.stated >= MOST_COUNTED and self.available > MOST_COUNTED + spare


@dataclass(frozen=True)
class _Parameter:
    group: int
    name: str
    kind: int  # -1 text, 1 byte, 2 integer, 4 float; 0 marks a group
    dimensions: tuple[int, ...]
    data: bytes


def check_structure(content: bytes) -> Header:
    """Walk header and parameters of a C3D and return the counts; InputError where it is no whole C3D."""
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
    start, subframes = struct.unpack_from("<HH", content, 16)
    offset = (start - 1) * BLOCK
    if not section < offset <= len(content) or last < first:
        raise _damaged("its header points outside the file")
    parameters = {}
    groups = {}
    for parameter in _walk(content, section, offset):
        if parameter.kind == 0:
            groups[parameter.group] = parameter.name
        else:
            parameters[parameter.group, parameter.name] = parameter
    named = {(groups.get(group, ""), name): p for (group, name), p in parameters.items()}
    _check_counts(named, points, analog, subframes)
    floats = bool(content[15 if processor == _INTEL else 13] & 0x80)  # DEC swaps the halves of a float
    frame = (4 * points + analog) * (4 if floats else 2)
    available = (len(content) - offset) // max(frame, 1)
    stated = min(last - first + 1, _integer(named, "POINT", "FRAMES", MOST_COUNTED))
    return Header(points, analog, stated, offset, available, floats and processor == _INTEL)


def _walk(content: bytes, section: int, end: int) -> Iterator[_Parameter]:
    """The groups and parameters one after the other, every length checked against the section."""
    place = section + 4
    while place + 2 <= end:
        length, group = struct.unpack_from("<bb", content, place)
        length = abs(length)  # negative: locked
        if length == 0:
            return
        name = content[place + 2 : place + 2 + length].decode("latin-1").strip().upper()
        body = place + 2 + length
        if body + 2 > end or group == 0:
            raise _damaged("a parameter's name runs out of the parameter section")
        (step,) = struct.unpack_from("<H", content, body)
        following = body + step if step else end
        if following > end or (step and step < 3):
            raise _damaged(f"the parameter {name!r} points outside the parameter section")
        if group < 0:
            yield _Parameter(-group, name, 0, (), b"")
        else:
            yield _parameter(content[body + 2 : following], group, name)
        if not step:
            return
        place = following
    raise _damaged("its parameters have no end")


def _parameter(record: bytes, group: int, name: str) -> _Parameter:
    kind, rank = struct.unpack_from("<bB", record) if len(record) >= 2 else (0, 0)
    dimensions = tuple(record[2 : 2 + rank])
    size = abs(kind) * math.prod(dimensions)
    if kind not in (-1, 1, 2, 4) or len(dimensions) < rank or 2 + rank + size > len(record):
        raise _damaged(f"the parameter {name!r} is longer than its place")
    return _Parameter(group, name, kind, dimensions, record[2 + rank : 2 + rank + size])


def _check_counts(named: dict[tuple[str, str], _Parameter], points: int, analog: int, subframes: int) -> None:
    """The counts that ezc3d takes from the parameters must be those of the header, which the file size confirms."""
    if ("POINT", "USED") not in named or _integer(named, "POINT", "USED", 0) != points:
        raise _damaged("its header and its parameter POINT:USED count different points")
    channels = _integer(named, "ANALOG", "USED", 0)
    if analog != channels * max(subframes, 1) and analog:
        raise _damaged("its header and its parameter ANALOG:USED count different channels")


def _integer(named: dict[tuple[str, str], _Parameter], group: str, name: str, default: int) -> int:
    found = named.get((group, name))
    if found is None or found.kind != 2 or len(found.data) < 2:
        return default
    return struct.unpack_from("<H", found.data)[0]


def _damaged(why: str) -> InputError:
    return InputError(f"it is no whole C3D file ({why}); check that it was copied completely, or export it again.")
