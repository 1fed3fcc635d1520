"""Scripted performances: a range of motion that shows every shape, and speech with blinks, glances and brow accents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from blendcap.data import Animation, InputError, Rig
from blendcap.data.correctives import driven, needs
from blendcap.data.names import ARKIT52, canonical, match
from blendcap.numerics.easing import least_jerk

# What a mouth does for a class of sounds, at full stress (ARKit names).
VISEMES: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("ah", {"jawOpen": 0.50, "mouthLowerDown*": 0.25, "mouthUpperUp*": 0.12}),
    ("eh", {"jawOpen": 0.32, "mouthStretch*": 0.25, "mouthLowerDown*": 0.25, "mouthSmile*": 0.10}),
    ("ee", {"jawOpen": 0.15, "mouthSmile*": 0.30, "mouthStretch*": 0.22, "mouthDimple*": 0.12}),
    ("oh", {"jawOpen": 0.35, "mouthFunnel": 0.55, "mouthPucker": 0.15}),
    ("oo", {"jawOpen": 0.14, "mouthPucker": 0.65, "mouthFunnel": 0.30}),
    ("l", {"jawOpen": 0.22, "tongueOut": 0.06, "mouthLowerDown*": 0.15}),
    ("sh", {"jawOpen": 0.08, "mouthFunnel": 0.40, "mouthShrugUpper": 0.20, "mouthUpperUp*": 0.18, "jawForward": 0.12}),
)
CLOSURES: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("p b m", {"mouthPress*": 0.35}),
    ("f", {"mouthRollLower": 0.35, "mouthUpperUp*": 0.15, "jawOpen": 0.05}),
    ("t", {"mouthShrugUpper": 0.12, "mouthStretch*": 0.08, "jawOpen": 0.06}),
)
PARTING = ("mouthLowerDown", "mouthUpperUp", "mouthFunnel", "mouthStretch", "mouthShrug", "mouthDimple", "tongueOut",
           "smileOpen")  # what keeps lips from meeting  # fmt: skip
SHUT_JAW = 0.6  # how far the jaw closes for p, b and m; the lips do the rest
SYLLABLE = 0.21  # seconds
RAMP, HOLD = 0.22, 0.10  # seconds: how the range of motion rises and rests


def range_of_motion(rig: Rig, rate: float = 60.0) -> Animation:
    """Every shape of the rig, one after the other and overlapping its neighbors.

    A shape with a partner rises on the left, on the right, and to the full on both; partners that undo each other
    (jaw left and right) follow each other instead; the eyes look to one side together. A shape that needs others, such
    as mouthClose or a corrective of `rig.combinations`, comes with them.
    """
    cues, start = [], 0.3
    for unit in _units(rig):
        for level, members in unit:
            needed = {need for name in members for need in needs(rig, name)}
            cues += [(name, start, start + 2 * RAMP + HOLD, level) for name in (*members, *sorted(needed))]
            start += RAMP + HOLD  # the next rises while this one falls
    return play(cues, rig.names, rate, start + RAMP + 0.3)


def speech(rig: Rig, rate: float = 60.0, seconds: float = 10.0, seed: int = 0) -> Animation:
    """Something like talk: syllables in phrases, lips that close for consonants, brows on stresses, glances and blinks.

    No words are meant. The rhythm is a person's: 4 to 5 syllables a second, pauses between phrases, blinks that
    close in 0.10 to 0.15 s and open slower, and one side that is always a little stronger than the other.
    """
    rng = np.random.default_rng(seed)
    talk, closures = _talk(seconds, rng)
    played = play(talk + steady(seconds, rng), ARKIT52, rate, seconds)
    return shut(for_rig(Animation(uneven(played, rng), ARKIT52, rate), rig), closures)


def for_rig(animation: Animation, rig: Rig, table: Mapping[str, Sequence[str]] | None = None) -> Animation:
    """An animation on all shapes of a rig, within their bounds, for a performer to act; `in_vocabulary` only renames.

    Parameters
    ----------
    animation : Animation
    rig : Rig
    table : {shape of the animation: shapes of the rig}, optional
        Which shapes mean the same; by their names if not given (eyeBlinkLeft is eyeBlink_L, and browInnerUp is both
        browInnerUp_L and browInnerUp_R). A shape that is not in the table is left out; one of the rig that nothing
        drives stays 0, but for correctives, which follow their drivers.
    """
    table = match(animation.names, rig.names) if table is None else table
    weights = np.zeros((len(animation.weights), len(rig.names)))
    for name, targets in table.items():
        if name in animation.names:
            for target in targets:
                weights[:, rig.index(target)] += animation.weights[:, animation.names.index(name)]
    if not table:
        raise InputError(f"No shape of the animation has a namesake on the rig {rig.name!r}; give a table of names.")
    weights = np.clip(weights, *rig.bounds.T)
    named = Animation(weights, rig.names, animation.rate, animation.head, times=animation.times, meta=animation.meta)
    return with_correctives(named, rig)


def with_correctives(animation: Animation, rig: Rig) -> Animation:
    """An animation of the rig with each corrective that it leaves at 0 as `data.correctives.driven` has it."""
    own = animation.weights.any(0)
    return replace(animation, weights=np.where(own, animation.weights, driven(rig, animation.weights)))


def _units(rig: Rig) -> list[list[tuple[float, tuple[str, ...]]]]:
    """What the range of motion shows, in the rig's order: lists of (level, shapes that move together)."""
    units, done = [], set()
    place = {canonical(name): name for name in rig.names}
    for index, name in enumerate(rig.names):
        if name in done:
            continue
        partner = rig.names[rig.mirror[index]]
        if canonical(name).startswith(("eyeLookIn", "eyeLookOut")):
            unit, used = _gaze(place)
        elif partner == name:
            unit, used = [(0.5, (name,)), (1.0, (name,))], {name}
        elif _undo(rig, index):
            unit, used = [(0.6, (name,)), (0.6, (partner,)), (1.0, (name,)), (1.0, (partner,))], {name, partner}
        else:
            unit, used = [(0.5, (name,)), (0.5, (partner,)), (1.0, (name, partner))], {name, partner}
        units.append(unit)
        done |= used
    return units


