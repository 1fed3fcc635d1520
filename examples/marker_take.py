"""A marker take of somebody who is not the rig, with a tracker's mistakes: C3D, and the truth beside it.

python marker_take.py [FOLDER]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import blendcap
from blendcap.io.points_json import write_points
from blendcap.synthetic.conversation import conversation
from blendcap.synthetic.mislabels import mislabel
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import make_take

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)
rig = blendcap.mannequin()
performer = make_performer(rig, seed=7, resistance=1.0)
talk = conversation(rig, rate=60, seconds=10, seed=7)
sound, truth = make_take(performer, talk, rig.points["markers50"], seed=7, noise=0.2, occlusion=0.05)
take, mistakes = mislabel(sound, seed=7, swaps=3, ghosts=6, loose=4)

blendcap.write_markers(folder / "take.c3d", take)
blendcap.write_animation(folder / "animation.npz", truth.animation)
write_points(folder / "places.json", truth.points, rig.name)
np.savez(folder / "truth.npz", positions=truth.positions, missing=truth.missing, slip=truth.slip, pivot=truth.pivot)
np.savez(folder / "mistakes.npz", owner=mistakes.owner, false=mistakes.false)

back = blendcap.read_markers(folder / "take.c3d")
assert back.names == take.names and np.array_equal(back.missing, take.missing)
print(
    f"{len(take.positions)} frames, {len(sound.names)} markers, {100 * truth.missing.mean():.1f} % missing, in {folder}"
)
for one, two, start, stop in mistakes.swaps:
    print(f"{one} and {two} change places in frames {start} to {stop - 1}")
print(f"{mistakes.false[:, : len(sound.names)].sum()} positions are ghosts; {', '.join(mistakes.loose)} have no label")
