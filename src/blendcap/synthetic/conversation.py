"""A conversation: phrases told sound by sound, and listening in between, with nods, brows, glances and blinks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import gaussian_filter1d

from blendcap.data import Animation, InputError, Rig
from blendcap.data.names import ARKIT52
from blendcap.synthetic.motion import motion_matrices
from blendcap.synthetic.performances import both, for_rig, play, shut, steady, uneven

PHRASES = (
    "h EH l OH  h AW  AA r  j UW", "AY  th IH ng k  s OH", "w EH l  n OH  b AA t  m EY b iy", "f AW r  OH r  f AY v",
    "p l iy z  t EH l  m iy  m OH r", "w AA t  UW  j UW  w AA n t", "sh iy  m UW v d  t UW  p AA r IH s",
    "AE  b IH g  b r AW n  f AA k s", "v EH r iy  g UH d  AY n d iy d", "ch EH k  dh AA  w EH dh er",
    "AY  l AA v  dh AE t  s AA ng", "n EH v er  m AY n d",
)  # fmt: skip
"""What is said: vowels in capitals, consonants small, two spaces between words."""
VISEMES: Mapping[str, Mapping[str, float]] = {
    "AA": {"jawOpen": 0.55, "mouthLowerDown*": 0.22, "mouthUpperUp*": 0.12},
    "AE": {"jawOpen": 0.45, "mouthStretch*": 0.28, "mouthUpperUp*": 0.15, "mouthSmile*": 0.10},
    "EH": {"jawOpen": 0.32, "mouthStretch*": 0.22, "mouthLowerDown*": 0.22},
    "IH": {"jawOpen": 0.20, "mouthStretch*": 0.20, "mouthSmile*": 0.12},
    "iy": {"jawOpen": 0.12, "mouthSmile*": 0.30, "mouthStretch*": 0.25, "mouthDimple*": 0.10},
    "OH": {"jawOpen": 0.34, "mouthFunnel": 0.55, "mouthPucker": 0.18},
    "UH": {"jawOpen": 0.22, "mouthFunnel": 0.35, "mouthPucker": 0.20},
    "UW": {"jawOpen": 0.12, "mouthPucker": 0.68, "mouthFunnel": 0.28},
    "er": {"jawOpen": 0.18, "mouthFunnel": 0.38, "mouthShrugUpper": 0.10},
    "lips": {"mouthPress*": 0.32, "mouthRollLower": 0.24, "mouthRollUpper": 0.16},
    "teeth": {"mouthRollLower": 0.36, "mouthUpperUp*": 0.16, "jawOpen": 0.05},
    "tongue": {"jawOpen": 0.14, "tongueOut": 0.14, "mouthLowerDown*": 0.10},
    "hiss": {"jawOpen": 0.05, "mouthStretch*": 0.16, "mouthLowerDown*": 0.18, "mouthUpperUp*": 0.10},
    "hush": {"jawOpen": 0.08, "mouthFunnel": 0.42, "mouthShrugUpper": 0.18, "jawForward": 0.12},
    "round": {"mouthPucker": 0.55, "mouthFunnel": 0.25},
    "tip": {"jawOpen": 0.14, "mouthShrugUpper": 0.10, "mouthLowerDown*": 0.08},
    "back": {"jawOpen": 0.20},
}
SOUNDS = {
    "b p m": "lips", "f v": "teeth", "th dh": "tongue", "s z": "hiss", "sh ch j": "hush", "w r": "round",
    "t d n l": "tip", "k g ng h": "back", "AY": "AA iy", "AW": "AA UW", "EY": "EH iy",
}  # fmt: skip
VOWEL, CONSONANT, PAUSE = 0.13, 0.075, 0.06  # seconds
EARLY_VOWEL, EARLY = 0.06, 0.045  # seconds by which a mouth comes before its sound, and stays after it
NOD = 0.12  # rad, of a nod at its strongest


def conversation(rig: Rig, rate: float = 60.0, seconds: float = 20.0, seed: int = 0) -> Animation:
    """Turns of talk and of listening, with the head's motion.

    Parameters
    ----------
    rig : Rig
        Its shapes are found by their names; it should have those of ARKit.
    rate : float
        Frames a second.
    seconds : float
    seed : int
        Other phrases, other timing, another side that is a little stronger.

    Notes
    -----
    Neighboring sounds overlap, so that vowels color the consonants between them. Lips that must close do.
    """
    if not seconds > 0:
        raise InputError(f"A conversation needs more than 0 seconds, but {seconds!r} were asked for.")
    rng = np.random.default_rng(seed)
    cues, closures, nods, now = [], [], [], rng.uniform(0.3, 0.7)
    while now < seconds:
        spoken, closed, now = _turn(now, rng)
        heard, nodded, now = _listen(now, rng)
        cues, closures, nods = cues + spoken + heard, closures + closed, nods + nodded
    played = play(cues + steady(seconds, rng), ARKIT52, rate, seconds)
    head = _head(play(nods, ("nod", "shake"), rate, seconds).weights, played, rig, rng)
    return shut(for_rig(Animation(uneven(played, rng), ARKIT52, rate, head), rig), closures)


def _turn(now: float, rng: np.random.Generator) -> tuple[list[tuple], list[tuple[float, float]], float]:
    """Cues of one to three phrases from `now` on, when (start, length) lips meet in them, and when they end."""
    cues, closures = [], []
    for phrase in rng.choice(PHRASES, rng.integers(1, 4), replace=False):
        begin, tempo, strength = now, rng.uniform(0.85, 1.2), rng.uniform(0.8, 1.1)
        for word in str(phrase).split("  "):
            for sound in word.split():
                length = tempo * (VOWEL if sound[0].isupper() else CONSONANT) * rng.uniform(0.85, 1.2)
                cues += _sound(sound, now, length, strength)
                if "lips" in _mouths(sound):
                    closures.append((now - EARLY, length + 2 * EARLY))
                now += length
            now += tempo * PAUSE * rng.uniform(0, 1)
        cues += _mood(begin, now, rng)
        now += rng.uniform(0.25, 0.6)
    return cues, closures, now


def _sound(sound: str, start: float, length: float, strength: float) -> list[tuple]:
    """A sound's mouth, or its two mouths in turn; it begins before and ends after what is heard of it."""
    mouths = _mouths(sound)
    part, cues = length / len(mouths), []
    for place, mouth in enumerate(mouths):
        lead = EARLY_VOWEL if sound[0].isupper() else EARLY
        begin, end = start + place * part - lead, start + (place + 1) * part + lead
        ramp = (end - begin) / 2.2
        firm = 1.0 if mouth in ("lips", "teeth") else strength  # closures are not slurred
        for name, level in VISEMES[mouth].items():
            cues += both(name, begin, end, firm * level, ramp, ramp)
    return cues


