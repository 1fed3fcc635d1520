"""How long a mannequin takes, and a picture of the stage's cameras, on one core.

python benchmarks/stage.py [ICT-FaceKit .npz]
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import subprocess
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


MANNEQUIN = """
import json, resource, time

def spent(call):
    start = time.process_time()
    call()
    return time.process_time() - start

def first():
    global rig, mannequin
    from blendcap import mannequin
    rig = mannequin(7)

cold = spent(first)
again = min(spent(lambda: mannequin(7)) for _ in range(3))
another = min(spent(lambda: mannequin(seed)) for seed in (8, 9, 10))
size = sum(array.nbytes for array in (rig.deltas, rig.mesh.vertices, rig.mesh.faces, rig.mesh.uv, rig.mesh.texture))
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
print(json.dumps([cold, again, another, size / 1e6, peak]))
"""


def mannequins() -> str:
    """A table: processor time of mannequins of 140 shapes in a new process, and their memory."""
    done = subprocess.run([sys.executable, "-c", MANNEQUIN], check=True, capture_output=True, text=True)
    cold, again, another, size, peak = json.loads(done.stdout)
    rows = [("first of a new process, imports included", cold, 3.0), ("the same person again", again, 0.3),
            ("another person", another, np.inf)]  # fmt: skip
    lines = [f"| {what} | {spent:.2f} | {_verdict(spent, most)} |" for what, spent, most in rows]
    head = "| mannequin of 140 shapes | processor time, s | target |\n|---|---|---|\n"
    return head + "\n".join(lines) + f"\n\nIts arrays take {size:.0f} MB, the process {peak:.0f} MB at its peak.\n"


def _verdict(spent: float, most: float) -> str:
    return "" if np.isinf(most) else f"{most:g}: {'met' if spent <= most else 'missed'}"


def main() -> None:
    made = mannequins()
    rigs = [blendcap.mannequin(), *(blendcap.read_rig(path) for path in sys.argv[1:])]
    rows = []
    for rig in rigs:
        performer, shots = head_cameras(rig)
        for shot in shots:
            least, median = milliseconds(shot, 15)
            rows.append(f"| {rig.name} | head camera, {shot.name} | 640 x 480 grey | {least:.1f} | {median:.1f} | "
                        f"{_verdict(median, TARGET)} | {peak(shot):.0f} |")  # fmt: skip
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
        + "\n".join(rows)
        + "\n\nThe very first use after an installation compiles for some seconds more, once.\n\n"
        + made,
    )
    print("\n".join(rows))


if __name__ == "__main__":
    main()
