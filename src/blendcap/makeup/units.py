"""The action units that makeup patches tell, the patches that tell them, and the shapes that they move."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Region(NamedTuple):
    """Patches that are looked at together, and the action units that are told apart in them."""

    name: str
    patches: tuple[str, ...]
    units: tuple[str, ...]


# Each unit on its own: a regression tells them side by side, also where they come together.
REGIONS: tuple[Region, ...] = (
    Region("brows", ("forehead_right", "forehead_left", "glabella"), ("AU1", "AU2", "AU4")),
    Region("nose", ("glabella", "nose_right", "nose_left"), ("AU9",)),
    Region("eyes", ("eye_right", "eye_left"), ("AU5", "AU6", "AU7", "AU45", "AU63", "AU64")),
    Region("mouth", ("mouth_right", "mouth_left"), ("AU10+12+18+23L", "AU10+12+18+23R")),
)
# Section 7.2.1 of Reading Between the Dots (2016): classes, of which a frame is in one. The last two are its sideways
# pucker, 10 + 12 + 18 + 23 on one side.
PAPER_REGIONS: tuple[Region, ...] = (
    REGIONS[0]._replace(units=("AU1+2", "AU4")),
    REGIONS[1],
    REGIONS[2]._replace(units=("AU7", "AU45", "AU6+43")),
    REGIONS[3],
)
SAME = {"43": "45"}  # a lid that is shut looks the same, long or short

# What each unit does on a rig with ARKit's names, at full intensity; a rig of other names brings a table of its own.
ARKIT_TABLE: Mapping[str, Mapping[str, float]] = {
    "AU1": {"browInnerUp": 1.0},
    "AU2": {"browOuterUpLeft": 1.0, "browOuterUpRight": 1.0},
    "AU5": {"eyeWideLeft": 1.0, "eyeWideRight": 1.0},
    "AU6": {"cheekSquintLeft": 1.0, "cheekSquintRight": 1.0},
    "AU63": {"eyeLookUpLeft": 1.0, "eyeLookUpRight": 1.0},
    "AU64": {"eyeLookDownLeft": 1.0, "eyeLookDownRight": 1.0},
    "AU1+2": {"browInnerUp": 1.0, "browOuterUpLeft": 1.0, "browOuterUpRight": 1.0},
    "AU4": {"browDownLeft": 1.0, "browDownRight": 1.0},
    "AU9": {"noseSneerLeft": 1.0, "noseSneerRight": 1.0},
    "AU7": {"eyeSquintLeft": 1.0, "eyeSquintRight": 1.0},
    "AU45": {"eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0},
    "AU6+43": {"cheekSquintLeft": 1.0, "cheekSquintRight": 1.0, "eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0},
    "AU10+12+18+23L": {"mouthPucker": 0.8, "mouthLeft": 1.0},
    "AU10+12+18+23R": {"mouthPucker": 0.8, "mouthRight": 1.0},
}


def shows(turn: str, unit: str) -> bool:
    """Whether who does `turn` shows `unit`: AU1+2+5 shows AU1, AU2 and AU5, and AU6+43 shows AU45."""
    done, asked = _parts(turn), _parts(unit)
    return done[1] == asked[1] and asked[0] <= done[0]


def _parts(name: str) -> tuple[frozenset[str], str]:
    """The numbers of a unit's name, and its side."""
    numbers = name.removeprefix("AU").rstrip("LR")
    return frozenset(SAME.get(number, number) for number in numbers.split("+")), name[len(name.rstrip("LR")) :]
