"""Bake the wrinkles of a high-resolution scan into a normal map of one shape, and look at the face with them."""

import sys
from pathlib import Path

import numpy as np
import trimesh

import blendcap
from blendcap.rendering import vertex_normals
from blendcap.view import write_still

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# A scan of raised brows: the posed face in fine triangles, with furrows across the forehead, 0.35 mm deep.
rig = blendcap.mannequin()
weights = (np.array(rig.names) == "browInnerUp").astype(float)
posed = rig.pose(weights)
forehead = np.isin(rig.mesh.faces, rig.regions["forehead"]).all(1)
vertices, faces = posed, rig.mesh.faces[forehead]
for _ in range(3):
    vertices, faces = trimesh.remesh.subdivide(vertices, faces)
x, y = vertices[:, 0], vertices[:, 1]
depth = 0.35 * np.exp(-((x / 32) ** 4) - ((y - 46) / 14) ** 4) * np.sin(0.9 * y + 0.01 * x**2 / 4)
scan = blendcap.Mesh(vertices + depth[:, None] * vertex_normals(vertices, faces), faces)

baking = blendcap.bake_normals(rig, {"browInnerUp": scan})
baked = baking.baked["browInnerUp"]
print(f"{baked.coverage:.0%} of the surface was scanned, {np.nanmax(baked.distance):.2f} mm off the rig at most")

blendcap.write_rig(out / "wrinkled.glb", baking.rig)
again = blendcap.read_rig(out / "wrinkled.glb")
print(f"beside wrinkled.glb lie the normal maps of {', '.join(again.normal_maps)}")
write_still(out / "wrinkled.png", again, weights, size=(1280, 720))
