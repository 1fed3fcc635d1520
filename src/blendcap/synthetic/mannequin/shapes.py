"""The 52 shapes of ARKit as displacements of the whole cage, computed from the person's own points."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from blendcap.synthetic.mannequin import jaw, lids, lips, upper_face
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.fields import smoothstep

Build = Callable[[Face], np.ndarray]

_SPLIT = 8.0  # left hands over to right between -8 and 8 mm from the midline

# Computed once for the left half, mirrored and split into a left and a right shape that sum to the whole.
PAIRED: Mapping[str, Build] = {
    "browDown": upper_face.brow_down,
    "browOuterUp": upper_face.brow_outer_up,
    "cheekSquint": upper_face.cheek_squint,
    "eyeBlink": lids.blink,
    "eyeLookDown": lids.look_down,
    "eyeLookIn": lids.look_in,
    "eyeLookOut": lids.look_out,
    "eyeLookUp": lids.look_up,
    "eyeSquint": lids.squint,
    "eyeWide": lids.wide,
    "mouthDimple": lips.dimple,
    "mouthFrown": lips.frown,
    "mouthLowerDown": lips.lower_down,
    "mouthPress": lips.press,
    "mouthSmile": lips.smile,
    "mouthStretch": lips.stretch,
    "mouthUpperUp": lips.upper_up,
    "noseSneer": upper_face.nose_sneer,
}
SYMMETRIC: Mapping[str, Build] = {
    "browInnerUp": upper_face.brow_inner_up,
    "cheekPuff": upper_face.cheek_puff,
    "jawForward": jaw.jaw_forward,
    "jawOpen": jaw.jaw_open,
    "mouthClose": jaw.mouth_close,
    "mouthFunnel": lips.funnel,
    "mouthPucker": lips.pucker,
    "mouthRollLower": lips.roll_lower,
    "mouthRollUpper": lips.roll_upper,
    "mouthShrugLower": lips.shrug_lower,
    "mouthShrugUpper": lips.shrug_upper,
    "tongueOut": lips.tongue_passes,
}
ASIDE: Mapping[str, Build] = {"jaw": jaw.jaw_aside, "mouth": lips.mouth_aside}

ARKIT: tuple[str, ...] = tuple(
    word
    for line in (
        "browDownLeft browDownRight browInnerUp browOuterUpLeft browOuterUpRight cheekPuff cheekSquintLeft",
        "cheekSquintRight eyeBlinkLeft eyeBlinkRight eyeLookDownLeft eyeLookDownRight eyeLookInLeft",
        "eyeLookInRight eyeLookOutLeft eyeLookOutRight eyeLookUpLeft eyeLookUpRight eyeSquintLeft eyeSquintRight",
        "eyeWideLeft eyeWideRight jawForward jawLeft jawOpen jawRight mouthClose mouthDimpleLeft mouthDimpleRight",
        "mouthFrownLeft mouthFrownRight mouthFunnel mouthLeft mouthLowerDownLeft mouthLowerDownRight",
        "mouthPressLeft mouthPressRight mouthPucker mouthRight mouthRollLower mouthRollUpper mouthShrugLower",
        "mouthShrugUpper mouthSmileLeft mouthSmileRight mouthStretchLeft mouthStretchRight mouthUpperUpLeft",
        "mouthUpperUpRight noseSneerLeft noseSneerRight tongueOut",
    )
    for word in line.split()
)


def cage_shapes(face: Face) -> dict[str, np.ndarray]:
    """Displacements (N, 3) of the whole cage at weight 1, mm, by ARKit's names and in its order."""
    cage, shapes = face.cage, {}
    left = smoothstep(-_SPLIT, _SPLIT, cage.mirrored(face.points)[:, :1])
    for name, build in PAIRED.items():
        whole = cage.mirrored(build(face))
        shapes[f"{name}Left"], shapes[f"{name}Right"] = left * whole, (1 - left) * whole
    for name, build in SYMMETRIC.items():
        shapes[name] = cage.mirrored(build(face))
    for name, build in ASIDE.items():
        shapes[f"{name}Left"] = build(face)
        shapes[f"{name}Right"] = reflected(face, shapes[f"{name}Left"])
    return {name: shapes[name] for name in ARKIT}


def reflected(face: Face, whole: np.ndarray) -> np.ndarray:
    """The mirror image of a displacement (N, 3) of the whole cage."""
    return whole[face.cage.twins] * [-1, 1, 1]


def mirror_of(name: str) -> str:
    """The shape that does the same on the other side."""
    for side, other in (("Left", "Right"), ("Right", "Left")):
        if name.endswith(side):
            return name.removesuffix(side) + other
    return name