def _mouths(sound: str) -> list[str]:
    """The visemes of a sound."""
    if sound in VISEMES:
        return [sound]
    return next(mouths for sounds, mouths in SOUNDS.items() if sound in sounds.split()).split()


def _mood(begin: float, end: float, rng: np.random.Generator) -> list[tuple]:
    """What goes with a phrase: raised or knitted brows, a smile, or nothing."""
    kind, level = rng.choice(["up", "knit", "smile", "none"], p=[0.35, 0.2, 0.25, 0.2]), rng.uniform(0.3, 0.8)
    looks = {
        "up": (("browInnerUp", 1.0), ("browOuterUp*", 0.8), ("eyeWide*", 0.3)),
        "knit": (("browDown*", 1.0), ("eyeSquint*", 0.3), ("noseSneer*", 0.25)),
        "smile": (("mouthSmile*", 0.8), ("cheekSquint*", 0.6), ("eyeSquint*", 0.3)),
        "none": (),
    }
    start = begin + rng.uniform(0, 0.4) * (end - begin)
    return [cue for name, share in looks[str(kind)] for cue in both(name, start, end + 0.2, share * level, 0.22, 0.4)]


def _listen(now: float, rng: np.random.Generator) -> tuple[list[tuple], list[tuple], float]:
    """Cues of the face and of the head while the other one talks, and when that ends."""
    end = now + rng.uniform(1.5, 4.0)
    cues = _mood(now + 0.3, end - 0.3, rng) + both("mouthPress*", now + 0.2, end - 0.2, rng.uniform(0, 0.2), 0.4, 0.4)
    nods, at = [], now + rng.uniform(0.2, 0.6)
    while at < end - 0.5:
        kind, level = ("nod", 0.5) if rng.random() < 0.75 else ("shake", 0.4)
        for _ in range(rng.integers(1, 4)):
            nods.append((kind, at, at + 0.42, level * rng.uniform(0.5, 1.5), 0.2, 0.2))
            at += 0.45
        at += rng.uniform(0.6, 1.5)
    return cues, nods, end


def _head(nodding: np.ndarray, played: Animation, rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """(T, 4, 4): nods, shakes, a little of the brows' beat, and slow sway about the top of the neck."""
    count = len(nodding)
    sway = gaussian_filter1d(rng.normal(size=(count, 3)), 0.8 * played.rate, axis=0, mode="reflect")
    sway *= [0.05, 0.07, 0.03] / (sway.std(0) + 1e-9)
    brows = played.weights[:, played.names.index("browInnerUp")]
    sway[:, 0] += NOD * nodding[:, 0] - 0.04 * brows
    sway[:, 1] += NOD * nodding[:, 1]
    vertices = rig.mesh.vertices
    low, high = vertices.min(0), vertices.max(0)
    pivot = np.array([(low[0] + high[0]) / 2, low[1] + 0.3 * (high[1] - low[1]), (low[2] + high[2]) / 2])
    return motion_matrices(np.hstack([np.zeros((count, 3)), sway - sway[0]]), pivot)
