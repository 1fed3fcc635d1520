"""C3D marker takes through ezc3d, with guards for what its files leave out or get wrong."""

from __future__ import annotations

import logging
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from blendcap.data import InputError, MarkerTake
from blendcap.io.atomic import write_whole
from blendcap.io.c3d_structure import MOST_COUNTED, Header, check_structure
from blendcap.io.opening import read_bytes, reading
from blendcap.io.units import millimetres

_MODEL_OUTPUTS = ("ANGLES", "FORCES", "POWERS", "MOMENTS", "SCALARS")

_log = logging.getLogger(__name__)


def read_c3d(path: str | os.PathLike, unit: str | None = None) -> MarkerTake:
    """Read a .c3d file; `unit` overrides POINT:UNITS.

    A marker is missing where its residual is negative or its position is NaN. Analog channels and model outputs
    (POINT:ANGLES, FORCES, MOMENTS, POWERS, SCALARS) are left out. A take of more than 65,535 frames, which the header
    cannot count, is read by the size of the file.
    """
    path = Path(path)
    with reading(path, "C3D file"):
        content = read_bytes(path)
        header = check_structure(content)
        file, positions, residuals = _long(path, content, header) if header.too_long else _short(path, header)
        point = file["parameters"]["POINT"]
        labels, outputs = _labels(point, positions.shape[1]), _model_outputs(point)
        keep = [i for i, label in enumerate(labels) if label not in outputs]
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
    """Write a take as .c3d, mm; a missing marker is (0, 0, 0) with residual -1, as the format wants it.

    The format keeps residuals in 127 steps of which the largest is the last.
    """
    import ezc3d

    if len(take.positions) > MOST_COUNTED:
        _log.warning("%s holds %d frames; other programs may read only the 65,535 that a C3D header can count.",
                     path, len(take.positions))  # fmt: skip
    residuals, step = _in_steps(take)
    file: Any = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["SCALE"]["value"] = [-step]  # negative: the positions are floats
    point["UNITS"]["value"], point["RATE"]["value"], point["LABELS"]["value"] = ["mm"], [take.rate], list(take.names)
    positions = np.nan_to_num(take.positions).transpose(2, 1, 0)
    file["data"]["points"] = np.concatenate([positions, np.ones((1, *positions.shape[1:]))])
    file["data"]["meta_points"]["residuals"] = np.where(take.missing, -1.0, residuals).T[None]
    with write_whole(path) as temporary:
        file.write(str(temporary))


def _in_steps(take: MarkerTake) -> tuple[np.ndarray, float]:
    """Residuals (T, M) rounded to whole steps, a hair above so that cutting to integers keeps them; and the step."""
    residuals = np.zeros(take.missing.shape) if take.residuals is None else np.nan_to_num(take.residuals)
    step = float(residuals.max()) / 127 or 1.0
    return np.minimum(np.round(residuals / step) + 1e-3, 127.0) * step, step


def _short(path: Path, header: Header) -> tuple[Any, np.ndarray, np.ndarray]:
    """The file, its positions (T, M, 3) and residuals (T, M) in its own unit, as ezc3d reads them."""
    file = _open(path)
    positions = file["data"]["points"][:3].transpose(2, 1, 0)
    if len(positions) < header.stated:  # ezc3d says nothing when a file ends early
        _log.warning("%s states %d frames, but ends after %d: it was cut short, and is read as far as it goes.",
                     path, header.stated, len(positions))  # fmt: skip
    return file, positions, file["data"]["meta_points"]["residuals"][0].T


def _long(path: Path, content: bytes, header: Header) -> tuple[Any, np.ndarray, np.ndarray]:
    """The same for a take that the header cannot count: ezc3d reads the parameters, the size counts the frames."""
    if not header.floats:
        raise InputError("it holds more than 65,535 frames that are not Intel floats; split it, or export it as such.")
    with tempfile.TemporaryDirectory() as folder:
        beginning = Path(folder) / "beginning.c3d"
        beginning.write_bytes(content[: header.offset + 2 * header.frame_bytes])
        file = _open(beginning)
    width = 4 * header.points + header.analog
    raw = np.frombuffer(content, "<f4", header.available * width, header.offset).reshape(-1, width)
    filled = np.flatnonzero(raw.any(1))  # the last block is padded with zeros
    raw = raw[: filled[-1] + 1] if len(filled) else raw
    _log.warning("%s holds %d frames, more than the 65,535 that its header can count; all are read.", path, len(raw))
    samples = raw[:, : 4 * header.points].reshape(len(raw), header.points, 4).astype(np.float64)
    words = samples[..., 3].astype(np.int64)  # the residual is the upper byte, in steps of the scale
    step = abs(float(_values(file["parameters"]["POINT"], "SCALE")[0]))
    return file, samples[..., :3], np.where(words < 0, -1.0, (words >> 8) * step)


def _open(path: Path) -> Any:
    import ezc3d

    try:
        return ezc3d.c3d(str(path))
    except Exception as error:  # ezc3d raises many kinds for what it does not support
        raise InputError(f"ezc3d refuses it ({str(error).split('.')[0]}); export it again as Intel C3D.") from error


def _labels(point: Any, count: int) -> list[str]:
    """The names of the points: LABELS, LABELS2, ... hold 255 each; a point without a name gets its number."""
    labels, number = list(_values(point, "LABELS")), 2
    while f"LABELS{number}" in point:
        labels += list(_values(point, f"LABELS{number}"))
        number += 1
    labels += [""] * (count - len(labels))
    return [label.strip() or f"unnamed{i}" for i, label in enumerate(labels[:count])]


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
        _log.warning("%d marker labels occur more than once and were numbered: %s.", len(doubles), ", ".join(doubles))
    return result
