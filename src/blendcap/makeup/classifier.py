"""Which action unit a frame shows, and how strongly: trained once on one performer, used on many.

Sections 7.2.2 to 7.2.4 of Reading Between the Dots (2016), 4.1.10 to 4.1.12 of the thesis. `method="svm"` is the
papers': classes of unit and level, a linear support vector machine, one against one. The default, `"intensity"`, is a
ridge regression on the units' intensities: it needs no levels, and several units of one region may be there at once.

All of it (principal components, scaling, the machine) is linear in the features, so a trained region is one matrix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from blendcap.makeup.features import features
from blendcap.makeup.intensity import LEVELS
from blendcap.makeup.patches import Patches
from blendcap.makeup.scales import scaled
from blendcap.makeup.units import Region

METHODS = ("intensity", "svm")
STRANGE = 1.5  # factor beyond the range of paint of the training at which a patch is no longer believed


@dataclass(frozen=True, eq=False)
class RegionModel:
    """What was learned of one region.

    Parameters
    ----------
    region : Region
    weights : (K, D) float32
    offsets : (K,) float64
        Scores are `weights @ features + offsets`: a pair of classes each (svm) or a unit each (intensity).
    classes : (C, 2) int
        Unit, -1 at rest, and level of each class (svm); empty for "intensity".
    trust : (2,)
        Slope and offset of the logistic curve from margin to probability (svm).
    coverage : (P, 2)
        Least and most paint in each patch while training, in multiples of the neutral's.
    errors : (U,)
        Standard deviation of each unit's intensity on repetitions that were left out of the training.
    scales : (U, 2)
        Gain and bend of each unit: its intensity is gain * score ** bend (intensity).
    scores : {name: float}
        Accuracies on repetitions that were left out.
    confusion : (H + 1, H + 1) int
        Frames by true unit (rows; at rest first) and answered unit, left out of the training.
    answers : (H + 1,) str
        Names of its rows and columns: "rest", and units; those that only ever come together are one.
    """

    region: Region
    weights: np.ndarray
    offsets: np.ndarray
    classes: np.ndarray
    trust: np.ndarray
    coverage: np.ndarray
    errors: np.ndarray
    scales: np.ndarray
    scores: Mapping[str, float] = field(default_factory=dict)
    confusion: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), dtype=int))
    answers: tuple[str, ...] = ()

    def answer(self, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Intensity (T, U), of which 1 and more is full, of each unit, and how probable each is to be right (T, U)."""
        values = seen @ self.weights.T + self.offsets
        if not len(self.classes):
            return scaled(values, self.scales), np.ones_like(values)
        votes = tally(values, len(self.classes))
        best = votes.argmax(1)
        intensity = np.zeros((len(seen), len(self.region.units)))
        unit, level = self.classes[best].T
        shown = np.flatnonzero(unit >= 0)
        intensity[shown, unit[shown]] = level[shown] / (LEVELS - 1)
        probable = 1 / (1 + np.exp(-(self.trust[0] * margin(votes) + self.trust[1])))
        return intensity, np.repeat(probable[:, None], intensity.shape[1], axis=1)


@dataclass(frozen=True, eq=False)
class PatchClassifier:
    """A trained classifier of makeup patches.

    Parameters
    ----------
    models : sequence of RegionModel
    neutral : {patch: (h, w) uint8}
        The training face at rest: other faces are laid over it.
    method : {"intensity", "svm"}
    relative : bool
        Whether the features of a performer's own neutral frame are taken off.
    """

    models: Sequence[RegionModel]
    neutral: Mapping[str, np.ndarray]
    method: str = "intensity"
    relative: bool = True

    @property
    def units(self) -> tuple[str, ...]:
        """The action units that it tells, region by region."""
        return tuple(unit for model in self.models for unit in model.region.units)

    def familiar(self, patches: Patches, laid: Patches | None = None) -> np.ndarray:
        """(T, U) how far each unit's patches look like those of the training, 0 to 1: smeared paint does not."""
        known = []
        for model in self.models:
            amount = paint_amount(self._view(model, patches, laid), model.region)
            known.append(np.repeat(_familiar(amount, model.coverage)[:, None], len(model.region.units), axis=1))
        return np.concatenate(known, axis=1)

    def __call__(self, patches: Patches, laid: Patches | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Intensities (T, U), of which 1 and more is full, and probabilities (T, U) of the units in each frame.

        Regions that want faces laid over each other look at `laid`, if there is such.
        """
        answers = [
            model.answer(seen_features(self._view(model, patches, laid), model.region, self.relative))
            for model in self.models
        ]
        return tuple(np.concatenate(part, axis=1) for part in zip(*answers, strict=True))  # pyright: ignore

    @staticmethod
    def _view(model: RegionModel, patches: Patches, laid: Patches | None) -> Patches:
        return laid if model.region.aligned and laid is not None else patches


def seen_features(patches: Patches, region: Region, relative: bool) -> np.ndarray:
    """Features (T, D) of a region; without those of the neutral frame if `relative`."""
    neutral = [patches.neutral[name] for name in region.patches]
    seen = features(patches.of(region.patches), neutral, region.features)
    return seen - features([picture[None] for picture in neutral], neutral, region.features) if relative else seen


def paint_amount(patches: Patches, region: Region) -> np.ndarray:
    """(T, P) how much paint each patch of a region shows, in multiples of its neutral frame's."""
    shown = np.stack([frames.mean((1, 2), dtype=np.float64) for frames in patches.of(region.patches)], axis=1)
    return shown / np.maximum([patches.neutral[name].mean() for name in region.patches], 1e-9)


def _familiar(amount: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    """(T,) 1 within the range of paint that was seen, falling to 0 at `STRANGE` times more or less."""
    least, most = coverage.T
    beyond = np.maximum(np.log(np.maximum(amount, 1e-9) / most), np.log(least / np.maximum(amount, 1e-9)))
    return np.clip(1 - beyond / np.log(STRANGE), 0, 1).min(1)


def tally(values: np.ndarray, count: int) -> np.ndarray:
    """Votes (T, C) of machines for pairs of classes, values (T, C (C - 1) / 2); ties go to the surer."""
    votes = np.zeros((len(values), count))
    first, second = np.triu_indices(count, 1)
    soft = np.tanh(values) / (3 * count)
    for pair, (i, j) in enumerate(zip(first, second, strict=True)):
        won = values[:, pair] > 0
        votes[:, i] += won + soft[:, pair]
        votes[:, j] += ~won - soft[:, pair]
    return votes


def margin(votes: np.ndarray) -> np.ndarray:
    """How many votes the winner is ahead, (T,)."""
    best = np.sort(votes, axis=1)
    return best[:, -1] - best[:, -2]
