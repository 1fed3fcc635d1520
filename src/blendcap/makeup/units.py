"""The action units that makeup patches tell, the patches that tell them, and the shapes that they move."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Region(NamedTuple):
    """Patches that are looked at together, and the action units that are told apart in them."""

    name: str
    patches: tuple[str, ...]
    units: tuple[str, ...]


# Section 7.2.1 of Reading Between the Dots (2016); the last two are its sideways pucker, 10 + 12 + 18 + 23 on one side.
REGIONS: tuple[Region, ...] = (
    Region("brows", ("forehead_right", "forehead_left", "glabella"), ("AU1+2", "AU4")),
    Region("nose", ("glabella", "nose_right", "nose_left"), ("AU9",)),
    Region("eyes", ("eye_right", "eye_left"), ("AU7", "AU45", "AU6+43")),
    Region("mouth", ("mouth_right", "mouth_left"), ("AU10+12+18+23L", "AU10+12+18+23R")),
)

# What each unit does on a rig with ARKit's names, at full intensity; a rig of other names brings a table of its own.
ARKIT_TABLE: Mapping[str, Mapping[str, float]] = {
    "AU1+2": {"browInnerUp": 1.0, "browOuterUpLeft": 1.0, "browOuterUpRight": 1.0},
    "AU4": {"browDownLeft": 1.0, "browDownRight": 1.0},
    "AU9": {"noseSneerLeft": 1.0, "noseSneerRight": 1.0},
    "AU7": {"eyeSquintLeft": 1.0, "eyeSquintRight": 1.0},
    "AU45": {"eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0},
    "AU6+43": {"cheekSquintLeft": 1.0, "cheekSquintRight": 1.0, "eyeBlinkLeft": 1.0, "eyeBlinkRight": 1.0},
    "AU10+12+18+23L": {"mouthPucker": 0.8, "mouthLeft": 1.0},
    "AU10+12+18+23R": {"mouthPucker": 0.8, "mouthRight": 1.0},
}
