"""The mannequin's 140 shapes by name, with the action units of the Facial Action Coding System that they stand for.

ARKit's 52 shapes come first; then what they leave out (nostrils, neck, tongue, action units 11, 13, 21, 23 ...), the
halves and quarters of shapes that ARKit moves as a whole, visemes, and correctives with the shapes that drive them.
"""

from __future__ import annotations

from typing import NamedTuple

from blendcap.data.names import ARKIT52, mirror_name


class Shape(NamedTuple):
    """What a shape's name stands for."""

    name: str
    facs: str  # action units and descriptors, joined by "+"; empty if the system has none
    arkit: str  # the ARKit shape that it is, or is a part of; empty if ARKit has none
    side: str  # "left", "right" or "both"
    mirror: str  # the shape that does the same on the other side
    drivers: tuple[str, ...] = ()  # makes sense only with these; a corrective's weight is the product of its drivers


# name, action units, whole; a name with * stands for its Left and its Right. A shape with no whole adds to ARKit's.
_ARKIT = """
browDown*:4  browInnerUp:1  browOuterUp*:2  cheekPuff:34  cheekSquint*:6  eyeBlink*:45  eyeLookDown*:64
eyeLookInLeft:62  eyeLookInRight:61  eyeLookOutLeft:61  eyeLookOutRight:62  eyeLookUp*:63  eyeSquint*:7  eyeWide*:5
jawForward:29  jawLeft:30  jawOpen:26  jawRight:30  mouthClose:8  mouthDimple*:14  mouthFrown*:15  mouthFunnel:22
mouthLeft:  mouthLowerDown*:16  mouthPress*:24  mouthPucker:18  mouthRight:  mouthRollLower:28  mouthRollUpper:28
mouthShrugLower:17  mouthShrugUpper:10+17  mouthSmile*:12  mouthStretch*:20  mouthUpperUp*:10  noseSneer*:9
tongueOut:19
"""
_PARTS = """
browInnerUp*:1:browInnerUp  browLower*:4:browDown*  browSqueeze*:4:browDown*  cheekPuff*:34:cheekPuff
mouthFunnelLower*:22:mouthFunnel  mouthFunnelUpper*:22:mouthFunnel  mouthPressLower*:24:mouthPress*
mouthPressUpper*:24:mouthPress*  mouthPuckerLower*:18:mouthPucker  mouthPuckerUpper*:18:mouthPucker
mouthRollLower*:28:mouthRollLower  mouthRollUpper*:28:mouthRollUpper  mouthSwingLowerLeft::mouthLeft
mouthSwingUpperLeft::mouthLeft  mouthSwingLowerRight::mouthRight  mouthSwingUpperRight::mouthRight
"""
_MORE = """
cheekSuck*:35  chinRaise*:17  eyeClose*:43  eyeSqueeze*:6+7+43  jawBack:  jawClench*:31  jawStretch:27  lidTighten*:7
mouthBite:32  mouthCornerUp*:13  mouthPart*:25  mouthTightenLower*:23  mouthTightenUpper*:23  nasolabialDeepen*:11
neckSwallow:80  neckTighten*:21  noseWrinkle*:9  nostrilCompress*:39  nostrilDilate*:38  tongueDown:  tongueLeft:
tongueRight:  tongueUp:
visemeAA:25+26  visemeCH:22+25  visemeEE:12+20+25  visemeEH:20+25+26  visemeFV:25+32  visemeMBP:24  visemeOH:22+25+26
visemeOO:18+22+25  visemeR:18+25  visemeTH:19+25
"""
_CORRECTIVES = {
    "blinkLookDown*": "eyeBlink* eyeLookDown*", "blinkLookUp*": "eyeBlink* eyeLookUp*",
    "blinkSquint*": "eyeBlink* eyeSquint*", "blinkWide*": "eyeBlink* eyeWide*",
    "browKnit*": "browInnerUp browDown*", "smileOpen*": "jawOpen mouthSmile*",
}  # fmt: skip
NEEDS = {"mouthClose": ("jawOpen",), "tongueOut": ("jawOpen",), "jawStretch": ("jawOpen",)}
"""Shapes that make sense only together with others."""


def _sides(word: str) -> list[str]:
    return [word.replace("*", side) for side in ("Left", "Right")] if "*" in word else [word]


def _rows() -> list[tuple[str, str, str, tuple[str, ...]]]:
    """Name, action units, ARKit shape and drivers of each shape; ARKit's by name, the others in the tables' order."""
    ours = [(word, *entry.split(":", 1)) for entry in _ARKIT.split() for word in _sides(entry)]
    rows = [(word.partition(":")[0], word.partition(":")[2]) for word, *_ in ours]
    found: list[tuple[str, str, str, tuple[str, ...]]] = []
    found += [(name, facs, name, NEEDS.get(name, ())) for name, facs in sorted(rows)]
    for entry in (_PARTS + _MORE).split():
        for word in _sides(entry):
            name, facs, whole = (*word.split(":"), "")[:3]
            found.append((name, facs, whole, NEEDS.get(name, ())))
    for entry, drivers in _CORRECTIVES.items():
        for name, driven in zip(_sides(entry), _sides(drivers), strict=True):
            found.append((name, "", "", tuple(driven.split())))
    return found


def _side(name: str) -> str:
    """Which side a shape is of; aside (jawLeft, mouthLeft) is a direction, not a side."""
    if name.startswith(("jawLeft", "jawRight", "mouthLeft", "mouthRight", "mouthSwing", "tongue")):
        return "both"
    return "left" if name.endswith("Left") else "right" if name.endswith("Right") else "both"


SHAPES: tuple[Shape, ...] = tuple(
    Shape(name, facs, arkit, _side(name), mirror_name(name), drivers) for name, facs, arkit, drivers in _rows()
)
SHAPE_NAMES: tuple[str, ...] = tuple(shape.name for shape in SHAPES)
ARKIT_NAMES: tuple[str, ...] = tuple(sorted(ARKIT52))  # the first of them: the mannequin's order


def shapes_of(unit: int, side: str = "both") -> tuple[str, ...]:
    """The shapes that together do one action unit, on one side or on both; none if it has no shape of its own.

    `shapes_of(12, "left")` is mouthSmileLeft and `shapes_of(12)` both corners. ARKit's shape comes before one of ours,
    and a whole before its parts: `shapes_of(18)` is mouthPucker, `shapes_of(18, "left")` its two left quarters.
    """
    same = [shape for shape in SHAPES if shape.facs == str(unit) and not shape.name.startswith("viseme")]
    sided = [shape for shape in same if side in ("both", shape.side)]
    whole = [shape for shape in sided if shape.arkit == shape.name]
    own = [shape for shape in sided if not shape.arkit]
    return tuple(shape.name for shape in whole or own or sided)
