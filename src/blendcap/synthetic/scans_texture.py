"""The texture of a raw scan: photographs from three sides, each lit as that camera saw it, laid side by side.

A triangle takes its color from the camera that sees it best. Where two cameras meet the light does not, and what no
camera sees well is smeared: the seams that a scanner leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from blendcap.data import Camera, Mesh
from blendcap.rendering import Light, face_camera, prepare, project, rasterize

YAWS = (0.0, 58.0, -58.0)  # degrees
SIZE = (800, 1000)  # pixels of a photograph
FAVOR = 0.25  # of the front camera: it has the better lens
BEHIND = 2.5  # mm, behind what a camera sees: hidden from it
GAIN, TINT, GRAIN = 0.07, 0.012, 2.0  # standard deviations: exposure, white balance, noise in 255ths
EVEN = 4  # rounds in which a triangle joins its neighbors


@dataclass(frozen=True, eq=False)
class Photograph:
    """One picture of the stage and how far behind what it shows a triangle may lie."""

    camera: Camera
    picture: np.ndarray
    depth: np.ndarray


def photograph(stage: Mesh, color: np.ndarray | None, rng: np.random.Generator) -> list[Photograph]:
    """Pictures of everything that stands before the scanner; `color` (V, 3) if the stage has no texture."""
    surface, taken = prepare(stage, color), []
    for yaw in YAWS:
        camera = face_camera(stage.vertices, SIZE, yaw=np.deg2rad(yaw))
        light = Light(key=tuple(rng.normal([0.4, 0.5, 0.9], 0.25)), strengths=(0.50, 0.34, 0.15, 0.58), gloss=0.15)
        picture = surface.picture(camera, SIZE, light=light, background=(0.20, 0.20, 0.21))
        gain = np.exp(rng.normal(scale=GAIN) + rng.normal(scale=TINT, size=3))
        noisy = picture * gain + rng.normal(scale=GRAIN, size=picture.shape)
        depth = rasterize(stage.vertices, stage.faces, camera, SIZE).depth
        taken.append(Photograph(camera, np.clip(np.round(noisy), 0, 255).astype(np.uint8), depth))
    return taken


def textured(vertices: np.ndarray, faces: np.ndarray, photographs: list[Photograph]) -> Mesh:
    """The mesh with an atlas of the photographs, each triangle in the one that sees it best."""
    scores = np.stack([_score(vertices, faces, photo) for photo in photographs])
    scores[0] += FAVOR
    chosen = _evened(scores, faces)
    width, height = SIZE
    count = len(photographs)
    pixels = np.stack([project(vertices, photo.camera)[0] for photo in photographs])
    pixels = np.clip(pixels, 0, np.array(SIZE) - 1) + 0.5
    uv = pixels / [count * width, height]
    uv[..., 0] += (np.arange(count) / count)[:, None]
    uv[..., 1] = 1 - uv[..., 1]
    used, uv_faces = np.unique(faces + len(vertices) * chosen[:, None], return_inverse=True)
    atlas = np.concatenate([photo.picture for photo in photographs], axis=1)
    return Mesh(vertices, faces, uv=uv.reshape(-1, 2)[used], uv_faces=uv_faces.reshape(-1, 3), texture=atlas)


def _score(vertices: np.ndarray, faces: np.ndarray, photo: Photograph) -> np.ndarray:
    """How squarely a camera sees each triangle (F,): 1 at best, below 0 from behind or where something hides it."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sight = photo.camera.position - corners.mean(1)
    scale = np.linalg.norm(normals, axis=1) * np.linalg.norm(sight, axis=1)
    cosine = (normals * sight).sum(1) / np.maximum(scale, 1e-30)
    pixels, depth = project(vertices, photo.camera)
    column, row = np.clip(np.round(pixels), 0, np.array(SIZE) - 1).astype(np.int64).T
    hidden = depth - photo.depth[row, column] > BEHIND
    return cosine - hidden[faces].mean(1)


def _evened(scores: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The best camera of each triangle (F,), where neighbors have a say: no speckles."""
    incidence = csr_matrix((np.ones(faces.size), (np.repeat(np.arange(len(faces)), 3), faces.ravel())))
    degree = np.maximum(np.asarray(incidence.sum(0)).ravel(), 1)
    for _ in range(EVEN):
        around = (incidence @ ((incidence.T @ scores.T) / degree[:, None])).T / 3
        scores = np.where(scores < -0.5, scores, around)  # hidden stays hidden
    return scores.argmax(0)
