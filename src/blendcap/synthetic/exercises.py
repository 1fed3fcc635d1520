"""Exercises that a performer does for the cameras: action units one by one, and the two extremes of the thesis."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blendcap.data import Animation, InputError, Rig
from blendcap.data.correctives import needs
from blendcap.data.facs import SHAPES, shapes_of
from blendcap.data.names import match
from blendcap.synthetic.performances import for_rig, play, with_correctives

TRAINED: tuple[str, ...] = ("1+2", "4", "7", "9", "45", "6+43", "10L+12L+18L+23L", "10R+12R+18R+23R")
"""What a performer did to train the classifiers (thesis 4.1.11): seven exercises, the last of them to each side."""
WITH = {8: 26, 19: 26}  # what a unit is never seen without
ASIDE = (30,)  # goes to one side or the other
INSTEAD = {43: 45, 23: 24, 27: 26, 13: 12, 11: 10}  # the unit that looks most alike, for rigs that lack one
RISE, HOLD, REST = 0.40, 0.35, 0.55  # seconds
EXTREME = 4.0  # seconds that each of the papers' two extremes takes
LEAST = 0.25  # intensity of the first time


@dataclass(frozen=True, eq=False)
class Exercise:
    """An animation and the action units that it shows.

    Parameters
    ----------
    animation : Animation
        By the rig's shapes.
    labels : Animation
        Intensity of each action unit, 0 to 1: AU4, or AU12L where it moves on the left only.
    turns : tuple of (what, start, stop, intensity)
        Each time that something was done: `1+2`, first frame, frame after the last, and how strongly.
    """

    animation: Animation
    labels: Animation
    turns: tuple[tuple[str, int, int, float], ...]


def action_units(
    rig: Rig, units: Sequence[str] | None = None, *, rate: float = 60.0, repeats: int = 5, seed: int = 0
) -> Exercise:
    """Each action unit several times at rising intensity, from rest to rest, with the truth of every frame.

    Parameters
    ----------
    rig : Rig
        Its shapes are found by their names.
    units : sequence of str, optional
        What to do, such as "4", "1+2" or "10L+12L" (L and R are the subject's); `TRAINED` are those of the thesis.
        All units that the rig has shapes for if not given.
    rate : float
        Frames a second.
    repeats : int
        How often each; the intensity rises from 0.25 to 1, with a person's unevenness in time and strength.
    seed : int

    Raises
    ------
    InputError
        If a unit is misspelt, or the rig has no shape for it.
    """
    if repeats < 1:
        raise InputError(f"An exercise needs at least one repeat, but {repeats!r} were asked for.")
    rng, now, turns = np.random.default_rng(seed), 0.4, []
    shape_cues, label_cues = [], []
    for exercise in _possible(rig) if units is None else units:
        parts = [(_label(part), _shapes(rig, part)) for part in exercise.split("+")]
        for intensity in _rising(repeats, rng):
            rise, hold = RISE * rng.uniform(0.8, 1.25), HOLD * rng.uniform(0.7, 1.4)
            end = now + 2 * rise + hold
            cue = (now, end, intensity, rise, rise)
            label_cues += [(label, *cue) for label, _ in parts]
            shape_cues += [(name, *cue) for name in dict.fromkeys(n for _, names in parts for n in names)]
            turns.append((exercise, int(np.ceil(now * rate)), int(end * rate) + 1, float(intensity)))
            now = end + REST * rng.uniform(0.8, 1.3)
    labels = tuple(dict.fromkeys(label for label, *_ in label_cues))
    animation = with_correctives(play(shape_cues, rig.names, rate, now), rig)
    return Exercise(animation, play(label_cues, labels, rate, now), tuple(turns))


def lip_swing(rig: Rig, rate: float = 60.0) -> Animation:
    """The lips, puckered, swing from one side to the other: the first extreme of the thesis (4.2.13)."""
    half, span = 0.3, (EXTREME - 1.0) / 4
    cues = [("mouthPucker", 0.2, EXTREME - 0.2, 0.75, half, half), ("mouthFunnel", 0.2, EXTREME - 0.2, 0.2, half, half)]
    for turn in range(4):
        side, start = ("Left", "Right")[turn % 2], 0.45 + turn * span
        for name, level in ((f"mouth{side}", 1.0), (f"jaw{side}", 0.35), (f"noseSneer{side}", 0.2)):
            cues.append((name, start, start + 1.15 * span, level, span / 2, span / 2))
    return _named(cues, rig, rate, EXTREME)


def frown(rig: Rig, rate: float = 60.0) -> Animation:
    """Brows down and together, the corners of the mouth down, twice: the second extreme of the thesis (4.2.13)."""
    levels = {"browDown": 1.0, "mouthFrown": 1.0, "eyeSquint": 0.45, "noseSneer": 0.3, "mouthPress": 0.2}
    cues = []
    for start, level in ((0.3, 0.6), (EXTREME / 2 + 0.1, 1.0)):
        cue = (start, start + EXTREME / 2 - 0.4)
        cues += [(name + side, *cue, level * share, 0.45, 0.45) for name, share in levels.items()
                 for side in ("Left", "Right")]  # fmt: skip
        cues.append(("mouthShrugLower", *cue, 0.6 * level, 0.45, 0.45))
    return _named(cues, rig, rate, EXTREME)


def _named(cues: list[tuple], rig: Rig, rate: float, seconds: float) -> Animation:
    names = tuple(dict.fromkeys(name for name, *_ in cues))
    return for_rig(play(cues, names, rate, seconds), rig)


def _rising(repeats: int, rng: np.random.Generator) -> np.ndarray:
    """Intensities that rise from the least to 1, unevenly."""
    step = (1 - LEAST) / max(repeats - 1, 1)
    return np.linspace(LEAST if repeats > 1 else 1.0, 1, repeats) - np.append(
        rng.uniform(-0.3, 0.3, repeats - 1) * step, 0
    )


def _possible(rig: Rig) -> list[str]:
    """Every action unit for which the rig has shapes of its own, in the system's order."""
    numbers = sorted({int(shape.facs) for shape in SHAPES if shape.facs.isdigit()})
    units = []
    for unit in (unit for unit in numbers if match(shapes_of(unit), rig.names)):
        company = [str(unit), str(WITH[unit])] if unit in WITH else [str(unit)]
        units += [f"{unit}L", f"{unit}R"] if unit in ASIDE else ["+".join(company)]
    return units


def _part(text: str) -> tuple[int, str]:
    found = re.fullmatch(r"\s*(\d+)([LR]?)\s*", text)
    if not found:
        raise InputError(f"{text!r} is no action unit; write 4, 1+2, or 12L for the subject's left.")
    return int(found.group(1)), found.group(2)


def _label(text: str) -> str:
    unit, side = _part(text)
    return f"AU{unit}{side}"


def _shapes(rig: Rig, text: str) -> list[str]:
    """The rig's shapes for a part of an exercise; those of the unit that looks most alike if it has none."""
    unit, side = _part(text)
    word = {"L": "Left", "R": "Right", "": ""}[side]
    for number in dict.fromkeys((unit, INSTEAD.get(unit, unit))):
        for way in dict.fromkeys((word.lower() or "both", "both")):  # a whole where there are no halves
            meant = shapes_of(number, way)
            meant = [name for name in meant if name.endswith(word)] or meant
            names = [target for targets in match(meant, rig.names).values() for target in targets]
            if names:
                return list(dict.fromkeys([*names, *(need for name in names for need in needs(rig, name))]))
    raise InputError(f"The rig {rig.name!r} has no shape for action unit {unit}; leave {text!r} out.")
