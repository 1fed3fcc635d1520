"""Names of shapes: vocabularies, left and right, and which names mean the same."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from blendcap.data.animation import Animation
from blendcap.data.errors import InputError

_log = logging.getLogger(__name__)

# The order of the columns in a Live Link Face recording.
ARKIT52: tuple[str, ...] = (
    "eyeBlinkLeft", "eyeLookDownLeft", "eyeLookInLeft", "eyeLookOutLeft", "eyeLookUpLeft", "eyeSquintLeft",
    "eyeWideLeft", "eyeBlinkRight", "eyeLookDownRight", "eyeLookInRight", "eyeLookOutRight", "eyeLookUpRight",
    "eyeSquintRight", "eyeWideRight", "jawForward", "jawRight", "jawLeft", "jawOpen", "mouthClose", "mouthFunnel",
    "mouthPucker", "mouthRight", "mouthLeft", "mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft",
    "mouthFrownRight", "mouthDimpleLeft", "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight",
    "mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper", "mouthPressLeft", "mouthPressRight",
    "mouthLowerDownLeft", "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight", "browDownLeft",
    "browDownRight", "browInnerUp", "browOuterUpLeft", "browOuterUpRight", "cheekPuff", "cheekSquintLeft",
    "cheekSquintRight", "noseSneerLeft", "noseSneerRight", "tongueOut",
)  # fmt: skip

# Angles of head and eyes that Live Link Face records beside the shapes, in a unit of its own.
HEAD_AND_EYES: tuple[str, ...] = (
    "headYaw", "headPitch", "headRoll", "leftEyeYaw", "leftEyePitch", "leftEyeRoll", "rightEyeYaw", "rightEyePitch",
    "rightEyeRoll",
)  # fmt: skip

# What no face does at once: the same lid, eye, jaw or mouth moves one way or the other.
EXCLUSIVE: tuple[tuple[str, str], ...] = (
    ("eyeBlinkLeft", "eyeWideLeft"), ("eyeBlinkRight", "eyeWideRight"),
    ("eyeLookUpLeft", "eyeLookDownLeft"), ("eyeLookUpRight", "eyeLookDownRight"),
    ("eyeLookInLeft", "eyeLookOutLeft"), ("eyeLookInRight", "eyeLookOutRight"),
    ("jawLeft", "jawRight"), ("mouthLeft", "mouthRight"),
)  # fmt: skip

_SUFFIX = re.compile(r"[_.](l|r|left|right)$", re.IGNORECASE)
_WORD = re.compile(r"(?<![A-Za-z])(left|right)(?![a-z])|(Left|Right)(?![a-z])|(?<=[_.])([lLrR])$")
STILL = 1e-4  # a weight below this moves nothing that anybody sees
_OTHER = {"left": "right", "right": "left", "Left": "Right", "Right": "Left", "l": "r", "r": "l", "L": "R", "R": "L"}


def canonical(name: str) -> str:
    """The camelCase spelling of a shape's name: `eyeBlink_L` and `head:EyeBlinkLeft` are both `eyeBlinkLeft`.

    Namespaces (`head:`, `blendShape2.`) are dropped, the suffixes `_L`, `.R`, `_left` become words, and the first
    letter becomes small.
    """
    side = _SUFFIX.search(name)
    stem = name[: side.start()] if side else name
    stem = re.split(r"[:|.]", stem)[-1]
    words = [w for w in re.split(r"[_\s-]+", stem) if w]
    joined = "".join(w[:1].upper() + w[1:] for w in words)
    if side:
        joined += "Left" if side.group(1).lower().startswith("l") else "Right"
    return joined[:1].lower() + joined[1:]


def mirror_name(name: str) -> str:
    """The name of the same shape on the other side; the name itself if it has no side."""
    return _WORD.sub(lambda found: _OTHER[found.group()], name)


def mirror_map(names: Sequence[str]) -> np.ndarray:
    """For each name the place (N,) of its mirror name; its own place where that name is absent."""
    place = {name: i for i, name in enumerate(names)}
    return np.array([place.get(mirror_name(name), i) for i, name in enumerate(names)], dtype=np.int64)


def opposite_map(names: Sequence[str]) -> np.ndarray:
    """For each name the place (N,) of the shape that excludes it (EXCLUSIVE); its own place where there is none."""
    place = {canonical(name): i for i, name in enumerate(names)}
    opposite = np.arange(len(names))
    for one, other in EXCLUSIVE:
        if one in place and other in place:
            opposite[[place[one], place[other]]] = place[other], place[one]
    return opposite


def match(names: Sequence[str], others: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """For each name the names among `others` that mean the same.

    A name without a side also meets its two halves: `browInnerUp` is `browInnerUp_L` and `browInnerUp_R`.
    Names that meet nothing are left out.
    """
    place: dict[str, str] = {}
    for other in others:
        place.setdefault(canonical(other), other)
    found = {}
    for name in names:
        key = canonical(name)
        halves = (key,) if key in place else (key + "Left", key + "Right")
        if all(half in place for half in halves):
            found[name] = tuple(place[half] for half in halves)
    return found


def in_vocabulary(animation: Animation, names: Sequence[str], *, partial: bool = True) -> Animation:
    """The animation on shapes that another rig or file names otherwise, in the order of `names`.

    Spellings are matched. A whole that has no place moves both its halves, halves that have none move the whole by
    their mean, and what comes together adds up. Shapes that nothing drives are left out, and shapes that find no place
    (`without_place`) are named in a warning, or refused unless `partial` (angles of the head and the eyes never are).

    Raises
    ------
    InputError
        If no shape finds a place, or one that moves does not and `partial` is false.
    """
    shares = _shares(animation.names, names)
    driven = shares.any(0)
    if not driven.any():
        raise InputError(f"None of the shapes {', '.join(animation.names[:4])} ... is among {', '.join(names[:4])} ...")
    lost = _unplaced(animation, shares)
    if not partial and set(lost) - set(HEAD_AND_EYES):
        name = next(name for name in lost if name not in HEAD_AND_EYES)
        raise InputError(
            f"The animation moves the shape {name!r}, for which there is no place; rename it, or convert with "
            "--partial (partial=True) to leave such shapes out."
        )
    if lost:
        _log.warning(
            "%d of %d shapes move, but find no place and are left out, the strongest first: %s.",
            len(lost), len(animation.names), listed(lost),
        )  # fmt: skip
    shares = shares[:, driven]
    means = shares / shares.sum(0)
    return replace(
        animation,
        weights=_mixed(animation.weights, shares),
        names=tuple(names[i] for i in np.flatnonzero(driven).tolist()),
        confidence=None if animation.confidence is None else _mixed(animation.confidence, means),
    )


def without_place(animation: Animation, names: Sequence[str]) -> list[str]:
    """The shapes of an animation that move, but drive none of `names`; the strongest first."""
    return _unplaced(animation, _shares(animation.names, names))


def _unplaced(animation: Animation, shares: np.ndarray) -> list[str]:
    """The shapes that move and have no share (N, M) of a target, by their largest weight."""
    used = shares.sum(1) > 0
    largest = np.nan_to_num(np.abs(animation.weights)).max(0, initial=0)
    return [animation.names[i] for i in np.argsort(-largest, kind="stable") if not used[i] and largest[i] > STILL]


def listed(names: Sequence[str], most: int = 6) -> str:
    """The names in a row, and how many more there are than `most`."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _shares(names: Sequence[str], targets: Sequence[str]) -> np.ndarray:
    """(N, M) how much of each name's weight each target gets."""
    row, column = ({name: i for i, name in enumerate(some)} for some in (names, targets))
    there, spelt = match(names, targets), {canonical(name): name for name in names}
    shares = np.zeros((len(names), len(targets)))
    for name, places in there.items():
        shares[row[name], [column[place] for place in places]] = 1.0
    for target in targets:
        halves = [spelt.get(canonical(target) + side) for side in ("Left", "Right")]
        if all(half is not None and half not in there for half in halves):
            shares[[row[half] for half in halves if half is not None], column[target]] = 0.5
    return shares


def _mixed(values: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """`values @ shares` (T, M) in which NaN stays in the columns that it touches."""
    mixed = np.zeros((len(values), shares.shape[1]))
    for i, j in zip(*np.nonzero(shares), strict=True):
        mixed[:, j] += shares[i, j] * values[:, i]
    return mixed
