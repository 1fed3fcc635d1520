"""Three photographs and five synchronised views of one person, with cameras and landmarks."""

import sys
import tempfile
from pathlib import Path

import blendcap
from blendcap.synthetic.performances import speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.views import five_views, photographs
from blendcap.view.footage import write_shots

out = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
rig = blendcap.mannequin()
performer = make_performer(rig, seed=3)

groups = {
    "photographs": photographs(performer, seed=2, size=(240, 320)),
    "views": five_views(performer, speech(rig, rate=10.0, seconds=0.3, seed=3), seed=2, size=(180, 240)),
}
for name, shots in groups.items():
    (out / name).mkdir(parents=True, exist_ok=True)
    write_shots(out / name, shots)
    for shot in shots:
        count = shot.landmarks.visible[0].sum()
        print(
            f"{name} {shot.name}: {count} of 68 landmarks in sight, {shot.camera.intrinsics[0, 0]:.0f} px focal length"
        )
print(f"pictures and their truth are in {out}")
