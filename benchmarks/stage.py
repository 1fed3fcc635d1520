"""How long the stage's cameras take for a picture, on one core.

python benchmarks/stage.py [ICT-FaceKit .npz]
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
import tracemalloc

import numpy as np

import blendcap
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performances import speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take
from blendcap.synthetic.views import five_views, one_camera, photographs
from results import write_section

TARGET = 40.0  # ms for 640 x 480


def head_cameras(rig):
    performer = make_performer(rig, seed=3)
    take = make_take(performer, speech(rig, rate=60.0, seconds=1.0, seed=3), choose_points(rig, 50), seed=3)[1]
    helmet = mount_head_camera(performer.rig, seed=1)
    return performer, film_head(take, helmet, seed=7, makeup=draw_makeup(performer.rig, seed=5))


def milliseconds(shot, count: int) -> tuple[float, float]:
    """Least and median processor time of a frame in a running film."""
    frames, spent = shot.frames(20), []
    for _ in range(count + 1):
        start = time.process_time()
        next(frames)
        spent.append(1e3 * (time.process_time() - start))
    return min(spent[1:]), float(np.median(spent[1:]))


def peak(shot) -> float:
    """Largest memory of NumPy arrays while a film runs, MB."""
    tracemalloc.start()
    for _ in shot.frames(0, 8):
        pass
    size = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return size / 1e6


def main() -> None:
    rigs = [blendcap.mannequin(), *(blendcap.read_rig(path) for path in sys.argv[1:])]
    rows = []
    for rig in rigs:
        performer, shots = head_cameras(rig)
        for shot in shots:
            least, median = milliseconds(shot, 15)
            verdict = "met" if median <= TARGET else "missed"
            rows.append(f"| {rig.name} | head camera, {shot.name} | 640 x 480 grey | {least:.1f} | {median:.1f} | "
                        f"{TARGET:.0f}: {verdict} | {peak(shot):.0f} |")  # fmt: skip
        talk = speech(rig, rate=30.0, seconds=1.5, seed=3)
        for shot, what in ((one_camera(performer, talk, seed=5), "one camera"),
                           (five_views(performer, talk, seed=5)[1], "one of five views")):  # fmt: skip
            least, median = milliseconds(shot, 4)
            rows.append(f"| {rig.name} | {what} | {shot.size[0]} x {shot.size[1]} color | {least:.0f} | {median:.0f} | "
                        f"| {peak(shot):.0f} |")  # fmt: skip
        photograph = photographs(performer, seed=5)[0]
        next(photograph.frames())
        start = time.process_time()
        next(photograph.frames())
        spent = 1e3 * (time.process_time() - start)
        rows.append(f"| {rig.name} | photograph | 720 x 960 color | {spent:.0f} | {spent:.0f} | | |")
    load = os.getloadavg()[0]
    write_section(
        "The stage's cameras",
        "python benchmarks/stage.py" + (" ict_facekit.npz" if len(rigs) > 1 else ""),
        f"Processor time of a frame, pose, motion blur, noise and lens included; load {load:.1f} when done (a busy\n"
        "machine makes processor time longer too). Memory is the peak of NumPy's arrays, which does not grow with the\n"
        "film's length.\n\n"
        "| rig | shot | picture | least, ms | median, ms | target | peak, MB |\n|---|---|---|---|---|---|---|\n"
        + "\n".join(rows),
    )
    print("\n".join(rows))


if __name__ == "__main__":
    main()
