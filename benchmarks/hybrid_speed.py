"""How fast makeup patches become curves and paint is followed, how long a machine is taught, and what memory it takes.

    python benchmarks/hybrid_speed.py [--cache FOLDER]

The lessons of `hybrid.py` are filmed if they are not in the cache folder.
"""

from __future__ import annotations

import argparse
import itertools
import logging
import resource
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import blendcap
from blendcap import Animation, Binding, Camera, MarkerTake, Rig, SolveSettings
from blendcap.makeup.classifier import PatchClassifier
from blendcap.makeup.curves import classify
from blendcap.makeup.lesson import Lesson
from blendcap.makeup.patches import Patches, each_block
from blendcap.makeup.setup import Setup, locate
from blendcap.makeup.training import train_classifier
from blendcap.synthetic.exercises import action_units
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import make_take
from hybrid_data import RATE, between, face, given, lessons
from results import write_section

PERSON, MARKERS, ROUNDS = 5, 50, 3
FILMED = 40  # frames
SHORT, LONG = 1200, 4800  # frames
TAUGHT = 3 * 60 * RATE  # frames of lessons


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path)
    cache = parser.parse_args().cache
    logging.getLogger("blendcap").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as temporary:
        taught = lessons("mannequin", cache or Path(temporary))
    long_lessons = _repeated(*taught)
    start = time.process_time()
    classifier = train_classifier(*long_lessons)
    training, frames = time.process_time() - start, sum(len(part.sure) for part in long_lessons[0])
    rows = [f"| teach on {frames:,} frames, {frames / RATE / 60:.1f} minutes | {training:.0f} s of processor time |"]
    rows.append(f"| peak memory of teaching | {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB |")
    scene = _filmed()
    cameras = f"{len(scene.shots)} cameras of 640x480"
    rows += _measured(f"patches of {cameras} to curves", partial(_telling, scene, classifier))
    rows += _measured(f"paint before {cameras} to tracks", partial(_following, scene))
    write_section("Speed of makeup patches", "python benchmarks/hybrid_speed.py", TEXT + "\n".join(rows))


def _measured(what: str, prepare: Callable[[int], Callable[[], object]]) -> list[str]:
    """Rows: frames a second of what is prepared for so many frames, and its peak of memory."""
    work, rates = {count: prepare(count) for count in (SHORT, LONG)}, []
    for _ in range(ROUNDS):
        clocks = time.process_time(), time.perf_counter()
        work[SHORT]()
        rates.append((SHORT / (time.process_time() - clocks[0]), SHORT / (time.perf_counter() - clocks[1])))
    rows = []
    for way, told in zip(("processor", "wall"), np.transpose(rates), strict=True):
        spread = f"({min(told):.0f} to {max(told):.0f})"
        rows.append(f"| {what} | {np.median(told):.0f} frames a second of {way} time {spread} |")
    for count in (SHORT, LONG):
        tracemalloc.start()
        work[count]()
        peak = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        rows.append(f"| the same, peak of what Python and NumPy take for {count:,} frames | {peak:.0f} MB |")
    return rows


TEXT = """On two cores, which all three use. Cutting is counted; decoding of video
and the solve that says where paint is sought are not. Frames lie in memory, forty filmed ones again and again. The
bars: 60 frames a second, three minutes of lessons taught in three minutes, memory that does not grow with the take.
Tracks do grow: every point's place in every frame is what is asked for.

| what | how much |
|---|---|
"""


def _repeated(patches: list[Patches], shown: list[Lesson]) -> tuple[list[Patches], list[Lesson]]:
    """The lessons again and again until they last as long as is asked; every showing is a new one."""
    times = int(np.ceil(TAUGHT / sum(len(part.sure) for part in patches)))
    longer, told = [], []
    for part, lesson in zip(patches, shown, strict=True):
        images = {name: np.concatenate([frames] * times) for name, frames in part.images.items()}
        longer.append(replace(part, images=images, sure=np.tile(part.sure, times)))
        turns = [np.where(lesson.units == "", 0, lesson.repetitions + 100 * k) for k in range(times)]
        weights = lesson.weights and replace(lesson.weights, **_tiled(lesson.weights, times))
        told.append(Lesson(np.tile(lesson.units, times), np.concatenate(turns), weights))
    return longer, told


def _tiled(weights: Animation, times: int) -> dict[str, np.ndarray | None]:
    parts = {name: getattr(weights, name) for name in ("weights", "head", "confidence")}
    tiled = {name: None if part is None else np.concatenate([part] * times) for name, part in parts.items()}
    return tiled | {"times": None}


class _Scene(NamedTuple):
    """Forty frames of four head cameras, their markers, and where things are in them."""

    shots: list[list[np.ndarray]]
    setup: Setup
    rig: Rig
    take: MarkerTake
    binding: Binding
    cameras: Sequence[Camera]


def _filmed() -> _Scene:
    own, rig = face("mannequin", PERSON), given("mannequin", PERSON)
    performer = make_performer(own, seed=PERSON)
    makeup = draw_makeup(performer.rig, seed=PERSON)
    points = between(own, makeup, MARKERS, PERSON)
    shown = action_units(own, ["45"], rate=RATE, repeats=1, seed=PERSON).animation
    take, truth = make_take(performer, shown, points, seed=PERSON)
    helmet = mount_head_camera(performer.rig, seed=PERSON)
    shots = [
        list(itertools.islice(shot.frames(), FILMED)) for shot in film_head(truth, helmet, seed=PERSON, makeup=makeup)
    ]
    binding = blendcap.bind(rig, take, points)
    setup = locate(rig, take, binding, helmet.cameras, [helmet.size] * len(shots))
    return _Scene(shots, setup, rig, take, binding, helmet.cameras)


def _again(shots: list[list[np.ndarray]], count: int) -> list[Iterator[np.ndarray]]:
    return [itertools.islice(itertools.cycle(frames), count) for frames in shots]


def _as_long(paths: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """Of each camera the paths (T, K, 2) of the filmed frames, again and again."""
    return [np.resize(of_view[:FILMED], (count, *of_view.shape[1:])) for of_view in paths]


def _telling(scene: _Scene, classifier: PatchClassifier, count: int) -> Callable[[], object]:
    """Curves of so many frames, from their pictures."""
    dots, anchors = _as_long(scene.setup.dots, count), _as_long(scene.setup.anchors, count)

    def work() -> Animation:
        videos, places = _again(scene.shots, count), scene.setup.places
        return classify(classifier, each_block(videos, places, anchors, RATE, dots=dots, dot_radius=6.0))

    return work


def _following(scene: _Scene, count: int) -> Callable[[], object]:
    """Tracks of so many frames, from their pictures and a solve."""
    positions = scene.take.positions[:FILMED]
    take = replace(scene.take, positions=np.resize(positions, (count, *positions.shape[1:])), residuals=None)
    first = blendcap.solve(scene.rig, take, scene.binding, settings=SolveSettings(head="keep"))
    return lambda: blendcap.track_paint(
        _again(scene.shots, count), scene.rig, take, scene.binding, scene.cameras, first
    )


if __name__ == "__main__":
    main()
