"""What a performer shows while a classifier is trained."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from blendcap.data import Animation, InputError
from blendcap.data.names import match
from blendcap.makeup.units import PAPER_REGIONS, REGIONS, Region, shows

log = logging.getLogger(__name__)

SEEN = 0.5  # confidence from which on a weight is taken for the truth


@dataclass(frozen=True, eq=False)
class Lesson:
    """What the performer did, frame by frame.

    Parameters
    ----------
    units : (T,) str
        The action unit that is being shown, from rest to rest; "" where none is.
    repetitions : (T,) int
        Which showing it is. Accuracies are measured on whole showings that were left out: neighboring frames are too
        alike to test each other.
    weights : Animation, optional
        What the rig did, solved from the markers of the same frames: how strongly a unit is shown is then read off its
        shapes, and not told from the pictures. Where its confidence is below a half it is not believed.
    """

    units: np.ndarray
    repetitions: np.ndarray
    weights: Animation | None = None

    def __post_init__(self):
        if self.weights is not None and len(self.weights.weights) != len(self.units):
            raise InputError(
                f"The lesson's weights have {len(self.weights.weights)} frames, but the lesson {len(self.units)}; "
                "solve the take of the lesson as it was filmed."
            )

    def intensity(self, shapes: Mapping[str, float]) -> np.ndarray:
        """(T,) how strongly the weights show a unit that moves these shapes: as its weakest one; NaN if not known.

        Shapes may be spelled otherwise than the weights' names, and be split there in left and right.
        """
        unknown = np.full(len(self.units), np.nan)
        if self.weights is None or not shapes:
            return unknown
        found = match(tuple(shapes), self.weights.names)
        if not all(found.get(name) for name in shapes):
            return unknown
        pairs = [(self.weights.names.index(own), shapes[name]) for name, owned in found.items() for own in owned]
        places, levels = (list(column) for column in zip(*pairs, strict=True))
        said = (self.weights.weights[:, places] / levels).min(1)
        trust = self.weights.confidence
        return said if trust is None else np.where(trust[:, places].min(1) >= SEEN, said, np.nan)

    @classmethod
    def of_spans(
        cls, spans: Sequence[tuple[float, float, str]], frames: int, rate: float, weights: Animation | None = None,
        offset: float = 0.0,
    ) -> Lesson:  # fmt: skip
        """From spans (start, end, unit), seconds, one a showing; the lesson's first frame is at `offset` seconds.

        Raises
        ------
        InputError
            If a showing begins before the first frame or ends after the last, or two overlap by more than a frame.
        """
        units, repetitions = np.full(frames, "", dtype=object), np.zeros(frames, dtype=int)
        for number, (start, end, unit) in enumerate(spans, 1):
            first, last = (start - offset) * rate, (end - offset) * rate
            if first < -1:
                raise InputError(
                    f"Showing {number}, of {unit} from {start:g} to {end:g} s, begins {-first / rate:.4g} s before the "
                    "film; leave it out, or correct the offset."
                )
            if last > frames + 1:
                raise InputError(
                    f"Showing {number}, of {unit} from {start:g} to {end:g} s, ends after the lesson, which lasts "
                    f"until {offset + frames / rate:.4g} s; showings are told in seconds from the take's first frame."
                )
            part = slice(max(round(first), 0), round(last))
            taken = np.flatnonzero(repetitions[part])
            if len(taken) > 1:
                other = repetitions[part][taken[0]]
                raise InputError(
                    f"Showings {other} and {number}, of {units[part][taken[0]]} and {unit}, overlap; tell what was "
                    "shown together as one showing, such as AU1+2, and the rest one after the other."
                )
            units[part], repetitions[part] = unit, number
        return cls(units, repetitions, weights)


def regions_of(method: str) -> tuple[Region, ...]:
    """What a method of training tells if nobody says otherwise: single units, or the papers' classes."""
    return REGIONS if method == "intensity" else PAPER_REGIONS


def counts(turn: str, unit: str, method: str) -> bool:
    """Whether a turn teaches a unit: of classes a frame is in one."""
    return turn == unit if method == "svm" else shows(turn, unit)


def _foreign_turns(lessons: Sequence[Lesson], regions: Sequence[Region], method: str) -> list[str]:
    """What the lessons show that teaches no unit of the regions.

    Raises
    ------
    InputError
        If that is all that they show.
    """
    shown, known = _shown(lessons), _known(regions)
    foreign = sorted(turn for turn in shown if not any(counts(turn, unit, method) for unit in known))
    if len(foreign) == len(shown):
        raise InputError(
            f"The lesson shows none of the units of the regions ({', '.join(known)}); it shows "
            + (", ".join(foreign) or "nothing")
            + "."
        )
    return foreign


def untold_units(
    lessons: Sequence[Lesson], regions: Sequence[Region], method: str, table: Mapping[str, Mapping[str, float]]
) -> list[str]:
    """Units that lessons with weights show, and of which those weights tell nothing.

    Raises
    ------
    InputError
        If they tell of none.
    """
    asked, told = set(), set()
    for lesson in (lesson for lesson in lessons if lesson.weights is not None):
        turns = _shown([lesson])
        own = {unit for unit in _known(regions) if any(counts(turn, unit, method) for turn in turns)}
        asked |= own
        told |= {unit for unit in own if np.isfinite(lesson.intensity(table.get(unit, {}))).any()}
    if asked and not told:
        raise InputError(
            f"The lesson's weights tell of none of its units ({', '.join(sorted(asked))}) how strongly it is shown: "
            "they have other shapes, or trust none; give the solved take of the lesson, or a table from units to its "
            "shapes."
        )
    return sorted(asked - told)


def check_lessons(
    lessons: Sequence[Lesson], regions: Sequence[Region], method: str, table: Mapping[str, Mapping[str, float]]
) -> None:
    """Refuse, before any film is looked at, lessons of which nothing could be learned.

    Raises
    ------
    InputError
        If they show no unit of the regions, each unit only once, or their weights tell of none.
    """
    _foreign_turns(lessons, regions, method)
    if method == "svm":
        if any(lesson.weights is not None for lesson in lessons):
            log.warning("The papers' classes are learned from the pictures alone; the lesson's weights are not used.")
    else:
        untold_units(lessons, regions, method, table)
    showings = {(k, n): turn for k, lesson in enumerate(lessons)
                for n, turn in zip(lesson.repetitions, lesson.units, strict=True) if turn}  # fmt: skip
    if len(set(showings.values())) == len(showings):
        raise InputError("The lesson shows each unit only once; let the performer repeat it 4 times.")


def shown_turns(
    lessons: Sequence[Lesson], regions: Sequence[Region], method: str, table: Mapping[str, Mapping[str, float]]
) -> set[str]:
    """All that the lessons show; what teaches nothing is named, and if all is such, refused."""
    untold = untold_units(lessons, regions, method, table)
    if untold:
        log.warning(
            "The lesson's weights do not tell how strongly %s are shown, and the pictures must: the shapes are not "
            "there, or no marker saw them.", ", ".join(untold),
        )  # fmt: skip
    foreign = _foreign_turns(lessons, regions, method)
    if foreign:
        log.warning(
            "The showings of %s teach none of the units that are told: %s.",
            ", ".join(foreign), ", ".join(_known(regions)),
        )  # fmt: skip
    return _shown(lessons)


def _shown(lessons: Sequence[Lesson]) -> set[str]:
    return {unit for lesson in lessons for unit in lesson.units} - {""}


def _known(regions: Sequence[Region]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(unit for region in regions for unit in region.units))
