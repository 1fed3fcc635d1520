"""A take before four head cameras: markers as white dots, painted strokes, ring lights, a helmet that slips."""

import sys
import tempfile
from pathlib import Path

import blendcap
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performances import speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take
from blendcap.view.footage import write_shots

out = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
out.mkdir(parents=True, exist_ok=True)

rig = blendcap.mannequin()
performer = make_performer(rig, seed=3)
take, truth = make_take(performer, speech(rig, rate=30.0, seconds=0.5, seed=3), choose_points(rig, 50), seed=3)

helmet = mount_head_camera(performer.rig, seed=1, size=(320, 240))
makeup = draw_makeup(performer.rig, seed=5)
shots = film_head(truth, helmet, seed=7, makeup=makeup)
write_shots(out, shots, take)

for shot in shots:
    seen = shot.markers
    print(f"{shot.name}: {shot.count} frames, {seen.visible.mean(0).sum():.0f} of {len(seen.names)} dots in sight")
print(f"the helmet slips by up to {abs(truth.slip[:, :3]).max():.1f} mm; films, truth and markers.c3d are in {out}")
