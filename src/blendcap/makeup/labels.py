"""How strongly each frame of a lesson shows each unit, without anybody typing numbers.

The papers' way (thesis 4.1.11): the place along the largest mode of variation, for the machine of classes cut into
levels. Better, where the take of the lesson was solved: the weights that its markers gave.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from blendcap.data import InputError
from blendcap.makeup.intensity import LEVELS, measure_intensity
from blendcap.makeup.lesson import Lesson
from blendcap.makeup.patches import Patches
from blendcap.makeup.units import Region

SOFT = 3.0  # pixels of blur before the modes of variation are sought
FOLDS = 5
STILL = 1e-4  # of white, root mean square: patches that change by less do not move


class Labels(NamedTuple):
    """Of all frames of all takes, one take after the other."""

    amounts: np.ndarray  # (T, U) intensities
    classes: np.ndarray  # (T,) int, 0 at rest, else 1 + unit * (LEVELS - 1) + level - 1
    folds: np.ndarray  # (T,) int; whole showings are in one fold


def labeled(
    takes: Sequence[tuple[Patches, Lesson]],
    region: Region,
    teaches: Callable[[str, str], bool],
    table: Mapping[str, Mapping[str, float]],
    seed: int,
) -> Labels:
    """The labels of a region's units.

    Units that are shown together rise and fall together, along one mode of their own.

    Parameters
    ----------
    teaches : (turn, unit) -> bool
    table : {unit: {shape: weight}}
        For lessons with weights.
    """
    moved = np.concatenate([_moved(patches, region) for patches, _ in takes])
    turns = np.concatenate([lesson.units for _, lesson in takes])
    classes, amounts = np.zeros(len(moved), dtype=int), np.zeros((len(moved), len(region.units)))
    for turn in sorted(set(turns) - {""}, key=lambda turn: (-len(turn), turn)):
        taught = np.flatnonzero([teaches(turn, unit) for unit in region.units])
        if not len(taught):
            continue
        own = np.flatnonzero(turns == turn)
        _check_moves(moved[own], turn, region.name)
        scale = measure_intensity(moved[own], np.zeros(moved.shape[1]), seed)
        level = scale.level(moved[own])
        amounts[np.ix_(own, taught)] = scale.amount(moved[own])[:, None]
        classes[own] = np.where(level > 0, taught[0] * (LEVELS - 1) + level, 0)
    for column, unit in enumerate(region.units):
        known = np.concatenate([lesson.intensity(table.get(unit, {})) for _, lesson in takes])
        amounts[:, column] = np.where(np.isnan(known), amounts[:, column], known)
    return Labels(amounts, classes, _folds([lesson for _, lesson in takes]))


def _moved(patches: Patches, region: Region) -> np.ndarray:
    """(T, D) how a region's soft pictures differ from those at rest."""
    pairs = zip(patches.of(region.patches), (patches.neutral[name] for name in region.patches), strict=True)
    return np.concatenate([soft(frames) - soft(rest[None]) for frames, rest in pairs], axis=1)


def _check_moves(motion: np.ndarray, turn: str, region: str) -> None:
    """Refuse showings that show nothing: a frozen film would be told perfectly, and tell nothing."""
    if len(motion) < LEVELS:
        raise InputError(f"The lesson shows {turn} in {len(motion)} frames; it takes at least {LEVELS}.")
    if np.sqrt((motion**2).mean()) < STILL:
        raise InputError(
            f"Where the lesson shows {turn}, the patches of the region {region!r} do not move; check that the video "
            "plays and that its times are those of the showings."
        )


def soft(frames: np.ndarray) -> np.ndarray:
    """Pictures (T, h * w / 4), blurred: a thin stroke that moves by more than its width still moves along one mode."""
    import cv2

    size = (frames.shape[2] // 2, frames.shape[1] // 2)
    blurred = [
        cv2.resize(cv2.GaussianBlur(frame, (0, 0), SOFT), size, interpolation=cv2.INTER_AREA) for frame in frames
    ]
    return np.stack(blurred).reshape(len(frames), -1).astype(np.float32) / 255


def _folds(lessons: Sequence[Lesson]) -> np.ndarray:
    """(T,) which fold a frame is in: the k-th showing of a unit, with the rest after it, is in fold k modulo FOLDS."""
    folds, seen = [], {}
    for lesson in lessons:
        fold, last = 0, None
        for unit, repetition in zip(lesson.units, lesson.repetitions, strict=True):
            if unit and repetition != last:
                fold = seen.get(unit, 0)
                seen[unit], last = fold + 1, repetition
            folds.append(fold % FOLDS)
    return np.array(folds)
