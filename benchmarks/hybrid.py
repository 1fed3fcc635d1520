"""Makeup patches: how well action units are told, and what they add to the marker solve.

    python benchmarks/hybrid.py [--cache FOLDER] [--faces mannequin ICT] [--parts solve layouts units flaws] [--brief]
        [--draws 3] [--jobs 2]

Films take most of the time; what was cut from them is kept in the cache folder, and of those that are solved all
frames, 0.5 GB each. `--brief` leaves out of `solve` the papers' method and machine, and the extremes. `--draws` films
each performer with so many draws of paint and markers, and `--jobs` solves so many films at a time.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from blendcap.makeup.classifier import PatchClassifier
from blendcap.makeup.curves import _answers, _smoothed
from blendcap.makeup.intensity import is_clear, recognized
from blendcap.makeup.scales import scaled
from blendcap.makeup.training import train_classifier
from blendcap.makeup.units import PAPER_REGIONS, Region
from blendcap.numerics.stretches import stretches
from hybrid_counts import hits
from hybrid_data import PEOPLE, UNITS, exercise, lessons
from hybrid_solves import BRIEF, FLAW_TEXT, GAINS_TEXT, LAYOUTS, RUNS, SOLVE_TEXT, failures, hybrid
from results import write_section

FAINT = 0.1  # AU45 of a lid that closes
SHUT = 0.3  # AU45 of a lid that is shut, or nearly
SQUEEZED = 0.45  # AU6 for AU45 from which on a shut lid is 6+43, if a take shows one kind only
APART = 1.4  # times as much AU6 for AU45: by so much the two kinds differ at least; closings of one kind do not
PARTS = ("solve", "layouts", "units", "flaws")
SOLVES = {"solve": ("The hybrid solve", RUNS), "layouts": ("The hybrid solve with other markers", LAYOUTS)}
NEAR = 0.25  # an intensity that errs by less is right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--faces", nargs="+", default=list(PEOPLE), choices=list(PEOPLE))
    parser.add_argument("--parts", nargs="+", default=list(PARTS), choices=PARTS)
    parser.add_argument("--brief", action="store_true")
    parser.add_argument("--draws", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    chosen = parser.parse_args()
    logging.getLogger("blendcap").setLevel(logging.ERROR)
    words = ["python benchmarks/hybrid.py --faces", *chosen.faces, "--parts", *chosen.parts]
    command = " ".join(words + ["--brief"] * chosen.brief + [f"--draws {chosen.draws}"] * (chosen.draws > 1))
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.cache or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        both = "units" in chosen.parts or ("solve" in chosen.parts and not chosen.brief)
        methods = ("intensity", "svm") if both else ("intensity",)
        trained = {kind: _trained(kind, folder, methods) for kind in chosen.faces}
        for part in chosen.parts:  # each is written as soon as it is done
            write_section(*_measured(part, trained, folder, chosen, command))


def _measured(
    part: str, trained: dict[str, dict], folder: Path, chosen: argparse.Namespace, command: str
) -> tuple[str, str, str]:
    """Title, command and text of a section."""
    rows, gains, brief = [], [], part == "solve" and chosen.brief
    for kind, machines in trained.items():
        if part in SOLVES:
            runs = BRIEF if brief else SOLVES[part][1]
            hybrid(kind, machines, folder, rows, gains, runs, chosen.draws, chosen.jobs)
        elif part == "units":
            kept = train_classifier(*lessons(kind, folder), relative=False)
            recognition(kind, machines | {"intensity, neutral kept": kept}, folder, rows, gains)
        else:
            failures(kind, machines, folder, rows)
    if part in SOLVES:
        title = SOLVES[part][0] + ", in brief" * brief
        return title, command, SOLVE_TEXT + "\n".join(rows) + GAINS_TEXT + "\n".join(gains)
    if part == "units":
        return "Action units from makeup patches", command, UNITS_TEXT + "\n".join(rows) + TAKEN_TEXT + "\n".join(gains)
    return "The hybrid solve when things go wrong", command, FLAW_TEXT + "\n".join(rows)


def _trained(kind: str, folder: Path, methods: Sequence[str]) -> dict[str, PatchClassifier]:
    """A machine of each method; the papers' learns from the papers' lesson, the first."""
    patches, shown = lessons(kind, folder)
    taught = {"intensity": (patches, shown), "svm": (patches[:1], shown[:1])}
    return {method: train_classifier(*taught[method], method=method) for method in methods}


UNITS_TEXT = """Four grey head cameras of 640x480, painted patches, 24 frames a second; trained on one performer
who shows the papers' units four times and others three times, tested on takes that share nothing with the lesson but
the performer, or not even that.
"brows" to "mouth": frames in which the unit is told right, region by region, of frames that are plainly at rest
(below 0.12) or not (above 0.3). Most frames are at rest: the first row of each take says what always answering so
gets, so judge a machine by what it gets above that, by recall, and by "worst".
"level": the worst region's part of frames in which the intensity is told within 0.25, too. "45" and "6+43": precision
and recall, and in brackets where a unit may be told two frames early or late. "worst": the correlation of told and true
intensity of the unit that is told worst, and which that is. "neutral kept": trained and used without taking the
features of the performer's own neutral frame off. "svm" is the papers' machine, "intensity" the default, whose 6+43 is
a 45 with much AU6 (closing by closing, told before the units' scales; the two kinds of a take are told apart by where
they part) and whose sideways pucker is the geometric mean of 10, 12 and 18; how much was set on the lessons, on other
takes of the teachers, and on mannequins 5 and 6 and ICT 104, who are not tested.

