"""What makeup patches add to the marker solve, on films as they are and on spoilt ones, for `hybrid.py`."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

import blendcap
from blendcap import Animation, Binding, MarkerTake, PaintTracks, Rig, SolveSettings
from blendcap.data.anatomy import is_skin
from blendcap.makeup.classifier import PatchClassifier
from blendcap.makeup.curves import classify
from blendcap.synthetic.takes import Truth
from hybrid_counts import blinks, gaps, roughness, shut
from hybrid_data import PEOPLE, Filmed, extremes, played, table_for, worn

READ = ("brows", "glabella", "lids", "lips")  # the regions that the patches are about
MARKERS = {"50": (50, True), "30": (30, True), "100": (100, True), "50, lids too": (50, False)}
DOT = 6.0  # mm from the middle of a marker's dot to the middle of a window that shows none of it, at least
WAYS = {  # name: whose curves, whether the paint is followed, and whether the rig is refined by the take
    "markers only": ("", False, False),
    "markers only, rig refined": ("", False, True),
    "curves": ("intensity", False, False),
    "tracks": ("", True, False),
    "curves and tracks": ("intensity", True, False),
    "tracks, rig refined": ("", True, True),
    "curves and tracks, rig refined": ("intensity", True, True),
    "curves of the SVM": ("svm", False, False),
    "true curves": ("truth", False, False),
    "true curves of all shapes": ("truth, all shapes", False, False),
}
WHOLE = "curves and tracks, rig refined"  # all that there is
AGAIN = ("markers only", "curves", "tracks", "curves and tracks", "tracks, rig refined", WHOLE)  # of further draws
FLAWED = ("markers only", "curves", "tracks", "curves and tracks", WHOLE)
UNSOLVED = (("", "true weights", "unsolved"), ("", "best weights", "unsolved"))
BRIEF = (*(("50", "learned", way) for way in WAYS if way != "curves of the SVM"), *UNSOLVED)
RUNS = (
    *BRIEF,
    ("50", "learned", "curves of the SVM"),
    *(("50", "paper", way) for way in ("markers only", "curves of the SVM", "curves", "true curves")),
)
LAYOUTS = tuple(
    (layout, "learned", way) for layout in list(MARKERS)[1:] for way in ("markers only", "curves and tracks", WHOLE)
)
PAIRS = (
    ("curves (the papers' idea)", ("50", "learned", "curves"), ("50", "learned", "markers only")),
    ("tracks (no lesson)", ("50", "learned", "tracks"), ("50", "learned", "markers only")),
    ("curves and tracks", ("50", "learned", "curves and tracks"), ("50", "learned", "markers only")),
    ("markers alone, rig refined by them", ("50", "learned", "markers only, rig refined"),
     ("50", "learned", "markers only")),
    ("tracks, rig refined by them", ("50", "learned", "tracks, rig refined"), ("50", "learned", "markers only")),
    ("all: curves, tracks, rig refined by them", ("50", "learned", WHOLE), ("50", "learned", "markers only")),
    ("all, against markers alone on a rig refined by them", ("50", "learned", WHOLE),
     ("50", "learned", "markers only, rig refined")),
    ("true weights as curves", ("50", "learned", "true curves"), ("50", "learned", "markers only")),
    ("true weights of all shapes as curves", ("50", "learned", "true curves of all shapes"),
     ("50", "learned", "markers only")),
    ("best weights, unsolved", ("", "best weights", "unsolved"), ("50", "learned", "markers only")),
    ("the papers' solve and machine", ("50", "paper", "curves of the SVM"), ("50", "paper", "markers only")),
    ("the papers' solve, default machine", ("50", "paper", "curves"), ("50", "paper", "markers only")),
    ("the papers' solve, true weights as curves", ("50", "paper", "true curves"), ("50", "paper", "markers only")),
    ("the papers' machine", ("50", "learned", "curves of the SVM"), ("50", "learned", "markers only")),
    ("all, 30 markers", ("30", "learned", WHOLE), ("30", "learned", "markers only")),
    ("all, 100 markers", ("100", "learned", WHOLE), ("100", "learned", "markers only")),
    ("curves and tracks with 30 against 100 markers alone", ("30", "learned", "curves and tracks"),
     ("100", "learned", "markers only")),
    ("all with 30 against 100 markers alone", ("30", "learned", WHOLE), ("100", "learned", "markers only")),
    ("all, markers on the lids too", ("50, lids too", "learned", WHOLE), ("50, lids too", "learned", "markers only")),
)  # fmt: skip

SOLVE_TEXT = """A real performance (alex_rom_3) played by performers who are not the rig; "extremes": the thesis' two,
puckered lips that swing from side to side, and a frown; noise 0.2 mm, misplacement 1.5 mm, slip 2 mm and 2 degrees,
5 % occluded; places of the markers as a technician would give them. Markers lie on skin that bears no paint and is no
lid; "lids too": anywhere on the skin. The solver's rig has the template's shapes, transferred to a neutral that errs
by 0.5 mm; its answers are judged on the performer's own neutral.
"curves": the papers' idea, a classifier reads from the patches which action units they show. It was trained on the
teacher, the first of each face; in the lessons, and only there, markers lie on lids and paint too: their solve gives
the intensities to learn. "tracks": no lesson; the paint, and all else on the skin that has contrast, is followed
through the film from where the markers' own solve puts it, and a second solve takes the tracks as rows. "curves and
tracks": the first solve has the curves, the second both. "rig refined": then the shapes learn from the same take what
no weights explain (`refine_from_take`), and the answer is of the refined rig. The film shows the dots of the layout
"50", which are followed like all else; for other layouts tracks near these dots are left out.
Vertex RMSE in mm by region.
"closed": precision and recall of frames in which a lid's gap is below 35 % of the way from the rig's own blink to rest,
counted where the true gap is plainly below (25 %) or above (45 %), and in brackets everywhere; the gap is measured
along the blink's way, pair by pair, and lids that pass each other have met. "blinks": the same by closings, from the
first such frame to the last, each eye its own, and how many there are; one that is told stands for one, two frames
early or late at most. "true curves": the performer's own weights in place of the curves, of the shapes that the curves
tell: no classifier can tell these weights better; no tracks. "true curves of all shapes": of every shape, of which no
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

