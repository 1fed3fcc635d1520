"""Train a classifier of makeup patches on one performer who shows each action unit four or five times."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blendcap.data import InputError
from blendcap.makeup.augmentation import warped
from blendcap.makeup.classifier import METHODS, PatchClassifier, RegionModel, margin, paint_amount, seen_features, tally
from blendcap.makeup.intensity import LEVELS, measure_intensity
from blendcap.makeup.lesson import Lesson
from blendcap.makeup.patches import Patches
from blendcap.makeup.units import PAPER_REGIONS, REGIONS, Region, shows

VARIANCE = 0.9  # of the features, that the principal components keep
MOST_FRAMES = 800  # from which principal components are taken, about
RIDGES = (1.0, 10.0, 100.0, 1000.0)
SOFT = 3.0  # pixels of blur before the modes of variation are sought
COST = 0.1  # C of the support vector machine
FOLDS = 5
STILL = 1e-4  # of white, root mean square: patches that change by less do not move

log = logging.getLogger(__name__)


def train_classifier(
    patches: Patches,
    lesson: Lesson,
    *,
    regions: Sequence[Region] | None = None,
    method: str = "intensity",
    kind: str = "gabor",
    relative: bool = True,
    warps: int = 0,
    seed: int = 0,
) -> PatchClassifier:
    """Train on the patches of one performer.

    Parameters
    ----------
    patches : Patches
        The first frame is neutral.
    lesson : Lesson
    regions : sequence of Region, optional
        Units that the lesson does not show are left out, and regions without a unit. Single units ("intensity") or the
        papers' classes ("svm") if not given.
    method : {"intensity", "svm"}
        Ridge regression on intensities, or the papers' classes of unit and level. A regression also learns from units
        that are shown together; of classes a frame is in one, so such frames are left out.
    kind : {"gabor", "hog", "edges"}
        The features.
    relative : bool
        Take the neutral frame's features off.
    warps : int
        Randomly warped copies of the training frames that are added, as the papers propose (9, Discussion).
    seed : int

    Raises
    ------
    InputError
        If the lesson's length is not that of the patches, it shows no unit of any region or one only once, or a name
        is unknown.
    """
    if method not in METHODS:
        raise InputError(f"The method {method!r} is unknown; choose one of {', '.join(METHODS)}.")
    frames = len(next(iter(patches.images.values())))
    if len(lesson.units) != frames:
        raise InputError(f"The lesson has {len(lesson.units)} frames, but the patches have {frames}; they must match.")
    shown = set(lesson.units) - {""}
    regions = regions or (REGIONS if method == "intensity" else PAPER_REGIONS)
    if method == "svm":
        patches, lesson = _one_at_a_time(patches, lesson, regions)
    foreign = sorted(t for t in shown if not any(_counts(t, unit, method) for r in regions for unit in r.units))
    if foreign and len(foreign) < len(shown):
        known = ", ".join(dict.fromkeys(unit for region in regions for unit in region.units))
        log.warning("The showings of %s teach none of the units that are told: %s.", ", ".join(foreign), known)
    models = []
    for region in regions:
        units = tuple(unit for unit in region.units if any(_counts(turn, unit, method) for turn in shown))
        if units:
            part = Region(region.name, region.patches, units)
            models.append(_train_region(patches, lesson, part, method, kind, relative, warps, seed))
            log.info("%s: %s", region.name, models[-1].scores)
    if not models:
        raise InputError(f"The lesson shows none of the units of the regions; it shows {', '.join(sorted(shown))}.")
    return PatchClassifier(models, patches.neutral, method, kind, relative)


def _counts(turn: str, unit: str, method: str) -> bool:
    """Whether a turn teaches a unit: of classes a frame is in one."""
    return turn == unit if method == "svm" else shows(turn, unit)


def _one_at_a_time(patches: Patches, lesson: Lesson, regions: Sequence[Region]) -> tuple[Patches, Lesson]:
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
    units: np.ndarray  # (T,) int, the unit shown; -1 at rest
    amounts: np.ndarray  # (T, U) intensities
    labels: np.ndarray  # (T,) int, 0 at rest, else 1 + unit * (LEVELS - 1) + level - 1
    folds: np.ndarray  # (T,) int

    def part(self, rows: np.ndarray) -> _Data:
        return _Data(self.seen[rows], self.units[rows], self.amounts[rows], self.labels[rows], self.folds[rows])


def _train_region(patches, lesson: Lesson, region: Region, method, kind, relative, warps, seed) -> RegionModel:
    scales, units, amounts, labels = _labeled(patches, lesson, region, method, seed)
    folds = _folds(lesson)
    if folds.max() < 1:
        raise InputError(
            f"The lesson shows each unit of the region {region.name!r} only once; let the performer repeat it 4 times."
        )
    data = _Data(seen_features(patches, region, kind, relative), units, amounts, labels, folds)
    more = [
        _Data(seen_features(warped(patches, region, seed + k), region, kind, relative), units, amounts, labels, folds)
        for k in range(1, warps + 1)
    ]
    ridge, left_out = _left_out(data, more, method, seed)
    weights, offsets, classes = _fit(_joined([data, *more]), method, ridge, seed)
    shown = paint_amount(patches, region)
    coverage = np.stack([shown.min(0), shown.max(0)], axis=1).clip(1e-3)
    model = RegionModel(region, weights, offsets, classes, np.array([0.0, 5.0]), coverage, np.zeros(len(region.units)))
    return _judged(model, data, left_out, scales)


def _labeled(patches: Patches, lesson: Lesson, region: Region, method: str, seed: int):
    """Scales of the units, the unit of each frame, intensities (T, U) and classes (T,) of the training frames.

    Units that are shown together rise and fall together, along one mode of their own.
    """
    pictures = np.concatenate([_soft(frames) for frames in patches.of(region.patches)], axis=1)
    rest = np.concatenate([_soft(patches.neutral[name][None])[0] for name in region.patches])
    units, labels = np.full(len(pictures), -1), np.zeros(len(pictures), dtype=int)
    amounts, scales = np.zeros((len(pictures), len(region.units))), {}
    for turn in sorted(set(lesson.units) - {""}, key=lambda turn: (-len(turn), turn)):
        taught = np.flatnonzero([_counts(turn, unit, method) for unit in region.units])
        if not len(taught):
            continue
        own = np.flatnonzero(lesson.units == turn)
        _check_moves(pictures[own] - rest, turn, region.name)
        scale = measure_intensity(pictures[own], rest, seed)
        level = scale.level(pictures[own])
        amounts[np.ix_(own, taught)] = scale.amount(pictures[own])[:, None]
        units[own], labels[own] = taught[0], np.where(level > 0, taught[0] * (LEVELS - 1) + level, 0)
        scales |= dict.fromkeys(taught.tolist(), scale)  # the shortest name comes last: the unit on its own
    return tuple(scales[u] for u in range(len(region.units))), units, amounts, labels


def _check_moves(motion: np.ndarray, turn: str, region: str) -> None:
    """Refuse showings that show nothing: a frozen film would be told perfectly, and tell nothing."""
    if len(motion) < LEVELS:
        raise InputError(f"The lesson shows {turn} in {len(motion)} frames; it takes at least {LEVELS}.")
    if np.sqrt((motion**2).mean()) < STILL:
        raise InputError(
            f"Where the lesson shows {turn}, the patches of the region {region!r} do not move; check that the video "
            "plays and that its times are those of the showings."
        )


def _soft(frames: np.ndarray) -> np.ndarray:
    """Pictures (T, h * w / 4), blurred: a thin stroke that moves by more than its width still moves along one mode."""
    import cv2

    size = (frames.shape[2] // 2, frames.shape[1] // 2)
    soft = [cv2.resize(cv2.GaussianBlur(frame, (0, 0), SOFT), size, interpolation=cv2.INTER_AREA) for frame in frames]
    return np.stack(soft).reshape(len(frames), -1).astype(np.float32) / 255


def _folds(lesson: Lesson) -> np.ndarray:
    """(T,) which fold a frame is in: the k-th showing of a unit, with the rest after it, is in fold k modulo FOLDS."""
    folds, seen, fold = np.zeros(len(lesson.units), dtype=int), {}, 0
    last = None
    for t, (unit, repetition) in enumerate(zip(lesson.units, lesson.repetitions, strict=True)):
        if unit and repetition != last:
            fold = seen.get(unit, 0)
            seen[unit], last = fold + 1, repetition
        folds[t] = fold % FOLDS
    return folds


def _fit(data: _Data, method: str, ridge: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (K, D), offsets (K,) and classes of a machine on the principal components of the features."""
    mean, axes, deviations = _components(data.seen)
    slopes, shifts, classes = _machine((data.seen - mean) @ axes.T / deviations, data, method, ridge, seed)
    weights = (slopes / deviations) @ axes
    return np.ascontiguousarray(weights, dtype=np.float32), shifts - weights @ mean, classes