def _gaze(place: Mapping[str, str]) -> tuple[list[tuple[float, tuple[str, ...]]], set[str]]:
    """Both eyes to the left, then both to the right, with whatever of these shapes the rig has."""
    left = tuple(place[n] for n in ("eyeLookOutLeft", "eyeLookInRight") if n in place)
    right = tuple(place[n] for n in ("eyeLookOutRight", "eyeLookInLeft") if n in place)
    sides = [side for side in (left, right) if side]
    return [(level, side) for level in (0.5, 1.0) for side in sides], {*left, *right}


def _undo(rig: Rig, index: int) -> bool:
    """Whether a shape and its partner move the same skin rather than one side each."""
    one, two = (np.linalg.norm(rig.deltas[i], axis=1) for i in (index, rig.mirror[index]))
    return float(one @ two) > 0.5 * float(np.linalg.norm(one) * np.linalg.norm(two))


def play(cues, names: Sequence[str], rate: float, seconds: float) -> Animation:
    """Cues (name, start, end, level[, attack, release]), times in seconds, as an animation of that length.

    They rise and fall with the least jerk, and join smoothly where they overlap.
    """
    count = max(1, round(seconds * rate))
    room = np.ones((count, len(names)))  # what each cue leaves up to 1
    place = {name: i for i, name in enumerate(names)}
    for name, start, end, level, *ramps in cues:
        attack, release = ramps or (RAMP, RAMP)
        first, last = max(0, int(start * rate)), min(count, int(np.ceil(end * rate)) + 1)
        time = np.arange(first, last) / rate
        curve = level * least_jerk((time - start) / attack) * least_jerk((end - time) / release)
        room[first:last, place[name]] *= 1 - curve
    return Animation(1 - room, tuple(names), rate)


def shut(played: Animation, closures: Sequence[tuple[float, float]]) -> Animation:
    """The animation of a rig with lips that meet for p, b and m, each closure (start, length) in seconds.

    All that parts the lips gives way, and so does most of the jaw; mouthClose undoes with the lips what the jaw still
    opens. Where the rig has no mouthClose, the jaw closes altogether.
    """
    times = np.arange(len(played.weights)) / played.rate
    closed = np.zeros(len(times))
    for start, length in closures:
        ramp = 0.36 * length
        closed = np.maximum(closed, least_jerk((times - start) / ramp) * least_jerk((start + length - times) / ramp))
    weights, names = played.weights.copy(), [canonical(name) for name in played.names]
    weights[:, [name.startswith(PARTING) for name in names]] *= 1 - closed[:, None]
    if "jawOpen" in names:
        jaw = weights[:, names.index("jawOpen")]  # a view
        jaw *= 1 - (SHUT_JAW if "mouthClose" in names else 1.0) * closed
        if "mouthClose" in names:
            close = names.index("mouthClose")
            weights[:, close] = np.maximum(weights[:, close], closed * jaw)
    return replace(played, weights=weights)


