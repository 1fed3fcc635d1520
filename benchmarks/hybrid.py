"""Makeup patches: how well action units are told, and what they add to the marker solve.

    python benchmarks/hybrid.py [--cache FOLDER] [--faces mannequin ICT]

Films take most of the time; what was cut from them is kept in the cache folder.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from pathlib import Path

import numpy as np

import blendcap
from blendcap import Animation, SolveSettings
from blendcap.data.names import match
from blendcap.makeup.classifier import PatchClassifier
from blendcap.makeup.curves import _answers, classify
from blendcap.makeup.training import is_clear, recognized, train_classifier
from blendcap.synthetic.takes import choose_points, make_take
from hybrid_data import PEOPLE, UNITS, Filmed, exercise, played, table_for
from results import write_section

READ = ("brows", "glabella", "lids", "lips")  # the regions that the patches are about
CLOSED = 0.6  # of the lid's travel


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--faces", nargs="+", default=list(PEOPLE), choices=list(PEOPLE))
    chosen = parser.parse_args()
    logging.getLogger("blendcap").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.cache or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        units, solves, flaws = [], [], []
        for kind in chosen.faces:
            trained = recognition(kind, folder, units)
            hybrid(kind, trained, folder, solves)
            failures(kind, trained, folder, flaws)
    write_section("Action units from makeup patches", "python benchmarks/hybrid.py", UNITS_TEXT + "\n".join(units))
    write_section("The hybrid solve", "python benchmarks/hybrid.py", SOLVE_TEXT + "\n".join(solves))
    write_section("The hybrid solve when things go wrong", "python benchmarks/hybrid.py", FLAW_TEXT + "\n".join(flaws))


UNITS_TEXT = """Four grey head cameras of 640x480, painted patches, 24 frames a second; trained on one performer
who shows each unit four times, tested on takes that share nothing with the lesson but the performer, or not even that.
"brows" to "mouth": frames in which the unit is told right, region by region, of frames that are plainly at rest (below
0.12) or not (above 0.3). "worst": the correlation of told and true intensity of the unit that is told worst. "svm" is
the papers' machine, "intensity" the default.

| face | take | method | laid over | brows | nose | eyes | mouth | worst | frames/s |
|---|---|---|---|---|---|---|---|---|---|
"""
SOLVE_TEXT = """A real performance (alex_rom_3) played by performers who are not the rig; noise 0.2 mm, misplacement
1.5 mm, slip 2 mm and 2 degrees, 5 % occluded; places of the markers as a technician would give them. Vertex RMSE in mm
by region. The classifier was trained on the teacher, the first of each face. "closed": precision and recall of frames
in which a lid is closed.

| face | performer | markers | method | brows | glabella | lids | lips | elsewhere | closed | roughness |
|---|---|---|---|---|---|---|---|---|---|---|
"""
FLAW_TEXT = """The teacher's performance, 50 markers, spoilt; vertex RMSE of the whole face, mm.