| face | take | method | laid over | brows | nose | eyes | mouth | level | 45 | 6+43 | worst | frames/s |
|---|---|---|---|---|---|---|---|---|---|---|---|---|
"""

TAKEN_TEXT = """

What the default takes for what ("intensity", laid over by region), in frames that are plainly at rest or plainly not:

| face | take | region | shown | told as |
|---|---|---|---|---|
"""


def recognition(
    kind: str, trained: dict[str, PatchClassifier], folder: Path, rows: list[str], taken: list[str]
) -> None:
    """Trained on the teacher, tested on everybody."""
    teacher, *others = PEOPLE[kind]
    for name, person in (("teacher, unseen take", teacher), *((f"person {p}", p) for p in others)):
        test, amounts = exercise(kind, person, folder)
        rows.append(f"| {kind} | {name} | always at rest | | {_recognized(np.zeros_like(amounts), amounts)} | |")
        for method, classifier in trained.items():
            for aligned in {"intensity": (None, True, False), "svm": (True, False)}.get(method, (None,)):
                start = time.process_time()
                bare, _, rate = _answers(_unscaled(classifier), [test.patches], aligned)
                scales = np.concatenate([model.scales for model in classifier.models])
                told = bare if method == "svm" else scaled(bare, scales)
                told, bare = (np.minimum(_smoothed(part, classifier, rate), 1) for part in (told, bare))
                speed = len(told) / (time.process_time() - start)
                said = _as_classes(*(dict(zip(classifier.units, part.T, strict=True)) for part in (told, bare)))
                over, cells = {None: "by region", True: "yes", False: "no"}[aligned], _recognized(said, amounts)
                rows.append(f"| {kind} | {name} | {method} | {over} | {cells} | {speed:.0f} |")
                print(rows[-1], flush=True)
                if method == "intensity" and aligned is None:
                    taken += [f"| {kind} | {name} | {row} |" for row in _taken(said, amounts)]


def _unscaled(classifier: PatchClassifier) -> PatchClassifier:
    """The machine without its gains and bends."""
    return replace(classifier, models=[replace(m, scales=np.ones_like(m.scales)) for m in classifier.models])


def _as_classes(told: dict[str, np.ndarray], bare: dict[str, np.ndarray]) -> np.ndarray:
    """(T, U) intensities of the papers' classes `UNITS`, of a machine that tells these or single units.

    The two kinds of closings differ in how much AU6 there is for AU45. That is read off what is told before the scales,
    whose bends would make a weak squeeze another one than a strong one.
    """
    if "AU1+2" in told:
        return np.stack([told[unit] for unit in UNITS], axis=1)
    halves, plain = _without_sides(told), _without_sides(bare)
    tight = squeezed(plain["AU6"], plain["AU45"])
    joint = {"AU1+2": (halves["AU1"] + halves["AU2"]) / 2}
    joint |= {"AU6+43": np.where(tight, halves["AU45"], 0), "AU45": np.where(tight, 0, halves["AU45"])}
    for side in "LR":  # the geometric mean: all of them or none
        joint[f"AU10+12+18+23{side}"] = np.cbrt(told[f"AU10{side}"] * told[f"AU12{side}"] * told["AU18"])
    return np.stack([(halves | joint)[unit] for unit in UNITS], axis=1)


def _without_sides(told: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Means of both sides."""
    whole = {name.rstrip("LR") for name in told}
    return {unit: np.mean([told[name] for name in told if name.rstrip("LR") == unit], axis=0) for unit in whole}