def _talk(seconds: float, rng: np.random.Generator) -> tuple[list[tuple], list[tuple[float, float]]]:
    """Cues of talk, and when (start, length in seconds) lips meet."""
    cues, closures, now = [], [], rng.uniform(0.2, 0.5)
    while now < seconds - 0.5:
        begin = now
        for syllable in range(rng.integers(4, 11)):
            length = SYLLABLE * rng.uniform(0.75, 1.35)
            stressed = syllable % int(rng.integers(2, 5)) == 0
            strength = rng.uniform(0.8, 1.15) if stressed else rng.uniform(0.45, 0.75)
            consonant = CLOSURES[rng.integers(len(CLOSURES))]
            cues += _sound(consonant[1], now - 0.35 * length, 0.75 * length, 1.0)
            if consonant is CLOSURES[0]:
                closures.append((now - 0.35 * length, 0.75 * length))
            cues += _sound(VISEMES[rng.integers(len(VISEMES))][1], now, 1.45 * length, strength)
            if stressed and rng.random() < 0.35:
                cues += _accent(now, rng)
            now += length
        if rng.random() < 0.4:  # a phrase with a smile
            ramps = (0.35, 0.5)
            for name, share in (("mouthSmile", 1.0), ("cheekSquint", 0.5), ("eyeSquint", 0.3)):
                cues += both(f"{name}*", begin, now + 0.5, share * rng.uniform(0.2, 0.45), *ramps)
        now += rng.uniform(0.35, 0.9)
    return cues, closures


def _sound(mouth: Mapping[str, float], start: float, length: float, strength: float) -> list[tuple]:
    ramp = 0.48 * length
    return [
        cue for name, level in mouth.items() for cue in both(name, start, start + length, strength * level, ramp, ramp)
    ]


def both(name: str, *cue: float) -> list[tuple]:
    """A cue for one shape, or for its left and its right if the name ends in *."""
    return [(name, *cue)] if not name.endswith("*") else [(name[:-1] + side, *cue) for side in ("Left", "Right")]


def _accent(start: float, rng: np.random.Generator) -> list[tuple]:
    end, level = start + rng.uniform(0.45, 0.9), rng.uniform(0.3, 0.75)
    if rng.random() < 0.3:
        return both("browDown*", start, end, level, 0.15, 0.3) + both("noseSneer*", start, end, 0.3 * level, 0.15, 0.3)
    cues = both("browOuterUp*", start, end, 0.8 * level, 0.15, 0.3) + both(
        "eyeWide*", start, end, 0.3 * level, 0.15, 0.3
    )
    return [("browInnerUp", start, end, level, 0.15, 0.3), *cues]


def steady(seconds: float, rng: np.random.Generator) -> list[tuple]:
    """Cues of what a face never stops doing: blinks and glances."""
    return _blinks(seconds, rng) + _glances(seconds, rng)


def _blinks(seconds: float, rng: np.random.Generator) -> list[tuple]:
    cues, now = [], rng.uniform(0.4, 1.5)
    while now < seconds:
        closing, opening = rng.uniform(0.10, 0.15), rng.uniform(0.18, 0.28)
        shut = rng.uniform(0.01, 0.05)
        level = rng.uniform(0.9, 1.0)
        for side in ("Left", "Right"):
            start = now + rng.normal(scale=0.004)
            end = start + closing + shut + opening
            cues.append((f"eyeBlink{side}", start, end, level, closing, opening))
            cues.append((f"eyeSquint{side}", start, end, 0.25 * level, closing, opening))
        now += rng.gamma(4.0, 0.8) + 0.5  # 15 to 20 a minute
    return cues


def _glances(seconds: float, rng: np.random.Generator) -> list[tuple]:
    cues, now = [], rng.uniform(0.5, 1.5)
    while now < seconds:
        end = now + rng.uniform(0.4, 1.6)
        across, up = rng.normal(scale=0.25, size=2)
        sides = ("Left", "Right") if across > 0 else ("Right", "Left")
        ramps = (0.05, 0.05)
        cues.append((f"eyeLookOut{sides[0]}", now, end, min(abs(across), 0.7), *ramps))
        cues.append((f"eyeLookIn{sides[1]}", now, end, min(abs(across), 0.7), *ramps))
        cues += both("eyeLookUp*" if up > 0 else "eyeLookDown*", now, end, min(abs(up), 0.6), *ramps)
        now = end + rng.uniform(0.3, 1.5)
    return cues


def uneven(played: Animation, rng: np.random.Generator) -> np.ndarray:
    """Weights with one side a little stronger and a slow drift of it; blinks and glances stay together."""
    weights = played.weights.copy()
    for i, name in enumerate(played.names):
        if name.endswith(("Left", "Right")) and not name.startswith("eye"):
            drift = gaussian_filter1d(rng.normal(size=len(weights)), 0.7 * played.rate, mode="reflect")
            weights[:, i] *= 1 + rng.normal(scale=0.08) + 0.05 * drift / (drift.std() + 1e-12)
    return np.clip(weights, 0, 1)