What the patches change: vertex RMSE of the hybrid solve against the markers alone, the mean over films; each performer
is filmed once or more often, each time with another draw of paint, markers, noise and helmet. In brackets the least and
the most of a film. The bar is -35 % in brows, glabella, lids and lips and +3 % elsewhere; "true weights as curves" is
what a classifier reaches that tells the weights as the performer acts them; "best weights" is what is there to be had.

| face | take | | films | brows | glabella | lids | lips | elsewhere |
|---|---|---|---|---|---|---|---|---|
"""
FLAW_TEXT = """The teacher's performance, 50 markers, spoilt; vertex RMSE of the whole face, mm, and the ratio of the
last, all that there is, to markers only. The bar is 1.05.

| face | flaw | markers only | curves | tracks | curves and tracks | rig refined, too | ratio |
|---|---|---|---|---|---|---|---|
"""


class Judged(NamedTuple):
    """A way to solve one film: which, its errors by region in mm, and its row of the table."""

    run: tuple[str, str, str]
    errors: list[float]
    row: str


def hybrid(
    kind: str, trained: dict[str, PatchClassifier], folder: Path, rows: list[str], gains: list[str],
    chosen: Sequence[tuple[str, str, str]], draws: int, jobs: int,
) -> None:  # fmt: skip
    """Marker-only against hybrid on the same markers; and hybrid with 30 against marker-only with 100."""
    takes = (("performance", chosen, draws), ("extremes", BRIEF, 1))
    for title, runs, count in takes if chosen is RUNS else takes[:1]:
        films = [(person, draw) for person in PEOPLE[kind] for draw in range(count)]
        errors: dict[tuple, dict] = defaultdict(dict)
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            each = partial(_each_judged, kind, trained, folder, title, runs)
            for film, judged in zip(films, pool.map(each, *zip(*films, strict=True)), strict=True):
                for run, numbers, row in judged:
                    errors[run][film] = numbers
                    rows.append(row)
        gains += _gains(kind, title, errors)


def _each_judged(
    kind: str, trained: dict[str, PatchClassifier], folder: Path, title: str, runs: Sequence[tuple[str, str, str]],
    person: int, draw: int,
) -> list[Judged]:  # fmt: skip
    """The ways to solve a film, one after the other; of a first draw all, of further ones what the gains need."""
    logging.getLogger("blendcap").setLevel(logging.ERROR)
    filmed = played(kind, person, folder, draw=draw) if title == "performance" else extremes(kind, person, folder)
    curves = {"": None} | {method: curves_of(filmed, machine) for method, machine in trained.items()}
    curves["truth"] = _truth(filmed, curves["intensity"].names)
    curves["truth, all shapes"] = _truth(filmed, filmed.truth.animation.names)
    kept: dict[tuple[str, str], PaintTracks] = {}
    judged = []
    for run in runs:
        if draw == 0 or run[2] in AGAIN:
            cells, numbers = _judged(filmed, *_answered(filmed, run, curves, kept))
            layout, method, way = run
            row = f"| {kind} | {person}, {title}, draw {draw + 1} | {layout} | {method}, {way} | {cells} |"
            judged.append(Judged(run, numbers, row))
            print(row, flush=True)
    return judged


def _answered(
    filmed: Filmed, run: tuple[str, str, str], curves: dict[str, Animation | None], kept: dict
) -> tuple[Truth, Rig, Animation]:
    """The truth of a run's markers, the rig, and the weights that it gives; tracks are `kept` for other ways."""
    if run in UNSOLVED:
        return filmed.truth, filmed.rig, _best(filmed) if run[1] == "best weights" else filmed.truth.animation
    layout, method, way = run
    take, truth, binding = worn(filmed, *MARKERS[layout])
    return truth, *solved(filmed, take, binding, curves, way, method, kept if take is filmed.take else {})


