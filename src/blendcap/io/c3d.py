"""C3D marker takes.

Reading is our own: ezc3d (1.7) counts no more than 65,535 frames, says nothing when a file ends early, and crashes the
interpreter on damaged parameters. Writing goes through ezc3d; on sound files both readers agree to the last bit.
"""

from __future__ import annotations

import logging
import os
from typing import Any

import numpy as np

from blendcap.data import InputError, MarkerTake
from blendcap.io.atomic import write_whole
from blendcap.io.c3d_parameters import BLOCK, Skeleton, floats_of, read_skeleton
from blendcap.io.opening import read_bytes, reading
from blendcap.io.units import millimetres

_MOST_COUNTED = 65535  # the header counts frames in 16 bits
_MODEL_OUTPUTS = ("ANGLES", "FORCES", "POWERS", "MOMENTS", "SCALARS")

_log = logging.getLogger(__name__)


def read_c3d(path: str | os.PathLike, unit: str | None = None) -> MarkerTake:
    """Read a .c3d file; `unit` overrides POINT:UNITS.

    A marker is missing where its residual is negative or its position is NaN. Analog channels and model outputs
    (POINT:ANGLES, FORCES, MOMENTS, POWERS, SCALARS) are left out. A take of more than 65,535 frames, which the header
    cannot count, is read by the size of the file.
    """
    with reading(path, "C3D file"):
        content = read_bytes(path)
        skeleton = read_skeleton(content)
        samples = _samples(content, skeleton, str(path))
        labels = _labels(skeleton)
        outputs = {label for group in _MODEL_OUTPUTS for label in skeleton.texts(group)}
        keep = [i for i, label in enumerate(labels) if label not in outputs]
        if not keep or not len(samples):
            raise InputError(f"{path} holds no markers or no frames; export the labelled take.")
        scale = millimetres(unit or _unit(skeleton), str(path))
        positions, residuals = scale * samples[:, keep, :3], scale * samples[:, keep, 3]
        missing = ~(residuals >= 0) | np.isnan(positions).any(2)
        positions[missing] = np.nan
        residuals[missing] = np.nan
        return MarkerTake(positions, _unique([labels[i] for i in keep]), skeleton.number("POINT", "RATE", 0), residuals)


def unit_of_c3d(path: str | os.PathLike) -> str:
    """POINT:UNITS as it stands in a .c3d file; empty if it states none."""
    with reading(path, "C3D file"):
        return _unit(read_skeleton(read_bytes(path)))


def write_c3d(path: str | os.PathLike, take: MarkerTake) -> None:
    """Write a take as .c3d, mm; a missing marker is (0, 0, 0) with residual -1, as the format wants it.

    The format keeps residuals in 127 steps of which the largest is the last.
    """
    import ezc3d

    if len(take.positions) > _MOST_COUNTED:
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


def _unit(skeleton: Skeleton) -> str:
    return next((unit for unit in skeleton.texts("UNITS") if unit), "")


def _samples(content: bytes, skeleton: Skeleton, where: str) -> np.ndarray:
    """x, y, z and residual (T, M, 4) in the unit of the file; the residual is negative where the marker is missing."""
    words_per_sample = 2 if skeleton.scale < 0 else 1
    width = (4 * skeleton.points + skeleton.analog) * words_per_sample
    room = (len(content) - skeleton.offset) // max(2 * width, 1)
    count = min(skeleton.frames, room)
    if room < skeleton.frames:
        _log.warning("%s states %d frames, but ends after %d: it was cut short, and is read as far as it goes.",
                     where, skeleton.frames, room)  # fmt: skip
    elif skeleton.frames == _MOST_COUNTED and room > skeleton.frames + BLOCK // (2 * width):
        _log.warning("%s holds more than the 65,535 frames that its header can count; all of them are read.", where)
        count = room
    words = np.frombuffer(content, "<u2", count * width, skeleton.offset).reshape(count, width)
    words = words[:, : 4 * skeleton.points * words_per_sample]
    if count > skeleton.frames:  # zeros fill the last block
        words = words[: np.flatnonzero(words.any(1)).max(initial=-1) + 1]
    if skeleton.scale < 0:
        samples = floats_of(words.ravel(), skeleton.dec).reshape(len(words), -1, 4).astype(np.float64)
    else:
        samples = words.view("<i2").reshape(len(words), -1, 4).astype(np.float64)
        samples[..., :3] *= skeleton.scale
    # The fourth value is an integer: cameras in its lower byte, the residual in steps of the scale in its upper.
    lost = ~(samples[..., 3] >= 0)
    bits = np.where(lost, 0, np.minimum(samples[..., 3], 32767)).astype(np.int64)
    step = abs(skeleton.number("POINT", "SCALE", skeleton.scale))
    samples[..., 3] = np.where(lost, -1.0, (bits >> 8) * step)
    return samples


def _in_steps(take: MarkerTake) -> tuple[np.ndarray, float]:
    """Residuals (T, M) rounded to whole steps, a hair above so that cutting to integers keeps them; and the step."""
    residuals = np.zeros(take.missing.shape) if take.residuals is None else np.nan_to_num(take.residuals)
    step = float(residuals.max()) / 127 or 1.0
    return np.minimum(np.round(residuals / step) + 1e-3, 127.0) * step, step


def _labels(skeleton: Skeleton) -> list[str]:
    """The names of the points: LABELS, LABELS2, ... hold 255 each; a point without a name gets its number."""
    labels, number = list(skeleton.texts("LABELS")), 2
    while extra := skeleton.texts(f"LABELS{number}"):
        labels, number = labels + extra, number + 1
    labels += [""] * (skeleton.points - len(labels))
    return [label or f"unnamed{i}" for i, label in enumerate(labels[: skeleton.points])]


def _unique(labels: list[str]) -> tuple[str, ...]:
    """Repeated labels with a number behind them; unlabelled trajectories often share one name."""
    seen: dict[str, int] = {}
    result = []
    for label in labels:
        seen[label] = seen.get(label, 0) + 1
        result.append(label if seen[label] == 1 else f"{label}#{seen[label]}")
    doubles = [label for label, times in seen.items() if times > 1]
    if doubles:
        _log.warning("%d marker labels occur more than once and were numbered: %s.", len(doubles), ", ".join(doubles))
    return tuple(result)
