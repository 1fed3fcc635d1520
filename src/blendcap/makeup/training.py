"""Train a classifier of makeup patches on one performer who shows each action unit four or five times."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blendcap.data import InputError
from blendcap.makeup.augmentation import ELSEWHERE, painted_anew, thinned, warped
from blendcap.makeup.classifier import METHODS, PatchClassifier, RegionModel, margin, paint_amount, seen_features, tally
from blendcap.makeup.features import check_features
from blendcap.makeup.intensity import LEVELS, is_clear, recognized
from blendcap.makeup.labels import Labels, labeled
from blendcap.makeup.lesson import Lesson, counts, regions_of, shown_turns
from blendcap.makeup.patches import Patches, flows, laid_over
from blendcap.makeup.scales import SHOWN, fit_scales, scaled
from blendcap.makeup.units import ARKIT_TABLE, Region, shown_as_one

VARIANCE = {"svm": 0.9, "intensity": 0.99}  # of the features, that the principal components keep
MOST_FRAMES = 800  # from which principal components are taken, about
COPY = 1500  # frames of a warped copy, about
RIDGE = 3.0  # in the variance of all features together: from 1 to 10 it hardly matters
COST = 0.1  # C of the support vector machine
NEAR = 0.25  # an intensity that errs by less is right

log = logging.getLogger(__name__)
Take = tuple[Patches, Lesson]


def train_classifier(
    patches: Patches | Sequence[Patches],
    lesson: Lesson | Sequence[Lesson],
    *,
    regions: Sequence[Region] | None = None,
    method: str = "intensity",
    kind: str | None = None,
    relative: bool = True,
    table: Mapping[str, Mapping[str, float]] = ARKIT_TABLE,
    warps: int = 0,
    seed: int = 0,
) -> PatchClassifier:
    """Train on the patches of one performer.

    Parameters
    ----------
    patches : Patches, or those of several takes
        The first frame of each is neutral. Other faces are laid over that of the first take.
    lesson : Lesson, or one a take
    regions : sequence of Region, optional
        Units that no lesson shows are left out, and regions without a unit. Single units ("intensity") or the
        papers' classes ("svm") if not given.
    method : {"intensity", "svm"}
        Ridge regression on intensities, or the papers' classes of unit and level. A regression also learns from units
        that are shown together; of classes a frame is in one, so such frames are left out.
    kind : str, optional
        The features of all regions: gabor, hog, edges, motion or fine, or several joined by +. Each region's own if
        not given.
    relative : bool
        Take the neutral frame's features off.
    table : {unit: {shape: weight at full intensity}}
        Reads intensities off the weights of lessons that have such.
    warps : int
        Randomly warped copies of the training frames that are added, as the papers propose (9, Discussion). Intensities
        are told larger with them, and more often where there is nothing. Of long lessons a copy takes every so many
        frames.
    seed : int

    Raises
    ------
    InputError
        If the lessons are not as long as the patches, they show no unit of any region or one only once, their weights
        tell of no unit, or a name is unknown.
    """
    if warps < 0:
        raise InputError(f"The number of warped copies is {warps}, but must be 0 or more.")
    if method not in METHODS:
        raise InputError(f"The method {method!r} is unknown; choose one of {', '.join(METHODS)}.")
    takes = _takes(patches, lesson)
    regions = regions or regions_of(method)
    shown = shown_turns([taught for _, taught in takes], regions, method, table)
    if kind is not None:
        check_features(kind)
        regions = [region._replace(features=kind) for region in regions]
    if method == "svm":
        takes = [_one_at_a_time(*take, regions) for take in takes]
    models = []
    for region in regions:
        units = tuple(unit for unit in region.units if any(counts(turn, unit, method) for turn in shown))
        if units:
            labels = labeled(takes, region._replace(units=units), lambda t, u: counts(t, u, method), table, seed)
            models.append(_train_region(takes, labels, region._replace(units=units), method, relative, warps, seed))
            log.info("%s: %s", region.name, models[-1].scores)
    used = {name for model in models for name in model.region.patches}
    neutral = {name: picture for name, picture in takes[0][0].neutral.items() if name in used}
    return PatchClassifier(models, neutral, method, relative)


def _takes(patches: Patches | Sequence[Patches], lesson: Lesson | Sequence[Lesson]) -> list[Take]:
    """Takes and their lessons, all laid over the first."""
    many = [patches] if isinstance(patches, Patches) else list(patches)
    lessons = [lesson] if isinstance(lesson, Lesson) else list(lesson)
    if not many or len(many) != len(lessons):
        raise InputError(f"There are {len(many)} takes of patches, but {len(lessons)} lessons; give one a take.")
    for part, shown in zip(many, lessons, strict=True):
        frames = len(part.sure)
        if len(shown.units) != frames:
            raise InputError(
                f"The lesson has {len(shown.units)} frames, but the patches have {frames}; they must match."
            )
    goal = many[0].neutral
    for part in many[1:]:
        part.of(tuple(goal))
    laid = [many[0], *(laid_over(part, flows(part.neutral, goal)) for part in many[1:])]
    return list(zip(laid, lessons, strict=True))


def _one_at_a_time(patches: Patches, lesson: Lesson, regions: Sequence[Region]) -> Take:
    """The frames of rest and of turns that are a class of their own."""
    classes = {"", *(unit for region in regions for unit in region.units)}
    rows = np.array([unit in classes for unit in lesson.units])
    images = {name: frames[rows] for name, frames in patches.images.items()}
    kept = Patches(images, patches.rate, patches.sure[rows], patches.neutral)
    return kept, Lesson(lesson.units[rows], lesson.repetitions[rows])


@dataclass(frozen=True, eq=False)
class _Data:
    """What one region is trained on."""

    seen: np.ndarray  # (T, D) features
    amounts: np.ndarray  # (T, U) intensities
    labels: np.ndarray  # (T,) int, 0 at rest, else 1 + unit * (LEVELS - 1) + level - 1
    folds: np.ndarray  # (T,) int

    def part(self, rows: np.ndarray) -> _Data:
        return _Data(self.seen[rows], self.amounts[rows], self.labels[rows], self.folds[rows])


def _train_region(takes: Sequence[Take], labels: Labels, region: Region, method, relative, warps, seed) -> RegionModel:
    if labels.folds.max() < 1:
        raise InputError(
            f"The lesson shows each unit of the region {region.name!r} only once; let the performer repeat it 4 times."
        )
    whole = [patches for patches, _ in takes]
    data = _seen(whole, labels, np.arange(len(labels.folds)), region, relative)
    part, rows = thinned(whole, COPY)
    more = [
        _seen([warped(patches, region, seed + k) for patches in part], labels, rows, region, relative)
        for k in range(1, warps + 1)
    ]
    left_out = _left_out(data, more, method, seed)
    weights, offsets, classes = _fit(_joined([data, *more]), method, seed)
    shown = np.concatenate([paint_amount(patches, region) for patches in whole])
    coverage = np.stack([shown.min(0), shown.max(0)], axis=1).clip(1e-3)
    trust, errors, scales = np.array([0.0, 5.0]), np.zeros(len(region.units)), np.ones((len(region.units), 2))
    model = RegionModel(region, weights, offsets, classes, trust, coverage, errors, scales)
    if method == "intensity":
        model = replace(model, scales=_scales(model, whole, labels, relative, seed + warps))
    return _judged(model, data, left_out, shown_as_one(region.units, {t for _, lesson in takes for t in lesson.units}))


def _scales(model: RegionModel, takes: Sequence[Patches], labels: Labels, relative: bool, seed: int) -> np.ndarray:
    """The model's scales (U, 2), from copies that no machine was taught, as if others had painted them."""
    part, rows = thinned(takes, min(COPY, len(labels.folds)) // len(ELSEWHERE))
    seen = [
        seen_features(painted_anew(patches, model.region, seed + copy, size), model.region, relative)
        for copy, size in enumerate(ELSEWHERE, 1)
        for patches in part
    ]
    true = np.tile(labels.amounts[rows], (len(ELSEWHERE), 1))
    return fit_scales(np.concatenate(seen) @ model.weights.T + model.offsets, true, model.region.units)


def _seen(takes: Sequence[Patches], labels: Labels, rows: np.ndarray, region: Region, relative: bool) -> _Data:
    """Features of takes, of which `rows` of the labels tell."""
    seen = np.concatenate([seen_features(patches, region, relative) for patches in takes])
    return _Data(seen, labels.amounts[rows], labels.classes[rows], labels.folds[rows])


def _fit(data: _Data, method: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (K, D), offsets (K,) and classes of a machine on the principal components of the features."""
    mean, axes, deviations = _components(data.seen, method)
    slopes, shifts, classes = _machine((data.seen - mean) @ axes.T / deviations, data, method, seed)
    weights = (slopes / deviations) @ axes
    return np.ascontiguousarray(weights, dtype=np.float32), shifts - weights @ mean, classes


def _machine(inner: np.ndarray, data: _Data, method: str, seed: int):
    """Slopes (K, P), shifts (K,) and classes of a machine on components (T, P) of the data."""
    if method == "intensity":
        return *_regression(inner, data.amounts), np.zeros((0, 2), dtype=int)
    from sklearn.svm import SVC

    machine = SVC(kernel="linear", C=COST, decision_function_shape="ovo", random_state=seed)
    machine.fit(inner, data.labels)
    # With two classes the machine's one value is positive for the second, not the first.
    sign = -1 if len(machine.classes_) == 2 else 1
    kinds = np.array([(-1, 0) if c == 0 else divmod(c - 1, LEVELS - 1) for c in machine.classes_])
    return sign * machine.coef_, sign * machine.intercept_, kinds + [0, 1] * (kinds[:, :1] >= 0)


def _components(seen: np.ndarray, method: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (D,), principal axes (P, D) that keep `VARIANCE`, and what (P,) to divide by along them.

    The papers' machine wants all components alike; for a regression small ones are mostly noise and stay small.
    """
    mean = seen.mean(0)
    every = max(1, len(seen) // MOST_FRAMES)  # neighboring frames are alike
    centered = seen[::every] - mean
    values, vectors = np.linalg.eigh((centered @ centered.T).astype(np.float64))
    values, vectors = values[::-1].clip(0), vectors[:, ::-1]
    total = max(values.sum(), 1e-12)
    count = int(np.searchsorted(np.cumsum(values) / total, VARIANCE[method])) + 1
    scale = np.sqrt(np.maximum(values[:count], 1e-12))
    axes = (vectors[:, :count] / scale).T @ centered
    spread = scale if method == "svm" else np.full(count, np.sqrt(total))
    return mean.astype(np.float64), axes, spread / np.sqrt(len(centered))


def _regression(inner: np.ndarray, amounts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (U, P) and offsets (U,) of a ridge regression on centered components (T, P)."""
    center = amounts.mean(0)
    gram = inner.T @ inner + RIDGE * np.eye(inner.shape[1])
    return np.linalg.solve(gram, inner.T @ (amounts - center)).T, center


def _left_out(data: _Data, more: list[_Data], method: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """What is told of frames whose showings were left out of the training: intensities (T, U) and margins (T,)."""
    intensity, margins = np.zeros_like(data.amounts), np.zeros(len(data.seen))
    for fold in np.unique(data.folds):
        test = np.flatnonzero(data.folds == fold)
        known = _joined([part.part(np.flatnonzero(part.folds != fold)) for part in (data, *more)])
        weights, offsets, classes = _fit(known, method, seed)
        part = Region("", (), ("",) * data.amounts.shape[1])
        unscaled = np.ones((data.amounts.shape[1], 2))
        model = RegionModel(part, weights, offsets, classes, np.zeros(2), np.ones((0, 2)), np.zeros(0), unscaled)
        intensity[test], _ = model.answer(data.seen[test])
        if len(classes):
            margins[test] = margin(tally(data.seen[test] @ weights.T + offsets, len(classes)))
    return intensity, margins


def _joined(parts: list[_Data]) -> _Data:
    return _Data(*(np.concatenate(column) for column in zip(*(vars(part).values() for part in parts), strict=True)))


def _judged(model: RegionModel, data: _Data, left_out: tuple[np.ndarray, np.ndarray], whole) -> RegionModel:
    """The model with what left-out showings say of it: errors, accuracies, confusion, calibration."""
    told, margins = np.minimum(scaled(left_out[0], model.scales), 1), left_out[1]
    merge = np.zeros((len(model.region.units), len(whole)))
    for column, places in enumerate(whole.values()):
        merge[places, column] = 1 / len(places)
    true, said = data.amounts @ merge, told @ merge
    unit, answered = recognized(true), recognized(said)
    lone = np.count_nonzero(true > SHOWN, axis=1) < 2
    clear = is_clear(true) & lone
    confusion = np.zeros((len(whole) + 1, len(whole) + 1), dtype=int)
    np.add.at(confusion, (unit[clear] + 1, answered[clear] + 1), 1)
    right = (unit == answered) & (np.abs(said - true).max(1) < NEAR)
    scores = {
        "unit": float((unit == answered)[clear].mean()),
        "unit, all frames": float((unit == answered)[lone].mean()),
        "unit and intensity": float(right[lone].mean()),
    }
    errors = np.sqrt(((told - data.amounts) ** 2).mean(0))
    trust = _calibrated(margins[lone], right[lone]) if len(model.classes) else model.trust
    return replace(model, trust=trust, errors=errors, scores=scores, confusion=confusion, answers=("rest", *whole))


def _calibrated(margins: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Slope and offset of the logistic curve from margin to the probability of being right (Platt 1999)."""
    from sklearn.linear_model import LogisticRegression

    if right.all() or not right.any():
        return np.array([0.0, 5.0 if right.all() else -5.0])
    curve = LogisticRegression().fit(margins[:, None], right)
    return np.array([max(float(curve.coef_[0, 0]), 0.0), float(curve.intercept_[0])])
