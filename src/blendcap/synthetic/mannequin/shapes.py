"""The 140 shapes as displacements of the whole cage, computed from the person's own points."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from blendcap.data.facs import SHAPES
from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin import jaw, lids, lips, upper_face
from blendcap.synthetic.mannequin.contact import along_bone, over_globe, over_teeth, pushed_on
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import behind_lids
from blendcap.synthetic.mannequin.visemes import VISEMES

Build = Callable[[Face], np.ndarray]

_SPLIT = 8.0  # left hands over to right between -8 and 8 mm from the midline

# What the left half does; mirrored, and split into sides and lips where the names ask for it.
BUILDS: Mapping[str, Build] = {
    "browDown": upper_face.brow_down,
    "browInnerUp": upper_face.brow_inner_up,
    "browKnit": upper_face.brow_knit,
    "browLower": upper_face.brow_lower,
    "browOuterUp": upper_face.brow_outer_up,
    "browSqueeze": upper_face.brow_squeeze,
    "cheekPuff": upper_face.cheek_puff,
    "cheekSquint": upper_face.cheek_squint,
    "cheekSuck": upper_face.cheek_suck,
    "chinRaise": lips.chin_raise,
    "eyeBlink": lids.blink,
    "eyeClose": lids.close,
    "eyeLookDown": lids.look_down,
    "eyeLookIn": lids.look_in,
    "eyeLookOut": lids.look_out,
    "eyeLookUp": lids.look_up,
    "eyeSqueeze": upper_face.eye_squeeze,
    "eyeSquint": upper_face.squint,
    "eyeWide": lids.wide,
    "jawBack": jaw.jaw_back,
    "jawClench": upper_face.jaw_clench,
    "jawForward": jaw.jaw_forward,
    "jawOpen": jaw.jaw_open,
    "jawStretch": jaw.jaw_stretch,
    "lidTighten": upper_face.lid_tighten,
    "mouthBite": lips.bite,
    "mouthClose": jaw.mouth_close,
    "mouthCornerUp": lips.corner_up,
    "mouthDimple": lips.dimple,
    "mouthFrown": lips.frown,
    "mouthFunnel": lips.funnel,
    "mouthLowerDown": lips.lower_down,
    "mouthPart": lips.part,
    "mouthPress": lips.press,
    "mouthPucker": lips.pucker,
    "mouthRollLower": lips.roll_lower,
    "mouthRollUpper": lips.roll_upper,
    "mouthShrugLower": lips.shrug_lower,
    "mouthShrugUpper": lips.shrug_upper,
    "mouthSmile": lips.smile,
    "mouthStretch": lips.stretch,
    "mouthTighten": lips.tighten,
    "mouthUpperUp": lips.upper_up,
    "nasolabialDeepen": lips.nasolabial_deepen,
    "neckSwallow": upper_face.neck_swallow,
    "neckTighten": upper_face.neck_tighten,
    "noseSneer": upper_face.nose_sneer,
    "noseWrinkle": upper_face.nose_wrinkle,
    "nostrilCompress": upper_face.nostril_compress,
    "nostrilDilate": upper_face.nostril_dilate,
    "smileOpen": lips.smile_open,
    "tongueOut": lips.tongue_passes,
}
_JAW = ("jawOpen", "jawStretch", "jawForward", "jawBack", "mouthClose")  # these carry the skin with the bone
_AFTER = {"jawStretch": ("jawOpen",), "mouthClose": ("jawOpen",), "smileOpen": ("jawOpen", "mouthSmile"),
          "tongueOut": ("jawOpen",)}  # fmt: skip
_ASIDE: Mapping[str, Build] = {"jawLeft": jaw.jaw_aside, "mouthLeft": lips.mouth_aside}  # of the whole cage
_INSTEAD = {"blinkLookDown": "eyeLookDown", "blinkLookUp": "eyeLookUp", "blinkSquint": "eyeSquint",
            "blinkWide": "eyeWide"}  # fmt: skip
_STILL = ("tongueDown", "tongueLeft", "tongueRight", "tongueUp")  # move the tongue alone
_APART = ("mouthFunnel",)  # the lips part, so a lip that is asked for alone moves alone


def cage_shapes(face: Face, arch: np.ndarray, skin: np.ndarray, faces: np.ndarray) -> dict[str, np.ndarray]:
    """Displacements (N, 3) of the whole cage at weight 1, mm, by name and in the order of `data.facs.SHAPES`.

    Parameters
    ----------
    face : Face
    arch : (A, 3) float64
        The front of the upper teeth, from the midline to the left; what the lips slide over.
    skin, faces
        The resting surface (V, 3), mm, and its triangles (F, 3) of the left half; what the skin slides along.
    """
    halves = _halves(face, arch, skin, faces)
    wholes = {name: face.cage.mirrored(half) for name, half in halves.items()}
    for name, build in _ASIDE.items():
        wholes[name] = _both_over_teeth(face, build(face), arch)
        wholes[name.replace("Left", "Right")] = reflected(face, wholes[name])
    for name in _STILL:
        wholes[name] = np.zeros((face.cage.size, 3))
    return {shape.name: _share_of(face, shape.name, shape.side) * wholes[_stem(shape.name, wholes)] for shape in SHAPES}


def _halves(face: Face, arch: np.ndarray, skin: np.ndarray, faces: np.ndarray) -> dict[str, np.ndarray]:
    """Displacements (H, 3) of the left half, with skin that slides over teeth and bone."""
    halves = {name: build(face) for name, build in BUILDS.items()}
    soft = [name for name in halves if name not in _JAW]
    slid = along_bone(face, np.stack([halves[name] for name in soft]), skin, faces)
    halves.update((name, face.lined(moved)) for name, moved in zip(soft, slid, strict=True))
    for name in (*_JAW, *soft):
        before = np.sum([halves[driver] for driver in _AFTER.get(name, ())], axis=0)
        halves[name] = pushed_on(face, halves[name], before)
    for name in soft:
        halves[name] = over_globe(face, over_teeth(face, halves[name], arch))
        ends = face.points + halves[name]
        halves[name] += behind_lids(face.cage, ends, face.person.globe) - ends
    for name, viseme in VISEMES.items():
        mouth = np.sum([w * halves[part] for part, w in viseme.mouth.items()], axis=0)
        moved = jaw.jaw_opened(face, viseme.jaw) + over_teeth(face, mouth, arch)
        halves[name] = face.lined(face.sealed(moved)) if viseme.closed else moved
    for name, shape in _INSTEAD.items():
        halves[name] = lids.instead_of(halves[shape], face)
    halves["browDown"] = halves["browLower"] + halves["browSqueeze"]
    return halves


def _both_over_teeth(face: Face, whole: np.ndarray, arch: np.ndarray) -> np.ndarray:
    """A displacement (N, 3) of the whole cage that ends outside the dental arch on both sides."""
    half, kept = len(face.points), whole.copy()
    twin = face.cage.twin
    kept[twin] = over_teeth(face, reflected(face, whole)[:half], arch) * [-1, 1, 1]
    kept[:half] = over_teeth(face, whole[:half], arch)
    return kept


def _stem(name: str, wholes: Mapping[str, np.ndarray]) -> str:
    """The whole that a shape is a part of: mouthPressUpperLeft is of mouthPress, mouthSwingUpperLeft of mouthLeft."""
    name = name.replace("mouthSwingUpper", "mouth").replace("mouthSwingLower", "mouth")
    for ending in ("Left", "Right", "UpperLeft", "UpperRight", "LowerLeft", "LowerRight"):
        if name not in wholes:
            stem = name.removesuffix(ending)
            name = stem if stem in wholes else name
    return name


def _share_of(face: Face, name: str, side: str) -> np.ndarray | float:
    """The part (N, 1) of its whole that belongs to a shape: a side, a lip, or both; parts sum to 1."""
    share = 1.0
    if side != "both":
        left = smoothstep(-_SPLIT, _SPLIT, face.cage.mirrored(face.points)[:, :1])
        share = share * (left if side == "left" else 1 - left)
    if name.startswith(("mouthFunnel", "mouthPress", "mouthPucker", "mouthTighten", "mouthSwing")):
        upper = face.cage.mirrored(_upper_share(face, apart=name.startswith(_APART)), vectors=False)[:, None]
        share = share * (upper if "Upper" in name else 1 - upper if "Lower" in name else 1.0)
    return share


def _upper_share(face: Face, *, apart: bool) -> np.ndarray:
    """How much (H,) of a motion of both lips is the upper lip's; where the lips touch they share it, unless apart."""
    level = face.at("seam.4")[1]
    share = smoothstep(level - 9, level + 9, face.points[:, 1])
    from_seam = {"border": 0.6, "crest": 0.25, "seam": 0, "inner": 0, "lining": 0, "bag": 0}
    own = np.array([1.0 if apart else from_seam.get(name, 1.0) for name in face.ring])
    own *= np.select([face.place == 4, (face.place == 3) | (face.place == 5)], [0, 0.2], 1)
    return np.where(face.mouth, 0.5 + 0.5 * own * (1.0 * face.upper - face.lower), share)


def reflected(face: Face, whole: np.ndarray) -> np.ndarray:
    """The mirror image of a displacement (N, 3) of the whole cage."""
    return whole[face.cage.twins] * [-1, 1, 1]
