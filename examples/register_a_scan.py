"""From a raw scan to the actor's rig, in Python: landmarks, registration, transfer; the truth is known here."""

import sys
from pathlib import Path

import numpy as np

import blendcap
from blendcap.modeling.landmark_names import rig_landmarks
from blendcap.synthetic.scans import make_scan

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# Somebody else than the template, scanned: another net of triangles, 0.1 mm noise, five holes, no back of the head.
template, person = blendcap.mannequin(), blendcap.mannequin(identity=4)
scan = make_scan(person, seed=4, spacing=2.5, clutter=False)

# Landmarks that both have: found on the scan, known on the template.
there, here = blendcap.find_landmarks(scan.mesh), rig_landmarks(template)
names = [name for name in here.names if name in there.names]
landmarks = (here.select(names), there.select(names).positions(scan.mesh))

registration = blendcap.register(template, scan.mesh, landmarks)
for level in registration.levels:
    print(
        f"stiffness {level.stiffness:5.2f}: {level.steps:2d} steps, {level.matched:.0%} matched, "
        f"the last step moved {level.change:.3f} mm, residual {level.residual:.0e}"
    )
rig = blendcap.transfer_rig(template, registration.mesh)
blendcap.write_rig(out / "actor.glb", rig)

skin = np.unique(np.concatenate([template.regions[name] for name in ("forehead", "nose", "cheeks", "lips", "jaw")]))
missed = np.linalg.norm(registration.mesh.vertices - person.mesh.vertices, axis=1)[skin].mean()
unmoved = np.linalg.norm(template.mesh.vertices - person.mesh.vertices, axis=1)[skin].mean()
print(f"distance to the scan: {np.nanmedian(registration.distance):.2f} mm in the middle")
print(f"a vertex is {missed:.2f} mm from where it belongs; the unchanged template's, {unmoved:.2f} mm")
assert missed < unmoved
