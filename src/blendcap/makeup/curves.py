"""From answers frame by frame to curves of weights that a solve may lean on.

Sections 7.2 and 7.2.4 of Reading Between the Dots (2016), 4.1.8 and 4.1.12 of the thesis.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from blendcap.data import Animation, InputError
from blendcap.makeup.blinks import LIDS, with_full_blinks
from blendcap.makeup.classifier import PatchClassifier
from blendcap.makeup.patches import Patches, flows, laid_over
from blendcap.makeup.units import ARKIT_TABLE
from blendcap.numerics.smoothing import smooth

# Seconds of the smoothing window. The papers' are 20 to 30 frames, here at 60 frames a second. The others were chosen
# on tuning takes: curves as smooth as the markers alone make them, and blinks that keep their height.
WINDOWS: Mapping[str, float] = {"svm": 25 / 60, "intensity": 0.35}
LID_WINDOW = 7 / 30
QUICK = ("AU5", "AU43", "AU45", "AU63", "AU64")  # what lids do
INFLUENCE_WINDOW = 15 / 60  # seconds over which the influence rises and falls
LEAST_FRAMES = 5  # of a window: a parabola through three frames smooths nothing
SURE = 0.1  # an intensity that errs by no more than this is fully trusted
SHOWN = 0.05  # an intensity below is rest


def classify(
    classifier: PatchClassifier,
    patches: Patches | Iterable[Patches],
    *,
    table: Mapping[str, Mapping[str, float]] = ARKIT_TABLE,
    aligned: bool | None = None,
    everywhere: bool = True,
    full_blinks: bool = True,
) -> Animation:
    """Curves of weights, by shape names, that makeup patches tell.

    Parameters
    ----------
    classifier : PatchClassifier
    patches : Patches, or its blocks one after the other
        Of any performer.
    table : {unit: {shape: weight at full intensity}}
        Made once for each rig; ARKit's names if not given.
    aligned : bool, optional
        Whether the performer's neutral is laid over that of the training face first, by optical flow. As each region
        wants it if not given: the scales of its units are learned so.
    everywhere : bool
        Let the curves speak at rest too (a lid that is open is as well seen as one that is shut). If not, their
        influence is zero where no unit is seen, as in the papers, and the markers rule.
    full_blinks : bool
        Put the lids' curves on the performer's own scale: a take's strongest blinks shut the eyes. Another face shows
        the teacher's blink more or less strongly. The papers' machine tells classes and is left alone.

    Returns
    -------
    Animation
        `confidence` is the influence, 0 to 1, of each curve.

    Raises
    ------
    InputError
        If the table lacks a unit, there is no frame, or the patches are not those of the classifier.
    """
    lacking = [unit for unit in classifier.units if unit not in table]
    if lacking:
        raise InputError(
            f"The table from units to shapes has no entry for {lacking[0]!r}; add it, empty if the rig has no shape."
        )
    blocks = [patches] if isinstance(patches, Patches) else patches
    intensity, probability, rate = _answers(classifier, blocks, aligned)
    intensity = _smoothed(intensity, classifier, rate)
    if full_blinks and classifier.method == "intensity":
        intensity = with_full_blinks(intensity, classifier.units)
    intensity = np.minimum(intensity, 1)
    errors = np.concatenate([model.errors for model in classifier.models])
    trust = np.minimum(1, (SURE / np.maximum(errors, 1e-6)) ** 2) * probability
    if not everywhere:
        trust = trust * (intensity > SHOWN)
    trust = np.clip(smooth(trust, rate, _window(INFLUENCE_WINDOW, rate)), 0, 1)
    names, weights, confidence = _on_shapes(classifier.units, intensity, trust, table)
    return Animation(weights, names, rate, confidence=confidence, meta={"source": "makeup patches"})


def _smoothed(intensity: np.ndarray, classifier: PatchClassifier, rate: float) -> np.ndarray:
    """Intensities (T, U), smooth: those of lids over a shorter window, but for the papers' machine.

    Lids may be told more than shut: blinks, whose scale is not the lesson's, are not cut off before it is known.
    """
    bare = np.array([unit.rstrip("LR") for unit in classifier.units])
    told = np.minimum(intensity, np.where(np.isin(bare, LIDS), np.inf, 1.0))
    result = smooth(told, rate, _window(WINDOWS[classifier.method], rate))
    quick = np.isin(bare, QUICK)
    if classifier.method == "intensity" and quick.any():
        result[:, quick] = smooth(told[:, quick], rate, _window(LID_WINDOW, rate))
    return np.maximum(result, 0)


def _window(seconds: float, rate: float) -> float:
    """Seconds of a smoothing window at this rate: what was asked for, and no less than `LEAST_FRAMES`."""
    return max(seconds, LEAST_FRAMES / rate)


def _answers(classifier: PatchClassifier, blocks: Iterable[Patches], aligned: bool | None = None):
    """Intensities (T, U), how far to believe them (T, U), and the rate.

    Belief falls where the machine is unsure, the stabilizing points were lost or the paint looks like none before.
    """
    wanted = {name for m in classifier.models if aligned or m.region.aligned for name in m.region.patches}
    goal = {name: picture for name, picture in classifier.neutral.items() if name in wanted and aligned is not False}
    parts, tables, rate = [], None, 0.0
    for block in blocks:
        rate = block.rate
        block.of(tuple(classifier.neutral))
        tables = flows(block.neutral, goal) if tables is None else tables
        laid = laid_over(block, tables) if tables else block
        view = laid if aligned else block
        intensity, probability = classifier(view, laid)
        parts.append((intensity, probability * classifier.familiar(view, laid) * block.sure[:, None]))
    if not parts:
        raise InputError("There are no patches to classify: the film has no frame; check the videos.")
    intensity, probability = (np.concatenate(part) for part in zip(*parts, strict=True))
    return intensity, probability, rate


def _on_shapes(units, intensity, trust, table) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Weights and influence (T, N) of shapes: the strongest unit that moves a shape speaks for it."""
    names = tuple(dict.fromkeys(shape for unit in units for shape in table[unit]))
    weights, confidence = np.zeros((2, len(intensity), len(names)))
    for column, name in enumerate(names):
        moving = [u for u, unit in enumerate(units) if name in table[unit]]
        said = intensity[:, moving] * [table[units[u]][name] for u in moving]
        best = said.argmax(1)
        rows = np.arange(len(said))
        weights[:, column] = np.clip(said[rows, best], 0, 1)
        confidence[:, column] = trust[:, moving][rows, best]
    return names, weights, confidence
