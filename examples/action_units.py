"""The exercises that train a classifier: action units at rising intensity, with the truth of every frame.

python action_units.py [FOLDER]
"""

import sys
import tempfile
from pathlib import Path

import blendcap
from blendcap.synthetic.exercises import TRAINED, action_units, frown, lip_swing

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)
rig = blendcap.mannequin()
exercise = action_units(rig, TRAINED, rate=60, repeats=4, seed=1)
blendcap.write_animation(folder / "action_units.csv", exercise.animation)
blendcap.write_animation(folder / "labels.csv", exercise.labels)
for name, extreme in (("lip_swing", lip_swing(rig)), ("frown", frown(rig))):
    blendcap.write_animation(folder / f"{name}.csv", extreme)

print(f"{len(exercise.animation.weights)} frames in {folder}")
for what in TRAINED:
    done = [
        f"{level:.2f} in frames {start} to {stop - 1}" for name, start, stop, level in exercise.turns if name == what
    ]
    print(f"AU {what}: {'; '.join(done)}")