| face | flaw | markers only | hybrid | ratio |
|---|---|---|---|---|
"""


def recognition(kind: str, folder: Path, rows: list[str]) -> dict[str, PatchClassifier]:
    """Train on the teacher, test on everybody; the classifiers by method."""
    teacher, *others = PEOPLE[kind]
    filmed, lesson, _ = exercise(kind, teacher, 4, 0, folder)
    trained = {method: train_classifier(filmed.patches, lesson, method=method) for method in ("svm", "intensity")}
    for name, person in (("teacher, unseen take", teacher), *((f"person {p}", p) for p in others)):
        test, _, amounts = exercise(kind, person, 2, 7, folder)
        for method, classifier in trained.items():
            for aligned in (True, False):
                start = time.process_time()
                told, _, _ = _answers(classifier, [test.patches], aligned)
                speed = len(told) / (time.process_time() - start)
                rows.append(_recognition_row(kind, name, method, aligned, classifier, told, amounts, speed))
                print(rows[-1], flush=True)
    return trained


def _recognition_row(kind, name, method, aligned, classifier, told, amounts, speed) -> str:
    cells, worst, column = [], 1.0, 0
    for model in classifier.models:
        true = amounts[:, [UNITS.index(unit) for unit in model.region.units]]
        said = told[:, column : column + len(model.region.units)]
        column += len(model.region.units)
        clear = is_clear(true)
        cells.append(f"{(recognized(true) == recognized(said))[clear].mean():.3f}")
        with np.errstate(invalid="ignore"):
            pairs = [np.corrcoef(a, b)[0, 1] for a, b in zip(true.T, said.T, strict=True)]
        worst = min(worst, *np.nan_to_num(pairs))
    regions, over = " | ".join(cells), "yes" if aligned else "no"
    return f"| {kind} | {name} | {method} | {over} | {regions} | {worst:.2f} | {speed:.0f} |"


def hybrid(kind: str, trained: dict[str, PatchClassifier], folder: Path, rows: list[str]) -> None:
    """Marker-only against hybrid, 50 markers; and hybrid with 30 against marker-only with 100."""
    for person in PEOPLE[kind]:
        scene = played(kind, person, folder)
        curves = {method: told(scene, classifier) for method, classifier in trained.items()}
        sets = {count: _markers(kind, person, scene, count) for count in (30, 100)}
        for markers, method, given in (
            (50, "paper", None), (50, "paper", "svm"), (50, "learned", None), (50, "learned", "svm"),
            (50, "learned", "intensity"), (30, "learned", "intensity"), (100, "learned", None),
        ):  # fmt: skip
            take, truth, binding = (scene.take, scene.truth, scene.binding) if markers == 50 else sets[markers]
            solution = blendcap.solve(
                scene.rig, take, binding, patches=curves.get(given), settings=SolveSettings(method=method, head="keep")
            )
            label = f"{method}, markers only" if given is None else f"{method}, hybrid, {given}"
            rows.append(_solve_row(kind, person, markers, label, scene, truth, solution.animation))
            print(rows[-1], flush=True)


def told(scene: Filmed, classifier: PatchClassifier) -> Animation:
    return classify(classifier, scene.patches, table=table_for(scene.rig))


def _markers(kind: str, person: int, scene: Filmed, count: int):
    """The same performance with another number of markers."""
    points = choose_points(scene.rig, count, seed=person)
    acted = scene.truth.animation
    take, truth = make_take(scene.truth.performer, acted, points, seed=700 + person, neutral_frames=0)
    return take, truth, blendcap.bind(scene.rig, take, points)


def _solve_row(kind, person, markers, label, scene: Filmed, truth, answer: Animation) -> str:
    true = truth.performer.act(truth.animation)
    judged = blendcap.evaluate(answer, true, scene.rig, truth_rig=truth.performer.rig)
    regions = judged.by_region_mm
    others = [error for name, error in regions.items() if name not in READ and name not in ("eyes", "teeth", "tongue")]
    cells = [f"{regions[name]:.2f}" if name in regions else "" for name in READ]
    precision, recall = _closed(answer, truth.animation)
    return (
        f"| {kind} | {person} | {markers} | {label} | {' | '.join(cells)} | {np.mean(others):.2f} | "
        f"{precision:.2f}, {recall:.2f} | {judged.roughness_ratio:.2f} |"
    )


def _closed(answer: Animation, truth: Animation) -> tuple[float, float]:
    """Precision and recall of frames in which a lid is closed, both sides together."""
    sides = [name for names in match(("eyeBlinkLeft", "eyeBlinkRight"), truth.names).values() for name in names]
    said, true = (animation.select(sides).weights > CLOSED for animation in (answer, truth))
    hits = (said & true).sum()
    return float(hits / max(said.sum(), 1)), float(hits / max(true.sum(), 1))


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
        curves = told(scene, trained["intensity"])
        errors = []
        for patches in (None, curves):
            settings = SolveSettings(head="keep")
            answer = blendcap.solve(scene.rig, scene.take, scene.binding, patches=patches, settings=settings).animation
            performer = scene.truth.performer
            true = performer.act(scene.truth.animation)
            errors.append(blendcap.evaluate(answer, true, scene.rig, truth_rig=performer.rig).vertex_rmse_mm)
        rows.append(f"| {kind} | {flaw} | {errors[0]:.3f} | {errors[1]:.3f} | {errors[1] / errors[0]:.2f} |")
        print(rows[-1], flush=True)


def _smeared(view: int, number: int, picture: np.ndarray) -> np.ndarray:
    import cv2

    if number < 120:
        return picture
    soft = picture.copy()
    soft[: picture.shape[0] // 2] = cv2.GaussianBlur(picture, (0, 0), 9.0)[: picture.shape[0] // 2]
    return soft if view == 0 else picture


def _black(view: int, number: int, picture: np.ndarray) -> np.ndarray:
    return np.zeros_like(picture) if view == 0 and 120 <= number < 180 else picture


def _dim(view: int, number: int, picture: np.ndarray) -> np.ndarray:
    return picture // 2 if number > 200 else picture


if __name__ == "__main__":
    main()
