"""Where the face of a scan is: how large, which way up and which way it looks."""

from __future__ import annotations

from itertools import permutations, product
from typing import NamedTuple

import cv2
import numpy as np

from blendcap.data import LandmarkModel, Mesh
from blendcap.modeling.detection import log_odds, score_map
from blendcap.modeling.frontal import DISTANCE, MIDDLE, Frontal, frontal

FACE_SIZE, FACE_PIXEL = 128, 3.2  # of the pictures that the filter for whole faces knows: pixels, mm
WHOLE = 384  # pixels, of the picture that shows all of the scan
STEP = 3  # pixels between the places that are looked at
SCALES = 64 * 1.13 ** np.arange(15)  # sizes that it is shrunk to, pixels


class FacePlace(NamedTuple):
    """A similarity (4, 4) from the scan to the average face, mm, and the log-odds that a face is there."""

    place: np.ndarray
    odds: float


def search_face(mesh: Mesh, model: LandmarkModel) -> FacePlace:
    """Look for the face as the scan stands (+z forward, +y up); if there is none, from all sides and any way up."""
    textured = model.channels > 1
    best = _best_in(mesh, model, np.eye(3), textured)
    if best.odds > 0:
        return best
    others = [_best_in(mesh, model, turn, textured, SCALES[::2], 2 * STEP) for turn in _turns()]
    return max([best, *others], key=lambda found: found.odds)


def _best_in(
    mesh: Mesh, model: LandmarkModel, turn: np.ndarray, textured: bool, scales=SCALES, step: int = STEP
) -> FacePlace:
    """The best place for a face, seen along one direction, at all sizes."""
    place = _framing(mesh.vertices, turn)
    view = frontal(mesh, place, WHOLE, FACE_PIXEL, textured)
    best = FacePlace(place, -np.inf)
    for size in np.round(scales).astype(int):
        image = cv2.resize(view.image, (size, size), interpolation=cv2.INTER_AREA)
        pixels, scores = score_map(np.atleast_3d(image), model, step)
        odds = log_odds(scores[:, 0, 0], model.good[0], model.bad[0])
        top = scores[:, 0, 0].argmax()
        if odds[top] > best.odds:
            best = FacePlace(_onto_face(view, place, pixels[top], size, model), float(odds[top]))
    return best


def _framing(vertices: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """The similarity (4, 4) that turns the scan and makes it fill the picture."""
    turned = vertices @ turn.T
    low, high = turned.min(0), turned.max(0)
    scale = 0.96 * WHOLE * FACE_PIXEL / max(float((high - low)[:2].max()), 1e-12)
    place = np.eye(4)
    place[:3, :3] = scale * turn
    place[:3, 3] = MIDDLE - scale * (low + high) / 2
    return place


def _onto_face(view: Frontal, place: np.ndarray, pixel: np.ndarray, size: int, model: LandmarkModel) -> np.ndarray:
    """`place`, shrunk and moved so that what is seen at a pixel of the shrunk picture comes to the face's middle."""
    at = (pixel + 0.5) * WHOLE / size - 0.5
    off = (at - (WHOLE - 1) / 2) * FACE_PIXEL * [1, -1]
    column, row = np.clip(np.round(at).astype(int), 0, WHOLE - 1)
    depth = view.fragments.depth[row, column]
    depth = np.nanmedian(np.where(np.isfinite(view.fragments.depth), view.fragments.depth, np.nan)) \
        if not np.isfinite(depth) else depth  # fmt: skip
    point = np.array([MIDDLE[0] + off[0], MIDDLE[1] + off[1], MIDDLE[2] + DISTANCE - depth])
    shrink = size / WHOLE
    target = MIDDLE if model.places is None else model.places[0]
    moved = np.eye(4)
    moved[:3, :3] *= shrink
    moved[:3, 3] = target - shrink * point
    return moved @ place


def _turns() -> list[np.ndarray]:
    """The rotations (23) that carry axes onto axes, without the identity."""
    turns = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[range(3), order] = signs
        if np.linalg.det(turn) > 0 and not np.array_equal(turn, np.eye(3)):
            turns.append(turn)
    return turns
