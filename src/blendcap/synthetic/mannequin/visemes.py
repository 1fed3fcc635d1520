"""What the mouth does for classes of speech sounds: one shape each, with its share of the jaw and of the tongue."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Viseme(NamedTuple):
    """How a sound looks."""

    jaw: float  # share of jawOpen, along the jaw's arc
    mouth: Mapping[str, float]  # shapes of the mouth and how much of each
    tongue: float = 0.0  # share of tongueOut
    closed: bool = False  # the lips meet


VISEMES: Mapping[str, Viseme] = {
    "visemeAA": Viseme(0.5, {"mouthLowerDown": 0.5, "mouthUpperUp": 0.4}),
    "visemeCH": Viseme(0.14, {"mouthFunnel": 0.55, "mouthUpperUp": 0.2, "mouthLowerDown": 0.2}),
    "visemeEE": Viseme(0.12, {"mouthSmile": 0.3, "mouthStretch": 0.3, "mouthLowerDown": 0.35, "mouthUpperUp": 0.25}),
    "visemeEH": Viseme(0.26, {"mouthStretch": 0.45, "mouthLowerDown": 0.35, "mouthUpperUp": 0.2, "mouthSmile": 0.1}),
    "visemeFV": Viseme(0.06, {"mouthBite": 0.75, "mouthUpperUp": 0.3}),
    "visemeMBP": Viseme(0.0, {"mouthPress": 0.7, "mouthRollUpper": 0.2, "mouthRollLower": 0.25}, closed=True),
    "visemeOH": Viseme(0.4, {"mouthFunnel": 0.6, "mouthPucker": 0.2}),
    "visemeOO": Viseme(0.16, {"mouthPucker": 0.6, "mouthFunnel": 0.25}),
    "visemeR": Viseme(0.1, {"mouthFunnel": 0.3, "mouthShrugUpper": 0.5, "mouthTighten": 0.4, "mouthPart": 0.4}),
    "visemeTH": Viseme(0.2, {"mouthLowerDown": 0.25, "mouthUpperUp": 0.15, "tongueOut": 0.25}, tongue=0.33),
}
