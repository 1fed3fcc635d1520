"""A lesson and a performance, filmed by two head cameras, with every file that `blendcap facs` wants, and the commands.

python examples/facs.py [folder]
"""

import json
import shlex
import sys
import tempfile
from pathlib import Path

import blendcap
from blendcap.cli import main
from blendcap.io import write_video
from blendcap.io.cameras import write_cameras
from blendcap.synthetic.exercises import action_units
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import make_take

RATE, SIZE, UNITS = 12.0, (480, 360), ("1+2", "45")
out = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
out.mkdir(parents=True, exist_ok=True)

rig = blendcap.mannequin(1, shapes=52)
performer = make_performer(rig, seed=1)
makeup, worn = draw_makeup(performer.rig, seed=1), rig.points["markers50"]
helmet = mount_head_camera(performer.rig, seed=1, size=SIZE)
blendcap.write_rig(out / "rig.glb", rig)
write_cameras(out / "cameras.json", {n: (c, SIZE) for n, c in zip(helmet.names, helmet.cameras, strict=True)})
(out / "places.json").write_text(json.dumps({name: f"markers50/{name}" for name in worn.names}), encoding="utf-8")

for name, repeats, seed in (("lesson", 3, 0), ("take", 1, 5)):
    shown = action_units(rig, UNITS, rate=RATE, repeats=repeats, seed=seed)
    take, truth = make_take(performer, shown.animation, worn, seed=seed)
    blendcap.write_markers(out / f"{name}.c3d", take)
    lead = len(take.positions) - len(shown.animation.weights)  # the neutral frames before
    rows = [f"{(a + lead) / RATE:.3f},{(b + lead) / RATE:.3f},AU{unit}" for unit, a, b, _ in shown.turns]
    (out / f"{name}.turns.csv").write_text("\n".join(["start,end,unit", *rows, ""]), encoding="utf-8")
    for shot in film_head(truth, helmet, seed=seed, makeup=makeup):
        print(f"Filming the {name}, camera {shot.name}, {len(take.positions)} frames", flush=True)
        write_video(out / f"{name}.{shot.name}.mp4", shot.frames(), RATE, SIZE, loss=8)
print((out / "lesson.turns.csv").read_text(encoding="utf-8"))


def run(words: str) -> None:
    print("\n$ blendcap", words.replace(f"{out}/", ""))
    if main(shlex.split(words)):
        raise SystemExit(1)


def stage(name: str) -> str:
    films = " ".join(f"{out}/{name}.{camera}.mp4" for camera in helmet.names)
    return f"{films} --cameras {out}/cameras.json --take {out}/{name}.c3d {known}"


known = f"--rig {out}/rig.glb --correspondences {out}/places.json"
run(f"solve {out}/lesson.c3d {known} -o {out}/lesson.npz")
run(f"facs train {stage('lesson')} --turns {out}/lesson.turns.csv --weights {out}/lesson.npz -o {out}/units.npz")
run(f"facs predict {stage('take')} --model {out}/units.npz -o {out}/curves.csv --picture {out}/look.png")
run(f"facs track {stage('take')} --patches {out}/curves.csv -o {out}/tracks.npz --picture {out}/followed.png")
run(f"solve {out}/take.c3d {known} --patches {out}/curves.csv --tracks {out}/tracks.npz -o {out}/animation.csv")
