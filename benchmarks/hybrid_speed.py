"""How fast makeup patches become curves, how long a machine is taught, and what memory it takes.

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
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import blendcap
from blendcap import Animation
from blendcap.makeup.curves import classify
from blendcap.makeup.lesson import Lesson
from blendcap.makeup.patches import Patches, each_block
from blendcap.makeup.setup import locate
from blendcap.makeup.training import train_classifier
from blendcap.synthetic.exercises import action_units
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import make_take
from hybrid_data import RATE, between, face, given, lessons
from results import write_section

PERSON, MARKERS, ROUNDS = 5, 50, 3
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
    shots, setup, dots = _filmed()
    rows = [f"| teach on {frames:,} frames, {frames / RATE / 60:.1f} minutes | {training:.0f} s of processor time |"]
    rows.append(f"| peak memory of teaching | {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB |")

    def told(count: int) -> None:
        videos = [itertools.islice(itertools.cycle(frames), count) for frames in shots]
        seen = [np.resize(of_view, (count, *of_view.shape[1:])) for of_view in dots]
        blocks = each_block(videos, setup.places, setup.anchors, RATE, dots=seen, dot_radius=6.0)
        classify(classifier, blocks)

    rates, memory = [], {}
    for _ in range(ROUNDS):
        start = time.process_time()
        told(SHORT)
        rates.append(SHORT / (time.process_time() - start))
    for count in (SHORT, LONG):
        tracemalloc.start()
        told(count)
        memory[count] = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
    rows += [
        f"| patches of {len(shots)} cameras of 640x480 to curves | {np.median(rates):.0f} frames a second of processor "
        f"time ({min(rates):.0f} to {max(rates):.0f}) |",
        f"| peak of what Python and NumPy take for {SHORT:,} frames | {memory[SHORT]:.0f} MB |",
        f"| the same for {LONG:,} frames | {memory[LONG]:.0f} MB |",
    ]
    write_section("Speed of makeup patches", "python benchmarks/hybrid_speed.py", TEXT + "\n".join(rows))


TEXT = """One thread. Cutting is counted, decoding of video is not: frames lie in memory, forty filmed ones again and
again. The bars: 60 frames a second, three minutes of lessons taught in three minutes, memory that does not grow with
the take.

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


def _filmed() -> tuple[list[list[np.ndarray]], object, list[np.ndarray]]:
    """Forty frames of four head cameras, where things are in them, and the dots."""
    own, rig = face("mannequin", PERSON), given("mannequin", PERSON)
    performer = make_performer(own, seed=PERSON)
    makeup = draw_makeup(performer.rig, seed=PERSON)
    points = between(own, makeup, MARKERS, PERSON)
    shown = action_units(own, ["45"], rate=RATE, repeats=1, seed=PERSON).animation
    take, truth = make_take(performer, shown, points, seed=PERSON)
    helmet = mount_head_camera(performer.rig, seed=PERSON)
    shots = [list(_first(shot.frames())) for shot in film_head(truth, helmet, seed=PERSON, makeup=makeup)]
    setup = locate(rig, take, blendcap.bind(rig, take, points), helmet.cameras, [helmet.size] * len(shots))
    return shots, setup, [of_view[: len(shots[0])] for of_view in setup.dots]


def _first(frames: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
    return itertools.islice(iter(frames), 40)


if __name__ == "__main__":
    main()
