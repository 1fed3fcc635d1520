"""The action units that makeup patches tell, the patches that tell them, and the shapes that they move."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple


class Region(NamedTuple):
    """Patches that are looked at together, and the action units that are told apart in them."""

    name: str
    patches: tuple[str, ...]
    units: tuple[str, ...]
    features: str = "gabor"  # what is seen of a patch; several are joined by +
    aligned: bool = True  # whether another face is laid over the training face first


FOREHEAD = ("forehead_right", "forehead_left", "glabella")

# Each unit on its own: a regression tells them side by side, also where they come together. What is seen and whether
# faces are laid over each other was chosen on the tuning takes: motion of strokes is like from face to face as it is.
REGIONS: tuple[Region, ...] = (
    Region(
        "brows", (*FOREHEAD, "nose_right", "nose_left"),  # a sneer is no frown
        ("AU1", "AU2L", "AU2R", "AU4L", "AU4R"), "motion", aligned=False,
    ),
    Region(
        "nose", ("glabella", "nose_right", "nose_left", "mouth_right", "mouth_left"),  # the upper lip rises, too
        ("AU9L", "AU9R"), "fine", aligned=False,
    ),
    Region(
        "eyes", ("eye_right", "eye_left"),
        ("AU5L", "AU5R", "AU6L", "AU6R", "AU7L", "AU7R", "AU45L", "AU45R", "AU63L", "AU63R", "AU64L", "AU64R"),
        "gabor+fine", aligned=False,
    ),
    Region(
        "mouth", ("mouth_right", "mouth_left"),
        ("AU10L", "AU10R", "AU12L", "AU12R", "AU15L", "AU15R", "AU18", "AU20L", "AU20R", "AU26"),
        "fine",
    ),
)  # fmt: skip
# Section 7.2.1 of Reading Between the Dots (2016): classes, of which a frame is in one. The last two are its sideways
# pucker, 10 + 12 + 18 + 23 on one side.
PAPER_REGIONS: tuple[Region, ...] = (
    Region("brows", FOREHEAD, ("AU1+2", "AU4")),
    Region("nose", ("glabella",), ("AU9",)),
    Region("eyes", REGIONS[2].patches, ("AU7", "AU45", "AU6+43")),
    Region("mouth", REGIONS[3].patches, ("AU10+12+18+23L", "AU10+12+18+23R")),
)
SAME = {"43": "45"}  # a lid that is shut looks the same, long or short

_SIDED = {
    "AU2": "browOuterUp", "AU4": "browDown", "AU5": "eyeWide", "AU6": "cheekSquint", "AU7": "eyeSquint",
    "AU9": "noseSneer", "AU10": "mouthUpperUp", "AU12": "mouthSmile", "AU15": "mouthFrown", "AU20": "mouthStretch",
    "AU45": "eyeBlink", "AU63": "eyeLookUp", "AU64": "eyeLookDown",
}  # fmt: skip
# What each unit does on a rig with ARKit's names, at full intensity; a rig of other names brings a table of its own.
ARKIT_TABLE: Mapping[str, Mapping[str, float]] = {
    "AU1": {"browInnerUp": 1.0},
    "AU18": {"mouthPucker": 1.0},
    "AU26": {"jawOpen": 1.0},
    **{unit: {f"{shape}Left": 1.0, f"{shape}Right": 1.0} for unit, shape in _SIDED.items()},
    **{f"{unit}L": {f"{shape}Left": 1.0} for unit, shape in _SIDED.items()},
    **{f"{unit}R": {f"{shape}Right": 1.0} for unit, shape in _SIDED.items()},
    "AU1+2": {"browInnerUp": 1.0, "browOuterUpLeft": 1.0, "browOuterUpRight": 1.0},
    "AU6+43": {"cheekSquintLeft": 1.0, "cheekSquintRight": 1.0, "eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0},
    "AU10+12+18+23L": {"mouthPucker": 0.8, "mouthLeft": 1.0},
    "AU10+12+18+23R": {"mouthPucker": 0.8, "mouthRight": 1.0},
}


def shows(turn: str, unit: str) -> bool:
    """Whether who does `turn` shows `unit`: AU1+2+5 shows AU1, AU2L and AU5R, AU6+43 shows AU45, AU45L not AU45R."""
    done, asked = _parts(turn), _parts(unit)
    return (not asked[1] or done[1] in ("", asked[1])) and asked[0] <= done[0]


def shown_as_one(units: Sequence[str], turns: Collection[str]) -> dict[str, list[int]]:
    """Places of the units by name; those that only ever come together, as both sides do, are one: AU2, AU1+2."""
    found: dict[frozenset[str], list[int]] = {}
    for place, unit in enumerate(units):
        found.setdefault(frozenset(turn for turn in turns if shows(turn, unit)), []).append(place)
    return {_joint_name([units[place] for place in places]): places for places in found.values()}


def _joint_name(units: Sequence[str]) -> str:
    if len(units) == 1 or not all(unit.startswith("AU") for unit in units):
        return "+".join(units)
    numbers = dict.fromkeys(n for unit in units for n in unit.removeprefix("AU").rstrip("LR").split("+"))
    sides = {_parts(unit)[1] for unit in units} - {""}
    return f"AU{'+'.join(numbers)}{sides.pop() if len(sides) == 1 else ''}"


def _parts(name: str) -> tuple[frozenset[str], str]:
    """The numbers of a unit's name, and its side."""
    numbers = name.removeprefix("AU").rstrip("LR")
    return frozenset(SAME.get(number, number) for number in numbers.split("+")), name[len(name.rstrip("LR")) :]
