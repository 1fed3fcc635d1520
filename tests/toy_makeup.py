"""Strokes of paint that move as action units would move them, without a face: for tests of patches and classifiers."""

import cv2
import numpy as np

from blendcap.makeup.lesson import Lesson
from blendcap.makeup.patches import Patches
from blendcap.makeup.regions import PATCH_SIZE
from blendcap.makeup.units import Region

RATE = 60.0
REGION = Region("brows", ("forehead", "glabella"), ("AU1+2", "AU4", "AU9"))
# What a unit does to the strokes at full intensity, pixels: shift of the forehead's, squeeze of the glabella's, rise.
MOTION = {"AU1+2": (-6.0, 0.0, 0.0), "AU4": (5.0, 6.0, 0.0), "AU9": (0.0, 2.0, -8.0)}


def draw(amounts: dict[str, float], build: float = 0.0) -> dict[str, np.ndarray]:
    """The two patches of a person whose strokes sit `build` pixels elsewhere."""
    shift, squeeze, rise = sum(np.array(MOTION[unit]) * a for unit, a in amounts.items()) + np.zeros(3)
    width, height = PATCH_SIZE
    images = {name: np.zeros((height, width), dtype=np.uint8) for name in REGION.patches}
    for row in (14, 26):
        y = row + shift + 0.4 * build
        curve = [(x, y + 0.01 * (x - 28) ** 2 * (1 + 0.05 * build)) for x in range(8, 50, 3)]
        _line(images["forehead"], curve)
    for side in (-1, 1):
        x = width / 2 + side * (11 + build - squeeze)
        _line(images["glabella"], [(x, 8 + rise), (x + 2 * side, 36 + rise)])
    return images


def _line(image: np.ndarray, points) -> None:
    line = np.round(np.array(points) * 16).astype(np.int32)
    cv2.polylines(image, [line], False, 255, 2, cv2.LINE_8, 4)


def perform(repetitions: int = 4, build: float = 0.0, seed: int = 0) -> tuple[Patches, Lesson, np.ndarray]:
    """Each unit several times, rising and falling within a second, with rest between; the true intensities (T, U)."""
    rng = np.random.default_rng(seed)
    hump = np.sin(np.pi * np.arange(40) / 39) ** 2
    amounts, spans, frame = [np.zeros((5, 3))], [], 5
    for _ in range(repetitions):
        for u in rng.permutation(3):
            part = np.zeros((40, 3))
            part[:, u] = hump * rng.uniform(0.7, 1.0)
            amounts += [part, np.zeros((8, 3))]
            spans.append((frame / RATE, (frame + 40) / RATE, REGION.units[u]))
            frame += 48
    truth = np.concatenate(amounts)
    frames = [draw(dict(zip(REGION.units, row, strict=True)), build) for row in truth]
    images = {name: np.stack([frame[name] for frame in frames]) for name in REGION.patches}
    patches = Patches(images, RATE, np.ones(len(truth)), draw({}, build))
    return patches, Lesson.of_spans(spans, len(truth), RATE), truth
