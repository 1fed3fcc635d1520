"""Makeup patches: how well action units are told, and what they add to the marker solve.

    python benchmarks/hybrid.py [--cache FOLDER] [--faces mannequin ICT] [--parts solve units flaws] [--brief]

Films take most of the time; what was cut from them is kept in the cache folder. `--brief` leaves out of the solves all
but the default and true weights in place of its curves.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import blendcap
from blendcap import Animation, SolveSettings
from blendcap.data.anatomy import is_skin
from blendcap.makeup.classifier import PatchClassifier
from blendcap.makeup.curves import _answers, _smoothed, classify
from blendcap.makeup.training import is_clear, recognized, train_classifier
from blendcap.makeup.units import PAPER_REGIONS
from hybrid_counts import blinks, gaps, hits, roughness, shut
from hybrid_data import PEOPLE, UNITS, Filmed, exercise, extremes, lessons, played, table_for, worn
from results import write_section

READ = ("brows", "glabella", "lids", "lips")  # the regions that the patches are about
SQUEEZED = 0.45  # AU6 for AU45 from which on a shut lid is 6+43; lessons have up to 0.22 with 45, from 0.57 with 6+43
PARTS = ("solve", "units", "flaws")
NEAR = 0.25  # an intensity that errs by less is right
MARKERS = {"50": (50, True), "30": (30, True), "100": (100, True), "50, lids too": (50, False)}
MORE_RUNS = (
    ("50", "paper", None), ("50", "paper", "svm"), ("50", "paper", "intensity"), ("50", "paper", "truth"),
    ("50", "learned", "svm"), ("30", "learned", "intensity"), ("100", "learned", None),
    ("50, lids too", "learned", None), ("50, lids too", "learned", "intensity"),
)  # fmt: skip
BRIEF = tuple(("50", "learned", given) for given in (None, "intensity", "truth", "truth, all shapes"))
RUNS = (*BRIEF, *MORE_RUNS)
PAIRS = (
    ("the papers' solve and machine", ("50", "paper", "svm"), ("50", "paper", None)),
    ("the papers' solve, default machine", ("50", "paper", "intensity"), ("50", "paper", None)),
    ("the papers' solve, true weights as curves", ("50", "paper", "truth"), ("50", "paper", None)),
    ("default", ("50", "learned", "intensity"), ("50", "learned", None)),
    ("true weights as curves", ("50", "learned", "truth"), ("50", "learned", None)),
    ("true weights of all shapes", ("50", "learned", "truth, all shapes"), ("50", "learned", None)),
    ("best weights, unsolved", ("", "best", None), ("50", "learned", None)),
    ("default with 30 against 100 markers alone", ("30", "learned", "intensity"), ("100", "learned", None)),
    ("default, markers on the lids too", ("50, lids too", "learned", "intensity"), ("50, lids too", "learned", None)),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--faces", nargs="+", default=list(PEOPLE), choices=list(PEOPLE))
    parser.add_argument("--parts", nargs="+", default=list(PARTS), choices=PARTS)
    parser.add_argument("--brief", action="store_true")
    chosen = parser.parse_args()
    logging.getLogger("blendcap").setLevel(logging.ERROR)
    words = ["python benchmarks/hybrid.py --faces", *chosen.faces, "--parts", *chosen.parts]
    command = " ".join(words + ["--brief"] * chosen.brief)
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.cache or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        methods = ("intensity",) if chosen.brief else ("intensity", "svm")
        trained = {kind: _trained(kind, folder, methods) for kind in chosen.faces}
        for part in chosen.parts:  # each is written as soon as it is done
            write_section(*_measured(part, trained, folder, chosen.brief, command))


def _measured(part: str, trained: dict[str, dict], folder: Path, brief: bool, command: str) -> tuple[str, str, str]:
    """Title, command and text of a section."""
    rows, gains = [], []
    for kind, machines in trained.items():
        if part == "solve":
            hybrid(kind, machines, folder, rows, gains, BRIEF if brief else RUNS)
        elif part == "units":
            recognition(kind, machines, folder, rows)
        else:
            failures(kind, machines, folder, rows)
    if part == "solve":
        title = "The hybrid solve" + ", in brief" * brief
        return title, command, SOLVE_TEXT + "\n".join(rows) + GAINS_TEXT + "\n".join(gains)
    title, text = {"units": ("Action units from makeup patches", UNITS_TEXT),
                   "flaws": ("The hybrid solve when things go wrong", FLAW_TEXT)}[part]  # fmt: skip
    return title, command, text + "\n".join(rows)


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
and recall, and in brackets where a unit may be told two frames early or late. "worst": the correlation of told and
true intensity of the unit that is told worst. "svm" is the papers' machine, "intensity" the default, whose 6+43 is a 45
with much AU6 and whose sideways pucker is the geometric mean of 10, 12 and 18; how much was set on the lessons, and on
mannequin 5 and ICT 104, who are not tested.

| face | take | method | laid over | brows | nose | eyes | mouth | level | 45 | 6+43 | worst | frames/s |
|---|---|---|---|---|---|---|---|---|---|---|---|---|
"""
SOLVE_TEXT = """A real performance (alex_rom_3) played by performers who are not the rig, and the thesis' two extremes,
puckered lips that swing from side to side and a frown; noise 0.2 mm, misplacement 1.5 mm, slip 2 mm and 2 degrees,
5 % occluded; places of the markers as a technician would give them. Markers lie on skin that bears no paint and is no
lid; "lids too": anywhere on the skin. The solver's rig has the template's shapes, transferred to a neutral that errs
by 0.5 mm; its answers are judged on the performer's own neutral.
In the lessons, and only there, markers lie on lids and paint too: their solve gives the intensities to learn.
Vertex RMSE in mm by region. The classifier was trained on the teacher, the first of each face.
"closed": precision and recall of frames in which a lid's gap is below 35 % of the way from the rig's own blink to rest,
counted where the true gap is plainly below (25 %) or above (45 %), and in brackets everywhere. "blinks": the same by
closings, from the first such frame to the last, each eye its own, and how many there are; one that is told stands
for one, two frames early or late at most. "truth": the performer's own weights in place of the curves, of the shapes
that the curves tell: no classifier can tell these weights better. "truth, all shapes": of every shape, of which no
classifier knows more than a part. "true weights, unsolved": the performer's weights on the solver's shapes: what is
left is the performer's own way. None of the three is a floor of the error: a performer whose shapes differ from the
solver's is met better by other weights than the true ones. The floor is "best weights, unsolved", fitted to the true
skin.
"roughness": mean squared second difference of the answer to that of the truth, of all shapes but those of the eyes,
which lie still where nothing sees them, and of all.

| face | performer | markers | method | brows | glabella | lids | lips | elsewhere | closed | blinks | roughness |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""
GAINS_TEXT = """

