"""Someone who talks before an ordinary camera, with the truth that a tracker should find."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import blendcap
from blendcap.synthetic.performances import speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.views import one_camera
from blendcap.view.footage import write_shots

out = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
out.mkdir(parents=True, exist_ok=True)

rig = blendcap.mannequin()
performer = make_performer(rig, seed=3)
shot = one_camera(performer, speech(rig, rate=15.0, seconds=1.0, seed=3), seed=5, size=(240, 180))
write_shots(out, [shot])

take = shot.landmark_take()
turn = np.degrees(np.arctan2(shot.placement[:, 0, 2], shot.placement[:, 2, 2]))
gain = shot.lights["gain"][:, 1]
print(f"{shot.count} frames; the head turns from {turn.min():.1f} to {turn.max():.1f} degrees")
print(
    f"landmarks in sight: {np.isfinite(take.points[..., 0]).mean():.0%}; exposure {gain.min():.2f} to {gain.max():.2f}"
)
print(f"the video and its truth are in {out}")
