"""A real head scan, registered with two templates. Scan: Lee Perry-Smith, Infinite-Realities, CC BY 3.0."""

import numpy as np
import pytest

import blendcap
from blendcap.modeling.landmark_names import rig_landmarks
from blendcap.modeling.scan_repair import ready_scan

UNIT = 53.0  # mm; the file's unit is arbitrary: this makes the face as large as most
SMOOTH = {"mannequin": ("forehead", "nose", "cheeks", "jaw"), "ICT-FaceKit": ("narrow_face",)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mannequin", "ICT-FaceKit"])
def test_a_real_head_is_met_to_half_a_per_cent_of_the_face(data, name):
    scan = data("scans/LeePerrySmith/LeePerrySmith.obj")
    rig = blendcap.mannequin() if name == "mannequin" else blendcap.read_rig(data("rigs/ict_facekit.npz"))
    ready = ready_scan(blendcap.read_mesh(scan), UNIT)
    there, here = blendcap.find_landmarks(ready.mesh), rig_landmarks(rig)
    names = [n for n in here.names if n in there.names]
    answer = blendcap.register(rig, ready.mesh, (here.select(names), there.select(names).positions(ready.mesh)))
    points = rig.points["landmarks68"].positions(answer.mesh)
    height = np.linalg.norm(points[27] - points[8])
    near = np.concatenate([points[36:48], points[48:]])  # eyes and mouth
    face = np.unique(np.concatenate([rig.regions[region] for region in SMOOTH[name]]))
    away = np.linalg.norm(answer.mesh.vertices[face][:, None] - near, axis=2).min(1) > 0.08 * height
    distance = answer.distance[face[away]]
    assert np.isfinite(distance).mean() > 0.85
    assert np.nanmedian(distance) < 0.005 * height
    assert np.nanpercentile(distance, 95) < 0.01 * height
    front = np.zeros(len(answer.mesh.vertices), bool)
    front[face[away]] = True
    assert not front[answer.mesh.faces[answer.flipped]].all(1).any()