What the patches change: vertex RMSE of the hybrid solve against the markers alone, the mean over performers. The bar is
-35% in brows, glabella, lids and lips and +3% elsewhere; "true weights as curves" is what a classifier reaches that
tells the weights as the performer acts them; "best weights" is what is there to be had.

| face | take | | brows | glabella | lids | lips | elsewhere |
|---|---|---|---|---|---|---|---|
"""
FLAW_TEXT = """The teacher's performance, 50 markers, spoilt; vertex RMSE of the whole face, mm.

| face | flaw | markers only | hybrid | ratio |
|---|---|---|---|---|
"""


def recognition(kind: str, trained: dict[str, PatchClassifier], folder: Path, rows: list[str]) -> None:
    """Trained on the teacher, tested on everybody."""
    teacher, *others = PEOPLE[kind]
    for name, person in (("teacher, unseen take", teacher), *((f"person {p}", p) for p in others)):
        test, amounts = exercise(kind, person, folder)
        rows.append(f"| {kind} | {name} | always at rest | | {_recognized(np.zeros_like(amounts), amounts)} | |")
        for method, classifier in trained.items():
            for aligned in (None, True, False) if method == "intensity" else (True, False):
                start = time.process_time()
                told, _, rate = _answers(classifier, [test.patches], aligned)
                told = _smoothed(told, classifier, rate)
                speed = len(told) / (time.process_time() - start)
                said = _as_classes(dict(zip(classifier.units, told.T, strict=True)))
                over, cells = {None: "by region", True: "yes", False: "no"}[aligned], _recognized(said, amounts)
                rows.append(f"| {kind} | {name} | {method} | {over} | {cells} | {speed:.0f} |")
                print(rows[-1], flush=True)


def _as_classes(told: dict[str, np.ndarray]) -> np.ndarray:
    """(T, U) intensities of the papers' classes `UNITS`, of a machine that tells these or single units."""
    if "AU1+2" in told:
        return np.stack([told[unit] for unit in UNITS], axis=1)
    halves = {unit: np.mean([told[name] for name in told if name.rstrip("LR") == unit], axis=0)
              for unit in {name.rstrip("LR") for name in told}}  # fmt: skip
    squeezed = halves["AU6"] > SQUEEZED * halves["AU45"]
    joint = {"AU1+2": (halves["AU1"] + halves["AU2"]) / 2}
    joint |= {"AU6+43": np.where(squeezed, halves["AU45"], 0), "AU45": np.where(squeezed, 0, halves["AU45"])}
    for side in "LR":  # the geometric mean: all of them or none
        joint[f"AU10+12+18+23{side}"] = np.cbrt(told[f"AU10{side}"] * told[f"AU12{side}"] * told["AU18"])
    return np.stack([(halves | joint)[unit] for unit in UNITS], axis=1)


