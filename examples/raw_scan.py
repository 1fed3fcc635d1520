"""A raw scan of a face that nobody registered yet: another topology, noise, holes, hair, and the truth of each vertex.

python raw_scan.py [FOLDER]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import blendcap
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.scans import make_scan

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)
person = make_performer(blendcap.mannequin(3, 52), seed=3)
smile = np.zeros(len(person.names))
smile[[person.names.index(name) for name in ("mouthSmileLeft", "mouthSmileRight")]] = 0.8
for name, weights in (("neutral", None), ("smile", smile)):
    scan = make_scan(person, weights, seed=3, spacing=2.5)  # 1.5 if not given: 80,000 vertices
    blendcap.write_mesh(folder / f"{name}.obj", scan.mesh)
    blendcap.write_mesh(folder / f"{name}_truth.obj", scan.expression)
    places = {"faces": scan.faces, "barycentric": scan.barycentric, "landmarks": scan.landmarks, "holes": scan.holes}
    np.savez(folder / f"{name}_truth.npz", **places, weights=scan.weights, names=scan.rig.names)
    off = (scan.mesh.vertices - scan.carried(scan.expression.vertices))[~scan.clutter]
    print(
        f"{name}: {len(scan.mesh.vertices)} vertices, {100 * scan.clutter.mean():.0f} % of them hair and cloth, "
        f"{len(scan.holes)} holes, {np.sqrt((off**2).sum(1).mean()):.3f} mm from the true skin, in {folder}"
    )
