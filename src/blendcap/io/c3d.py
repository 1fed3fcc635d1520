"""C3D marker takes through ezc3d, with guards for what its files leave out or get wrong."""

from __future__ import annotations

import logging
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blendcap.data import InputError, MarkerTake
from blendcap.io.atomic import write_whole
from blendcap.io.opening import read_bytes, reading
from blendcap.io.units import millimetres

_BLOCK = 512
_MOST_COUNTED = 65535  # the header counts frames in 16 bits
_MODEL_OUTPUTS = ("ANGLES", "FORCES", "POWERS", "MOMENTS", "SCALARS")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Header:
    """The counts of a C3D header that say how large its data must be."""

    points: int
    analog: int
    declared: int
    start: int
    bytes_per_frame: int
    available: int
    floats: bool

    @property
    def too_long(self) -> bool:
        """More frames in the file than 16 bits can count: what is left of the last block is not a frame."""
        spare = _BLOCK // max(self.bytes_per_frame, 1) + 1
        return self.declared >= _MOST_COUNTED and self.available > self.declared + spare


def read_c3d(path: str | os.PathLike, unit: str | None = None) -> MarkerTake:
    """Read a .c3d file; `unit` overrides POINT:UNITS.

    A marker is missing where its residual is negative or its position is NaN. Analog channels and model outputs
    (POINT:ANGLES, FORCES, MOMENTS, POWERS, SCALARS) are left out. A take of more than 65,535 frames, which the header
    cannot count, is read by the size of the file.
    """
    path = Path(path)
    with reading(path, "C3D file"):
        header = _read_header(path, read_bytes(path))
        file = _open(path)
        point = file["parameters"]["POINT"]
        labels = _labels(point, header.points)
        positions, residuals = _samples(path, file, header)
        keep = [i for i, label in enumerate(labels) if label not in _model_outputs(point)]
        if not keep or not len(positions):
            raise InputError(f"{path} holds no markers or no frames; export the labelled take.")
        units = [u for u in _values(point, "UNITS") if u.strip()]
        scale = millimetres(unit or (units[0] if units else ""), str(path))
        missing = ~(residuals >= 0) | np.isnan(positions).any(2)
        positions = np.where(missing[..., None], np.nan, scale * positions)
        residuals = np.where(missing, np.nan, scale * residuals)
        rate = float(next(iter(_values(point, "RATE")), 0.0))
        names = tuple(_unique([labels[i] for i in keep]))
        return MarkerTake(positions[:, keep], names, rate, residuals[:, keep])


def write_c3d(path: str | os.PathLike, take: MarkerTake) -> None:
    """Write a take as .c3d, mm; a missing marker is (0, 0, 0) with residual -1, as the format wants it."""
    import ezc3d

    if len(take.positions) > _MOST_COUNTED:
        _log.warning("%s holds %d frames; other programs may read only the 65,535 that a C3D header can count.",
                     path, len(take.positions))  # fmt: skip
    residuals = np.zeros(take.missing.shape) if take.residuals is None else np.nan_to_num(take.residuals)
    file: Any = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["UNITS"]["value"], point["RATE"]["value"], point["LABELS"]["value"] = ["mm"], [take.rate], list(take.names)
    positions = np.nan_to_num(take.positions).transpose(2, 1, 0)
    file["data"]["points"] = np.concatenate([positions, np.ones((1, *positions.shape[1:]))])
    file["data"]["meta_points"]["residuals"] = np.where(take.missing, -1.0, residuals).T[None]
    with write_whole(path) as temporary:
        file.write(str(temporary))


def _open(path: Path) -> Any:
    import ezc3d

    try:
        return ezc3d.c3d(str(path))
    except Exception as error:  # ezc3d raises many kinds for what it does not support
        raise InputError(f"Cannot read {path}: ezc3d refuses it ({error}); export it again as Intel C3D.") from error


def _read_header(path: Path, content: bytes) -> _Header:
    """Check the size that the header declares against the file before anything is allocated.

    C3D user guide, "The header section"; little-endian and real or integer data by the sign of the scale.
    """
    if len(content) < 2 * _BLOCK or content[1] != 0x50:
        raise InputError(f"Cannot read {path}: it is no C3D file.")
    parameters = (content[0] - 1) * _BLOCK
    processor = content[parameters + 3] if parameters + 3 < len(content) else 0
    if processor != 84:
        maker = {85: "DEC", 86: "MIPS (SGI)"}.get(processor, "an unknown processor")
        raise InputError(f"Cannot read {path}: it is a C3D of {maker}; export it again as Intel C3D.")
    points, analog, first, last = struct.unpack_from("<HHHH", content, 2)
    scale, start = struct.unpack_from("<fH", content, 12)
    sample = 4 if scale < 0 else 2
    size = (4 * points + analog) * sample
    room = len(content) - (start - 1) * _BLOCK
    declared, available = last - first + 1, max(room, 0) // max(size, 1)
    if available < declared:
        raise InputError(
            f"Cannot read {path}: it declares {declared} frames and has room for {available}; it is cut short."
        )
    return _Header(points, analog, declared, start, size, available, scale < 0)


def _samples(path: Path, file: Any, header: _Header) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, M, 3) and residuals (T, M), in the unit of the file."""
    if header.too_long:
        _log.warning("%s holds %d frames, more than the 65,535 that its header can count; all are read.",
                     path, header.available)  # fmt: skip
        return _by_size(path, header)
    positions = file["data"]["points"][:3].transpose(2, 1, 0)
    return positions, file["data"]["meta_points"]["residuals"][0].T


def _by_size(path: Path, header: _Header) -> tuple[np.ndarray, np.ndarray]:
    if not header.floats:
        raise InputError(
            f"Cannot read {path}: it holds more than 65,535 frames of integers; split it, or export floats."
        )
    shape = (header.available, header.points * 4 + header.analog)
    raw = np.memmap(path, "<f4", "r", offset=(header.start - 1) * _BLOCK, shape=shape)
    points = raw[:, : 4 * header.points].reshape(len(raw), header.points, 4)
    return np.array(points[..., :3], np.float64), np.array(points[..., 3], np.float64)


def _labels(point: Any, count: int) -> list[str]:
    """The names of the points: LABELS, LABELS2, ... hold 255 each; a point without a name gets its number."""
    labels = list(_values(point, "LABELS"))
    number = 2
    while f"LABELS{number}" in point:
        labels += list(_values(point, f"LABELS{number}"))
        number += 1
    named = [label.strip() or f"unnamed{i}" for i, label in enumerate(labels[:count])]
    return named + [f"unnamed{i}" for i in range(len(named), count)]


def _model_outputs(point: Any) -> set[str]:
    return {label.strip() for group in _MODEL_OUTPUTS for label in _values(point, group)} - {""}


def _values(point: Any, name: str) -> Any:
    return point[name].get("value", ()) if name in point else ()


def _unique(labels: list[str]) -> list[str]:
    """Repeated labels with a number behind them; unlabelled trajectories often share one name."""
    seen: dict[str, int] = {}
    result = []
    for label in labels:
        seen[label] = seen.get(label, 0) + 1
        result.append(label if seen[label] == 1 else f"{label}#{seen[label]}")
    doubles = [label for label, times in seen.items() if times > 1]
    if doubles:
        _log.warning(
            "%d marker labels occur more than once and were numbered: %s.", len(doubles), ", ".join(doubles[:6])
        )
    return result