def _machine(inner: np.ndarray, data: _Data, method: str, ridge: float, seed: int):
    """Slopes (K, P), shifts (K,) and classes of a machine on components (T, P) of the data."""
    if method == "intensity":
        return *_regression(inner, data.amounts, ridge), np.zeros((0, 2), dtype=int)
    from sklearn.svm import SVC

    machine = SVC(kernel="linear", C=COST, decision_function_shape="ovo", random_state=seed)
    machine.fit(inner, data.labels)
    # With two classes the machine's one value is positive for the second, not the first.
    sign = -1 if len(machine.classes_) == 2 else 1
    kinds = np.array([(-1, 0) if c == 0 else divmod(c - 1, LEVELS - 1) for c in machine.classes_])
    return sign * machine.coef_, sign * machine.intercept_, kinds + [0, 1] * (kinds[:, :1] >= 0)


def _components(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (D,), principal axes (P, D) that keep `VARIANCE`, and the deviations (P,) along them."""
    mean = seen.mean(0)
    every = max(1, len(seen) // MOST_FRAMES)  # neighboring frames are alike
    centered = seen[::every] - mean
    values, vectors = np.linalg.eigh((centered @ centered.T).astype(np.float64))
    values, vectors = values[::-1].clip(0), vectors[:, ::-1]
    count = int(np.searchsorted(np.cumsum(values) / max(values.sum(), 1e-12), VARIANCE)) + 1
    scale = np.sqrt(np.maximum(values[:count], 1e-12))
    axes = (vectors[:, :count] / scale).T @ centered
    return mean.astype(np.float64), axes, scale / np.sqrt(len(centered))


def _regression(inner: np.ndarray, amounts: np.ndarray, ridge: float) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (U, P) and offsets (U,) of a ridge regression on centered components (T, P)."""
    center = amounts.mean(0)
    gram = inner.T @ inner + ridge * np.eye(inner.shape[1])
    return np.linalg.solve(gram, inner.T @ (amounts - center)).T, center


def _left_out(data: _Data, more: list[_Data], method: str, seed: int):
    """The ridge that errs least on frames whose showings were left out of the training, and what is told of these.

    Returns
    -------
    ridge : float
    told : (intensities (T, U), margins (T,))
    """
    ridges = RIDGES if method == "intensity" else (0.0,)
    intensity, margins = np.zeros((len(ridges), *data.amounts.shape)), np.zeros(len(data.seen))
    for fold in np.unique(data.folds):
        test, rest = np.flatnonzero(data.folds == fold), np.flatnonzero(data.folds != fold)
        known = _joined([part.part(rest) for part in (data, *more)])
        mean, axes, deviations = _components(known.seen)
        inner, outer = ((seen - mean) @ axes.T / deviations for seen in (known.seen, data.seen[test]))
        for k, ridge in enumerate(ridges):
            slopes, shifts, classes = _machine(inner, known, method, ridge, seed)
            part = Region("", (), ("",) * data.amounts.shape[1])
            model = RegionModel(part, slopes, shifts, classes, np.zeros(2), np.ones((0, 2)), np.zeros(0))
            intensity[k, test], _ = model.answer(outer)
            if len(classes):
                margins[test] = margin(tally(outer @ slopes.T + shifts, len(classes)))
    best = int(((intensity - data.amounts) ** 2).sum((1, 2)).argmin())
    return ridges[best], (intensity[best], margins)


def _joined(parts: list[_Data]) -> _Data:
    return _Data(*(np.concatenate(column) for column in zip(*(vars(part).values() for part in parts), strict=True)))


def _judged(model: RegionModel, data: _Data, left_out: tuple[np.ndarray, np.ndarray], scales) -> RegionModel:
    """The model with what left-out showings say of it: errors, accuracies, confusion, calibration."""
    intensity, margins = left_out
    count = len(model.region.units)
    true, said = recognized(data.amounts), recognized(intensity)
    lone = np.count_nonzero(data.amounts, axis=1) < 2
    clear = is_clear(data.amounts) & lone
    confusion = np.zeros((count + 1, count + 1), dtype=int)
    np.add.at(confusion, (true[clear] + 1, said[clear] + 1), 1)
    levels = np.stack([np.abs(intensity[:, [u]] - scale.centers).argmin(1) for u, scale in enumerate(scales)], 1)
    rows = np.arange(len(true))
    answered = np.where(said >= 0, said * (LEVELS - 1) + levels[rows, np.maximum(said, 0)], 0)
    scores = {
        "unit": float((true == said)[clear].mean()),
        "unit, all frames": float((true == said)[lone].mean()),
        "unit and level": float((answered == data.labels)[lone].mean()),
    }
    errors = np.sqrt(((intensity - data.amounts) ** 2).mean(0))
    trust = model.trust if not len(model.classes) else _calibrated(margins[lone], (answered == data.labels)[lone])
    return replace(model, trust=trust, errors=errors, scales=scales, scores=scores, confusion=confusion)


def recognized(amounts: np.ndarray) -> np.ndarray:
    """(T,) the unit that is strongest, -1 where none reaches a sixth of full intensity (half the way to level 1)."""
    best = amounts.argmax(1)
    return np.where(amounts[np.arange(len(amounts)), best] >= 0.5 / (LEVELS - 1), best, -1)


def is_clear(amounts: np.ndarray) -> np.ndarray:
    """(T,) bool: plainly at rest or plainly not; in between even a person could not say."""
    strongest = amounts.max(1)
    return (strongest < 0.12) | (strongest > 0.3)


def _calibrated(margins: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Slope and offset of the logistic curve from margin to the probability of being right (Platt 1999)."""
    from sklearn.linear_model import LogisticRegression

    if right.all() or not right.any():
        return np.array([0.0, 5.0 if right.all() else -5.0])
    curve = LogisticRegression().fit(margins[:, None], right)
    return np.array([max(float(curve.coef_[0, 0]), 0.0), float(curve.intercept_[0])])
