"""A patch classifier as plain arrays and a description, for a file, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from blendcap.data import InputError
from blendcap.makeup.classifier import METHODS, PatchClassifier, RegionModel
from blendcap.makeup.features import check_features, features
from blendcap.makeup.units import Region

LEAST = 16  # pixels of a patch: smaller ones no filter fits
KIND, VERSION = "patch classifier", 4
_ARRAYS = ("weights", "offsets", "classes", "trust", "coverage", "errors", "scales", "confusion")


def pack(classifier: PatchClassifier) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The description, ready for JSON, and the arrays of a classifier."""
    arrays = {f"neutral:{name}": picture for name, picture in classifier.neutral.items()}
    for i, model in enumerate(classifier.models):
        arrays |= {f"{i}:{name}": np.asarray(getattr(model, name)) for name in _ARRAYS}
    regions = [m.region._asdict() | {"scores": dict(m.scores), "answers": m.answers} for m in classifier.models]
    meta = {
        "method": classifier.method, "relative": classifier.relative, "regions": regions, "units": classifier.units,
        "unit": "intensity, 1 is full",
    }  # fmt: skip
    return meta, arrays


def unpack(meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> PatchClassifier:
    """The classifier that `pack` took apart.

    Raises
    ------
    InputError
        If something is missing or does not fit together.
    """
    try:
        models = [_model(i, entry, arrays) for i, entry in enumerate(meta["regions"])]
        neutral = {key.partition(":")[2]: value for key, value in arrays.items() if key.startswith("neutral:")}
        method, relative = meta["method"], bool(meta["relative"])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"The patch classifier is damaged ({error}); train it anew.") from None
    if method not in METHODS or not models:
        raise InputError(f"The patch classifier is of a form that is not known ({method!r}); train it anew.")
    for model in models:
        check_features(model.region.features)
        _check(model, method, neutral)
    return PatchClassifier(models, neutral, method, relative)


def _model(i: int, entry: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> RegionModel:
    patches, units = (tuple(map(str, entry[part])) for part in ("patches", "units"))
    region = Region(str(entry["name"]), patches, units, str(entry["features"]), bool(entry["aligned"]))
    values = {name: arrays[f"{i}:{name}"] for name in _ARRAYS}
    scores = {str(name): float(score) for name, score in entry["scores"].items()}
    return RegionModel(region, **values, scores=scores, answers=tuple(map(str, entry.get("answers", ()))))


def _check(model: RegionModel, method: str, neutral: Mapping[str, np.ndarray]) -> None:
    units, classes = len(model.region.units), len(model.classes)
    rows = classes * (classes - 1) // 2 if method == "svm" else units
    numbers = (model.weights, model.offsets, model.trust, model.errors, model.scales, model.coverage)
    fits = (
        all(values.dtype.kind in "fiu" and np.isfinite(values).all() for values in numbers)
        and model.weights.ndim == 2
        and model.weights.shape[0] == rows == len(model.offsets)
        and model.classes.shape == (classes, 2)
        and (classes > 1) == (method == "svm")
        and model.errors.shape == (units,)
        and model.scales.shape == (units, 2)
        and (model.scales > 0).all()
        and model.trust.shape == (2,)
        and model.coverage.shape == (len(model.region.patches), 2)
        and (model.coverage > 0).all()
        and (model.coverage[:, 0] <= model.coverage[:, 1]).all()
        and (model.errors >= 0).all()
        and set(model.region.patches) <= set(neutral)
        and len(set(model.region.units)) == units
        and model.confusion.dtype.kind == model.classes.dtype.kind == "i"
        and (not model.answers or _is_judged(model))
        and model.weights.shape[1] == _width(model.region, neutral)
    )
    if not fits:
        raise InputError(f"The patch classifier's region {model.region.name!r} does not fit together; train it anew.")


def _is_judged(model: RegionModel) -> bool:
    """Whether all is there that left-out showings say."""
    shares = {"unit", "unit, all frames", "unit and intensity"}
    return model.confusion.shape == (len(model.answers),) * 2 and shares <= set(model.scores)


def _width(region: Region, neutral: Mapping[str, np.ndarray]) -> int:
    """How many features are seen of a region; -1 if its neutral patches are no pictures, or too small."""
    pictures = [neutral[name] for name in region.patches]
    if not all(picture.ndim == 2 and min(picture.shape) >= LEAST and picture.dtype == np.uint8 for picture in pictures):
        return -1
    return features([picture[None] for picture in pictures], pictures, region.features).shape[1] if pictures else 0
