"""Find landmarks on a scan of a person that nobody trained on, and see how far they lie from the truth."""

import sys
from pathlib import Path

import numpy as np

import blendcap
from blendcap.io import write_points
from blendcap.modeling.landmark_names import FEATURES, rig_landmarks
from blendcap.view import write_landmarks

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# Any textured mesh will do, in any unit: scan = blendcap.read_mesh("scan.glb"). Without a texture its form is enough.
person = blendcap.mannequin(1002)
scan = person.mesh

points = blendcap.find_landmarks(scan)
write_points(out / "landmarks.json", points, "scan")
write_landmarks(out / "landmarks.png", scan, points)

truth = rig_landmarks(person)
found = points.select([name for name in FEATURES if name in points.names])
errors = np.linalg.norm(found.positions(scan) - truth.select(found.names).positions(scan), axis=1)
for name, error in zip(found.names, errors, strict=True):
    print(f"{name:<18}{error:5.1f} mm from its place")
assert len(found.names) == 12 and np.median(errors) < 3
