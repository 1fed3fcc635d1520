"""Make the landmark detectors that come with blendcap, src/blendcap/modeling/landmarks.npz, from mannequins."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from blendcap.data import LandmarkModel
from blendcap.io.npz import write_npz
from blendcap.modeling.detectors import VERSION
from blendcap.modeling.face_search import FACE_PIXEL, FACE_SIZE
from blendcap.modeling.frontal import PIXEL, SIZE, frontal, frontal_camera
from blendcap.modeling.landmark_names import FEATURES, LINES, line_names
from blendcap.modeling.landmark_training import as_picture, train_landmarks
from blendcap.rendering import project
from landmark_faces import (
    UV_SIZE,
    Face,
    askew,
    askew_texture,
    average_places,
    face,
    on_texture,
    rectangles,
    straight,
    weathered,
)

PEOPLE = range(1, 121)  # seeds of training; those from 1000 on are held out
TARGET = Path(__file__).resolve().parent.parent / "src" / "blendcap" / "modeling" / "landmarks.npz"
LINE_POINTS = [name for line in LINES for name in line_names(line)]


def main() -> None:
    rng = np.random.default_rng(0)
    people = [face(seed, rng) for seed in PEOPLE]
    places = average_places(people)
    close, far, truth = pictures(people, places, rng)
    detectors = {"uv": {"points": train_uv(people, rng)}}
    for kind, channels in (("front", slice(0, 2)), ("form", slice(1, 2))):
        detectors[kind] = {
            "points": train_points([image[..., channels] for image in close], truth, people, places),
            "lines": train_lines([image[..., channels] for image in close], truth),
            "face": train_faces([image[..., channels] for image in far], truth, places),
        }
    save(detectors)


def pictures(people: list[Face], places: np.ndarray, rng) -> tuple[list, list, list]:
    """Each person not quite straight: the picture of the face, the small one of the head, and the similarity."""
    close, far, truth = [], [], []
    for person in people:
        place = askew(rng) @ straight(person, places)
        close.append(weathered(frontal(person.mesh, place).image, rng))
        far.append(weathered(frontal(person.mesh, place, FACE_SIZE, FACE_PIXEL).image, rng))
        truth.append((person, place))
    return close, far, truth


def seen(person: Face, place: np.ndarray, names, size: int = SIZE, pixel: float = PIXEL) -> np.ndarray:
    """Pixels (M, 2) of points in a picture from the front."""
    points = person.points.select(list(names)).positions(person.mesh)
    return project(points @ place[:3, :3].T + place[:3, 3], frontal_camera(size, pixel))[0]


def train_points(images, truth, people, places) -> LandmarkModel:
    boxes = [rectangles(FEATURES, seen(*known, FEATURES), 13) for known in truth]
    model = train_landmarks(images, boxes, cells=6, cell=8, places=places)
    aligned = np.array([seen(person, straight(person, places), FEATURES) for person in people])
    off = aligned - aligned.mean(0)  # the prior is that of faces turned to the front; searching adds its own slack
    covariance = np.einsum("pli,plj->lij", off, off) / len(off) + np.eye(2)
    return replace(model, mean=aligned.mean(0), covariance=covariance)


def train_lines(images, truth) -> LandmarkModel:
    boxes = [rectangles(LINE_POINTS, seen(*known, LINE_POINTS), 5) for known in truth]
    return train_landmarks(images, boxes, cells=4, cell=4, radius=0.006)


def train_faces(images, truth, places) -> LandmarkModel:
    boxes = []
    for person, place in truth:
        middle = seen(person, place, FEATURES, FACE_SIZE, FACE_PIXEL).mean(0)
        boxes.append(rectangles(["face"], middle[None], 9))
    return train_landmarks(images, boxes, cells=6, cell=8, radius=0.03, places=places.mean(0)[None])


def train_uv(people, rng) -> LandmarkModel:
    """The thesis' way: the descriptors of thirty textures are the filters."""
    images, boxes = [], []
    for person in people[:30]:
        grey = as_picture(person.mesh.texture)[..., 0]
        grey = cv2.resize(grey, (UV_SIZE, UV_SIZE), interpolation=cv2.INTER_AREA)
        warped, pixels = askew_texture(grey, on_texture(person, FEATURES), rng)
        images.append(warped)
        boxes.append(rectangles(FEATURES, pixels, 33))
    return train_landmarks(images, boxes, method="exemplars")


def save(detectors: dict[str, dict[str, LandmarkModel]]) -> None:
    arrays = {
        f"{kind}/{part}/{name}": values
        for kind, parts in detectors.items()
        for part, model in parts.items()
        for name, values in model.arrays().items()
    }
    meta = {"kind": "landmark detectors", "version": VERSION, "trained_on": "mannequins 1 to 120"}
    write_npz(TARGET, meta, **arrays)
    print(f"{TARGET.name}: {TARGET.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