def _recognized(said: np.ndarray, true: np.ndarray) -> str:
    """Cells: right by region, right with intensity, precision and recall of AU45 and AU6+43, the worst correlation."""
    cells, level, shut = [], [], []
    for region in PAPER_REGIONS:
        columns = [UNITS.index(unit) for unit in region.units]
        clear = is_clear(true[:, columns])
        ours, theirs = said[clear][:, columns], true[clear][:, columns]
        told, asked = recognized(ours), recognized(theirs)
        cells.append(f"{(told == asked).mean():.3f}")
        level.append(((told == asked) & (np.abs(ours - theirs).max(1) < NEAR)).mean())
        if region.name == "eyes":
            shut = [hits(told == k, asked == k) for k in map(region.units.index, ("AU45", "AU6+43"))]
    pairs = zip(said.T, true.T, strict=True)
    worst = min(np.corrcoef(ours, theirs)[0, 1] if ours.std() > 0 else 0.0 for ours, theirs in pairs)
    return " | ".join([*cells, f"{min(level):.3f}", *shut, f"{worst:.2f}"])


def hybrid(
    kind: str, trained: dict[str, PatchClassifier], folder: Path, rows: list[str], gains: list[str], chosen
) -> None:  # fmt: skip
    """Marker-only against hybrid on the same markers; and hybrid with 30 against marker-only with 100."""
    films = (("performance", played, chosen), ("extremes", extremes, BRIEF))
    for title, film, runs in films[:1] if chosen is BRIEF else films:
        errors: dict[tuple, list] = defaultdict(list)
        for person in PEOPLE[kind]:
            filmed = film(kind, person, folder)
            curves = {method: curves_of(filmed, classifier) for method, classifier in trained.items()}
            curves["truth"] = _truth(filmed, curves["intensity"].names)
            curves["truth, all shapes"] = _truth(filmed, filmed.truth.animation.names)
            for run in runs:
                layout, method, given = run
                take, truth, binding = worn(filmed, *MARKERS[layout])
                settings = SolveSettings(method=method, head="keep")
                answer = blendcap.solve(filmed.rig, take, binding, patches=curves.get(given or ""), settings=settings)
                cells, numbers = _judged(filmed, truth, answer.animation)
                errors[run].append(numbers)
                way = f"{method}, " + ("markers only" if given is None else f"hybrid, {given}")
                rows.append(f"| {kind} | {person}, {title} | {layout} | {way} | {cells} |")
                print(rows[-1], flush=True)
            for way, weights in (("true", filmed.truth.animation), ("best", _best(filmed))):
                cells, numbers = _judged(filmed, filmed.truth, weights)
                errors["", way, None].append(numbers)
                rows.append(f"| {kind} | {person}, {title} | | {way} weights, unsolved | {cells} |")
        for label, ours, theirs in PAIRS:
            if ours in errors:
                change = np.mean(np.divide(errors[ours], errors[theirs]), axis=0) - 1
                gains.append(f"| {kind} | {title} | {label} | " + " | ".join(f"{c:+.0%}" for c in change) + " |")
                print(gains[-1], flush=True)