def squeezed(squint: np.ndarray, blink: np.ndarray) -> np.ndarray:
    """(T,) bool: where lids are squeezed shut, told closing by closing, from AU6 and AU45 (T,).

    Whoever squeezes the eyes shut does so from the first frame to the last, though AU6 shows late in it.
    """
    closings = [slice(first, last + 1) for first, last in stretches(blink > FAINT)]
    ratios = [float(squint[part].sum() / blink[part].sum()) for part in closings]
    limit = squeezed_from([r for r, part in zip(ratios, closings, strict=True) if blink[part].max() > SHUT])
    result = np.zeros(len(blink), dtype=bool)
    for ratio, part in zip(ratios, closings, strict=True):
        result[part] = ratio > limit
    return result


def squeezed_from(ratios: Sequence[float]) -> float:
    """AU6 for AU45 from which on a closing is 6+43: between the two kinds of closings of a take, if it has two.

    How much AU6 is told of a lid that only blinks differs from face to face; that squeezed ones show more does not.
    """
    if len(ratios) < 2:
        return SQUEEZED
    logs = np.sort(np.log(np.maximum(ratios, 0.01)))
    parts = [(logs[:k], logs[k:]) for k in range(1, len(logs))]
    low, high = min(parts, key=lambda part: sum(len(half) * half.var() for half in part))
    middles = float(np.median(low)), float(np.median(high))
    return float(np.exp(np.mean(middles))) if middles[1] - middles[0] > np.log(APART) else SQUEEZED


def _taken(said: np.ndarray, true: np.ndarray) -> list[str]:
    """Cells region, unit that is shown, and frames told as it and as others."""
    rows = []
    for region, ours, theirs in _clear(said, true):
        told, asked, names = recognized(ours), recognized(theirs), ("rest", *region.units)
        for k, name in enumerate(names, -1):
            counts = np.bincount(told[asked == k] + 1, minlength=len(names))
            order = sorted(np.flatnonzero(counts), key=lambda n: (n != k + 1, -counts[n]))
            rows.append(f"{region.name} | {name} | {', '.join(f'{names[n]} {counts[n]}' for n in order)}")
    return rows


def _clear(said: np.ndarray, true: np.ndarray) -> Iterator[tuple[Region, np.ndarray, np.ndarray]]:
    """Each region, and the intensities told and shown of its units, in its clear frames."""
    for region in PAPER_REGIONS:
        columns = [UNITS.index(unit) for unit in region.units]
        clear = is_clear(true[:, columns])
        yield region, said[clear][:, columns], true[clear][:, columns]


def _recognized(said: np.ndarray, true: np.ndarray) -> str:
    """Cells: right by region, right with intensity, precision and recall of AU45 and AU6+43, the worst correlation."""
    cells, level, shut = [], [], []
    for region, ours, theirs in _clear(said, true):
        told, asked = recognized(ours), recognized(theirs)
        cells.append(f"{(told == asked).mean():.3f}")
        level.append(((told == asked) & (np.abs(ours - theirs).max(1) < NEAR)).mean())
        if region.name == "eyes":
            shut = [hits(told == k, asked == k) for k in map(region.units.index, ("AU45", "AU6+43"))]
    pairs = zip(said.T, true.T, UNITS, strict=True)
    worst = min((np.corrcoef(ours, theirs)[0, 1] if ours.std() > 0 else 0.0, unit) for ours, theirs, unit in pairs)
    return " | ".join([*cells, f"{min(level):.3f}", *shut, f"{worst[0]:.2f} ({worst[1]})"])


if __name__ == "__main__":
    main()
