"""Pictures of mannequins with known landmarks, for training and judging the detectors."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import blendcap
from blendcap.data import Mesh, SurfacePoints
from blendcap.modeling.frontal import MIDDLE
from blendcap.modeling.landmark_names import FEATURES, rig_landmarks
from blendcap.numerics.similarity import align
from blendcap.rendering.texels import uv_pixels

TURN, SIZE, SHIFT = (6.0, 6.0, 3.0), 0.06, 4.0  # deviations of a face that is not yet straight: degrees, log, mm
UV_SIZE = 1024


class Face(NamedTuple):
    mesh: Mesh
    points: SurfacePoints


def face(seed: int, rng: np.random.Generator) -> Face:
    """A person with a little expression, lids open, closed or between, and the texture lighter or darker."""
    rig = blendcap.mannequin(seed)
    weights = np.zeros(len(rig.names))
    weights[rng.integers(0, len(rig.names), 4)] = rng.uniform(0, 0.35, 4)
    blink = rng.choice([0.0, 0.0, 1.0, 1.0, rng.uniform()])
    weights[[rig.index("eyeBlinkLeft"), rig.index("eyeBlinkRight")]] = blink
    texture = (255 * (rig.mesh.texture / 255.0) ** rng.uniform(0.7, 1.4)).astype(np.uint8)
    mesh = rig.mesh
    mesh = Mesh(rig.pose(weights), mesh.faces, uv=mesh.uv, uv_faces=mesh.uv_faces, texture=texture)
    return Face(mesh, rig_landmarks(rig))


def average_places(people: list[Face]) -> np.ndarray:
    """Mean positions (12, 3), mm, of the features."""
    return np.mean([p.points.select(list(FEATURES)).positions(p.mesh) for p in people], axis=0)


def straight(person: Face, places: np.ndarray) -> np.ndarray:
    """The similarity (4, 4) that carries a person onto the average face."""
    rotation, translation, scale = align(person.points.select(list(FEATURES)).positions(person.mesh), places)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = scale * rotation, translation
    return place


def askew(rng: np.random.Generator) -> np.ndarray:
    """A small similarity (4, 4) about the middle of the face."""
    turn = np.exp(rng.normal(0, SIZE)) * Rotation.from_euler("xyz", rng.normal(0, TURN), degrees=True).as_matrix()
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = turn, MIDDLE - turn @ MIDDLE + rng.normal(0, SHIFT, 3)
    return place


def on_texture(person: Face, names) -> np.ndarray:
    """Pixels (M, 2) of points on a texture of 1024 pixels. On a seam the chart of the skin counts, which is above."""
    mesh, points = person.mesh, person.points.select(list(names))
    pixels = uv_pixels(mesh, (UV_SIZE, UV_SIZE))
    result = (points.barycentric[..., None] * pixels[mesh.uv_faces[points.faces]]).sum(1)
    for k in range(len(result)):
        corner = int(points.barycentric[k].argmax())
        if points.barycentric[k, corner] > 1 - 1e-9:
            vertex = mesh.faces[points.faces[k], corner]
            rows = np.unique(mesh.uv_faces[mesh.faces == vertex])
            result[k] = pixels[rows[pixels[rows, 1].argmin()]]
    return result


def askew_texture(image: np.ndarray, pixels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A texture and points on it, turned, scaled and shifted a little."""
    middle = tuple(np.array(image.shape[1::-1]) / 2)
    matrix = cv2.getRotationMatrix2D(middle, float(rng.normal(0, 3)), float(np.exp(rng.normal(0, 0.05))))
    matrix[:, 2] += rng.normal(0, 0.015 * UV_SIZE, 2)
    warped = cv2.warpAffine(image, matrix, image.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    return warped, pixels @ matrix[:, :2].T + matrix[:, 2]


def rectangles(names, pixels: np.ndarray, side: float) -> dict[str, tuple[float, float, float, float]]:
    """Squares of `side` pixels around points."""
    corner = pixels - (side - 1) / 2
    return {name: (float(x), float(y), side, side) for name, (x, y) in zip(names, corner, strict=True)}


def weathered(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A picture from the front (H, W, 2) with what real scans have: pale or blotched or stubbly color, rough form.

    Every fourth has no color at all, so that a filter does not rely on it.
    """
    color, form = image[..., 0], image[..., 1]
    color = color.mean() + rng.uniform(0.4, 1.2) * (color - color.mean())
    if rng.random() < 0.25:
        color = np.full_like(color, color.mean())
    for fine, most in ((rng.uniform(10, 40), 0.15), (rng.uniform(2, 8), 0.06)):
        color = color + rng.uniform(0, most) * _noise(color.shape, fine, rng)
    stubble = np.clip(_noise(color.shape, 30.0, rng), 0, 1) * _noise(color.shape, 0.7, rng)
    color = color + rng.uniform(0, 0.08) * stubble
    form = form + rng.uniform(0, 0.05) * _noise(form.shape, rng.uniform(1, 5), rng)
    form = form + rng.uniform(0, 0.08) * _noise(form.shape, rng.uniform(10, 30), rng)
    return np.clip(np.stack([color, form], 2), 0, 1).astype(np.float32)


def _noise(shape: tuple[int, int], fine: float, rng: np.random.Generator) -> np.ndarray:
    """Smooth noise of unit deviation; `fine` is its length, pixels."""
    values = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), fine, borderType=cv2.BORDER_REFLECT)
    return values / values.std()
