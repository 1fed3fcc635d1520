"""What showings that were left out of the training say of a classifier of patches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blendcap.makeup.classifier import PatchClassifier, RegionModel

MIXED, MOST = 0.02, 6  # share of a unit's frames that are told as another from which on it is named; how many are


def left_out(classifier: PatchClassifier) -> dict[str, Any]:
    """Shares that were told right and counts of frames by true and told unit, region by region."""
    return {
        "left_out": {model.region.name: dict(model.scores) for model in classifier.models},
        "confusion": {
            model.region.name: {"answers": list(model.answers), "frames": model.confusion.tolist()}
            for model in classifier.models
        },
    }


def left_out_in_words(classifier: PatchClassifier) -> dict[str, str]:
    """The same for people."""
    return {
        "left_out": "; ".join(_told_right(model) for model in classifier.models if model.scores) or "not counted",
        "mixed_up": _mixed_up(classifier),
    }


def _told_right(model: RegionModel) -> str:
    scores = model.scores
    return (
        f"{model.region.name} {scores['unit']:.0%} of the clear frames told right, {scores['unit, all frames']:.0%} of "
        f"all, {scores['unit and intensity']:.0%} with the intensity, within 0.25"
    )


def _mixed_up(classifier: PatchClassifier) -> str:
    """The units that are most often taken for others, worst first."""
    if not any(model.answers for model in classifier.models):
        return "not counted; train anew"
    pairs = []
    for model in classifier.models:
        for row, (name, frames) in enumerate(zip(model.answers, model.confusion, strict=False)):
            for column, count in enumerate(frames):
                if column != row and count > MIXED * frames.sum():
                    said = f"{name} told as {model.answers[column]} in {count} of {frames.sum()} frames"
                    pairs.append((count / frames.sum(), said))
    pairs.sort(key=lambda pair: -pair[0])
    return "; ".join(said for _, said in pairs[:MOST]) or f"no unit in more than {MIXED:.0%} of its frames"