def _gains(kind: str, title: str, errors: Mapping[tuple, Mapping[tuple, list[float]]]) -> list[str]:
    """Rows of what one way changes against another, of those that were run: {run: {film: errors by region}}."""
    rows = []
    for label, ours, theirs in PAIRS:
        if ours in errors:
            both = [film for film in errors[ours] if film in errors[theirs]]
            change = np.array([np.divide(errors[ours][film], errors[theirs][film]) - 1 for film in both])
            cells = [f"{c.mean():+.0%} ({c.min():+.0%} to {c.max():+.0%})" for c in change.T]
            rows.append(f"| {kind} | {title} | {label} | {len(both)} | {' | '.join(cells)} |")
            print(rows[-1], flush=True)
    return rows


def solved(
    filmed: Filmed, take: MarkerTake, binding: Binding, curves: dict[str, Animation | None], way: str,
    method: str, kept: dict,
) -> tuple[Rig, Animation]:  # fmt: skip
    """Rig and weights by markers, by curves if the way has them, and by paint that is followed from where a solve
    without puts it."""
    whose, followed, refined = WAYS[way]
    known: dict[str, Any] = {"patches": curves[whose], "settings": SolveSettings(method=method, head="keep")}
    answer = blendcap.solve(filmed.rig, take, binding, **known)
    if followed:
        if (whose, method) not in kept:
            tracks = blendcap.track_paint(filmed.videos(), filmed.rig, take, binding, filmed.cameras, answer)
            kept[whose, method] = tracks if take is filmed.take else _without_dots(tracks, filmed)
        known["tracks"] = kept[whose, method]
    if refined:
        personal = blendcap.refine_from_take(filmed.rig, take, binding, **known)
        return personal.rig, personal.solution.animation
    return filmed.rig, (blendcap.solve(filmed.rig, take, binding, **known) if followed else answer).animation


def _without_dots(tracks: PaintTracks, filmed: Filmed) -> PaintTracks:
    """The tracks whose windows show no marker's dot: the film shows those of another layout."""
    dots = filmed.truth.positions[0]
    apart = np.linalg.norm(tracks.rest[:, None] - dots, axis=2).min(1)
    kept = np.flatnonzero(apart > DOT)
    points = tracks.points.select([tracks.points.names[k] for k in kept])
    parts = {name: getattr(tracks, name)[kept] for name in ("cameras", "rest", "axes")}
    return replace(tracks, points=points, positions=tracks.positions[:, kept], **parts)


def curves_of(filmed: Filmed, classifier: PatchClassifier) -> Animation:
    return classify(classifier, filmed.patches, table=table_for(filmed.rig))


def _truth(filmed: Filmed, names: Sequence[str]) -> Animation:
    """The curves as they should have been, fully trusted."""
    true = filmed.truth.animation.select(names)
    return replace(true, confidence=np.ones_like(true.weights))


def _best(filmed: Filmed) -> Animation:
    """The solver's weights that come closest to the true skin, which nobody knows: the floor of every solve."""
    truth, rig = filmed.truth, filmed.judge(filmed.rig)
    acted = truth.performer.act(truth.animation)
    skin = np.unique(np.concatenate([v for name, v in rig.regions.items() if is_skin(name)]))
    shapes = rig.deltas[:, skin].reshape(len(rig.names), -1).astype(np.float64)
    own = truth.performer.rig.deltas[:, skin].reshape(-1, shapes.shape[1]).astype(np.float64)
    weights, _ = blendcap.solve_box(shapes @ shapes.T, -acted.weights @ (own @ shapes.T))
    return Animation(weights, rig.names, acted.rate)


def _judged(filmed: Filmed, truth: Truth, rig: Rig, answer: Animation) -> tuple[str, list[float]]:
    """Cells of a row, and the errors of the regions that the patches are about and of all others, mm."""
    true = truth.performer.act(truth.animation)
    judge = filmed.judge(rig)
    judged = blendcap.evaluate(answer, true, judge, truth_rig=truth.performer.rig)
    regions = judged.by_region_mm
    others = [error for name, error in regions.items() if is_skin(name) and name not in (*READ, "upper", "lower")]
    numbers = [regions[name] for name in READ] + [float(np.mean(others))]
    said, asked = gaps(judge, answer), gaps(truth.performer.rig, true)
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
        curves, performer = {"": None, "intensity": curves_of(scene, trained["intensity"])}, scene.truth.performer
        true, errors, kept = performer.act(scene.truth.animation), [], {}
        for way in FLAWED:
            rig, answer = solved(scene, scene.take, scene.binding, curves, way, "learned", kept)
            errors.append(blendcap.evaluate(answer, true, scene.judge(rig), truth_rig=performer.rig).vertex_rmse_mm)
        cells = " | ".join(f"{error:.3f}" for error in errors)
        rows.append(f"| {kind} | {flaw} | {cells} | {errors[-1] / errors[0]:.2f} |")
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
