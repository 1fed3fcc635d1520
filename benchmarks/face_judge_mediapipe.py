"""FaceMesh on the pictures of a folder: run by `face_judge.py` in an environment of its own, which has no blendcap."""

import sys
from pathlib import Path

import mediapipe as mp
import numpy as np

folder = Path(sys.argv[1])
with np.load(folder / "pictures.npz") as archive:
    pictures = archive["pictures"]
height, width = pictures.shape[1:3]
points = np.full((len(pictures), 478, 2), np.nan)
with mp.solutions.face_mesh.FaceMesh(static_image_mode=True, refine_landmarks=True, max_num_faces=1) as net:
    for row, picture in zip(points, pictures, strict=True):
        found = net.process(picture).multi_face_landmarks
        if found:
            row[:] = [(p.x * width - 0.5, p.y * height - 0.5) for p in found[0].landmark]
np.savez(folder / "points.npz", points=points)