def curves_of(filmed: Filmed, classifier: PatchClassifier) -> Animation:
    return classify(classifier, filmed.patches, table=table_for(filmed.rig))


def _truth(filmed: Filmed, names: Sequence[str]) -> Animation:
    """The curves as they should have been, fully trusted."""
    true = filmed.truth.animation.select(names)
    return replace(true, confidence=np.ones_like(true.weights))


def _best(filmed: Filmed) -> Animation:
    """The solver's weights that come closest to the true skin, which nobody knows: the floor of every solve."""
    truth, rig = filmed.truth, filmed.judge
    acted = truth.performer.act(truth.animation)
    skin = np.unique(np.concatenate([v for name, v in rig.regions.items() if is_skin(name)]))
    shapes = rig.deltas[:, skin].reshape(len(rig.names), -1).astype(np.float64)
    own = truth.performer.rig.deltas[:, skin].reshape(-1, shapes.shape[1]).astype(np.float64)
    weights, _ = blendcap.solve_box(shapes @ shapes.T, -acted.weights @ (own @ shapes.T))
    return Animation(weights, rig.names, acted.rate)


def _judged(filmed: Filmed, truth, answer: Animation) -> tuple[str, list[float]]:
    """Cells of a row, and the errors of the regions that the patches are about and of all others, mm."""
    true = truth.performer.act(truth.animation)
    judged = blendcap.evaluate(answer, true, filmed.judge, truth_rig=truth.performer.rig)
    regions = judged.by_region_mm
    others = [error for name, error in regions.items() if is_skin(name) and name not in (*READ, "upper", "lower")]
    numbers = [regions[name] for name in READ] + [float(np.mean(others))]
    said, asked = gaps(filmed.judge, answer), gaps(truth.performer.rig, true)
    still = [name for name in answer.names if not name.startswith("eye")]
    rough = roughness(answer.select(still)) / roughness(truth.animation.select(still))
    cells = [*(f"{n:.2f}" for n in numbers), shut(said, asked), blinks(said, asked)]
    return " | ".join([*cells, f"{rough:.2f}, {judged.roughness_ratio:.2f}"]), numbers


def failures(kind: str, trained: dict[str, PatchClassifier], folder: Path, rows: list[str]) -> None:
    """Spoilt films: the hybrid must never be much worse than the markers alone."""
    teacher = PEOPLE[kind][0]
    for flaw, spoil, bump in (
        ("none", None, 0.0),
        ("paint smeared over the right eye and brow", _smeared, 0.0),
        ("camera 0 black for 2 s", _black, 0.0),
        ("brightness halved from the middle on", _dim, 0.0),
        ("helmet bumped by 5 mm", None, 5.0),
    ):
        label = "" if flaw == "none" else "-" + flaw.split()[0]
        scene = played(kind, teacher, folder, spoil, label, bump)
        curves = curves_of(scene, trained["intensity"])
        errors = []
        for patches in (None, curves):
            settings = SolveSettings(head="keep")
            answer = blendcap.solve(scene.rig, scene.take, scene.binding, patches=patches, settings=settings).animation
            performer = scene.truth.performer
            true = performer.act(scene.truth.animation)
            errors.append(blendcap.evaluate(answer, true, scene.judge, truth_rig=performer.rig).vertex_rmse_mm)
        rows.append(f"| {kind} | {flaw} | {errors[0]:.3f} | {errors[1]:.3f} | {errors[1] / errors[0]:.2f} |")
        print(rows[-1], flush=True)


def _smeared(view: int, number: int, picture: np.ndarray) -> np.ndarray:
    if view != 0 or number < 120:
        return picture
    soft = picture.copy()
    soft[: picture.shape[0] // 2] = cv2.GaussianBlur(picture, (0, 0), 9.0)[: picture.shape[0] // 2]
    return soft


def _black(view: int, number: int, picture: np.ndarray) -> np.ndarray:
    return np.zeros_like(picture) if view == 0 and 120 <= number < 180 else picture


def _dim(view: int, number: int, picture: np.ndarray) -> np.ndarray:
    return picture // 2 if number > 200 else picture


if __name__ == "__main__":
    main()
