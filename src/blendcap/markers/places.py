"""Where markers sit on a face, found from the shape of their cloud alone.

The neutral cloud is laid on the front of the face from sixty rotations that cover all of space, each settling by
trimmed point-to-plane alignment; the best one by distance, by agreement of the normals and by plausible size and place
wins. Labels are not read. After Besl and McKay (1992), doi:10.1109/34.121791, and Chen and Medioni (1992),
doi:10.1016/0262-8856(92)90066-C.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from blendcap.data import InputError, MarkerTake, Rig, SurfacePoints
from blendcap.markers.cleaning import drop_unlabeled, neutral_frame
from blendcap.markers.front import Front, front_of
from blendcap.markers.neighbors import project_on
from blendcap.numerics.similarity import apply

log = logging.getLogger(__name__)

_FEWEST = 8  # markers; fewer fit a face almost anywhere
_SIGMA = 2.0  # mm: how far a marker's distance from the skin may be trusted
_SIZES = 0.08  # how much faces differ in size, as a standard deviation of its logarithm
_SHIFT = 25.0  # mm: how far the middle of a marker set lies from the middle of the face's motion
_HEIGHTS = (0.0, 35.0, -35.0)  # mm: where starts stand beside the middle, for sets on a part of the face
_SLIDE = 0.1  # weight of a distance along the skin beside one across it
_DIFFERENT = 15.0  # mm between two answers that are not the same one


@dataclass(frozen=True, eq=False)
class Placement:
    """One way to lay a marker cloud on the face.

    Parameters
    ----------
    rotation, translation, scale
        `rig = scale * rotation @ take + translation`, mm.
    positions : (M, 3) float64
        The markers in the rig's space, mm; NaN where the neutral had none.
    cost : float
        Lower is better: about 0.3 for each marker where the fit is right.
    """

    rotation: np.ndarray
    translation: np.ndarray
    scale: float
    positions: np.ndarray
    cost: float


def find_places(rig: Rig, take: MarkerTake, *, frame: int = 0) -> SurfacePoints:
    """Places on the rig for the markers of a take, without correspondences.

    Works on clouds of a whole face or a good part of it, in any position; expect 5 mm, and 10 mm on a face that
    differs much from the rig. A warning is logged where a different answer fits almost as well. Show the result to
    somebody before it is trusted.

    Parameters
    ----------
    frame : int
        First frame of the neutral (see `neutral_frame`).

    Returns
    -------
    SurfacePoints
        By marker name, for the labeled markers that the neutral sees.

    Raises
    ------
    InputError
        If no marker is labeled, or the neutral sees fewer than eight.
    """
    take = drop_unlabeled(take)
    neutral = neutral_frame(take, frame)
    front = front_of(rig)
    found = lay_on(front, neutral)
    if len(found) > 1 and (sureness := confidence(found)) < 0.1:
        log.warning(
            "The markers fit the face in two ways almost equally well (confidence %.2f): check their places in the "
            "picture, or give correspondences.", sureness,
        )  # fmt: skip
    positions = found[0].positions
    seen = np.flatnonzero(np.isfinite(positions[:, 0]))
    faces, barycentric = _closest(rig, front, positions[seen])
    return SurfacePoints(tuple(take.names[i] for i in seen), faces, barycentric)


def confidence(placements: list[Placement]) -> float:
    """How much worse the second answer is than the first: 0 if they tie, toward 1 if there is no rival."""
    return 1.0 - placements[0].cost / placements[1].cost if len(placements) > 1 else 1.0


def lay_on(front: Front, neutral: np.ndarray) -> list[Placement]:
    """Ways to lay a neutral marker cloud (M, 3), mm, on the face: the best first, then others that differ from it.

    Raises
    ------
    InputError
        If fewer than eight markers are finite.
    """
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(neutral).all(1)
    if seen.sum() < _FEWEST:
        raise InputError(
            f"The neutral sees {seen.sum()} markers; at least {_FEWEST} are needed to find their places without "
            "correspondences. Give correspondences."
        )
    middle = neutral[seen].mean(0)
    cloud = neutral[seen] - middle
    rotations = Rotation.create_group("I").as_matrix()
    offsets = np.array([[0, y, 0] for y in _HEIGHTS])
    state = (
        np.tile(rotations, (len(offsets), 1, 1)),
        np.repeat(front.middle + offsets, len(rotations), axis=0),
        np.zeros(len(rotations) * len(offsets)),
    )
    outward = _outward(cloud)
    width = 30.0
    for layer, rounds, survivors in ((front.thinned(4), 12, len(state[0])), (front, 30, 16)):
        best = np.argsort(_cost(layer, cloud, outward, state), kind="stable")[:survivors]
        state = tuple(part[best] for part in state)
        for _ in range(rounds):
            state = _step(layer, cloud, state, width)
            width = max(0.85 * width, 3.0)
    cost = _cost(front, cloud, outward, state)
    answers: list[Placement] = []
    for i in np.argsort(cost, kind="stable"):
        rotation, scale = state[0][i], float(np.exp(state[2][i]))
        translation = state[1][i] - scale * rotation @ middle
        positions = apply(neutral, rotation, translation, scale)
        if all(np.nanmean(np.linalg.norm(positions - a.positions, axis=1)) > _DIFFERENT for a in answers):
            answers.append(Placement(rotation, translation, scale, positions, float(cost[i])))
    return answers


def _step(front: Front, cloud, state, width: float):
    """One Gauss-Newton step of every start: rotation, translation and log scale.

    Distances count fully along the skin's normal and a little along the skin, less the farther a marker is off
    (Geman and McClure, `width`). Size and place are held by their priors.
    """
    from scipy.spatial.transform import Rotation

    rotation, translation, size = state
    arms, moved, nearest, distance = _meet(front, cloud, state)
    normals = front.normals[nearest]
    trust = (1 + (distance / width) ** 2) ** -2
    metric = normals[..., :, None] * normals[..., None, :] + _SLIDE * np.eye(3)
    turns = np.cross(np.eye(3), arms[..., None, :])  # (S, M, 3 axes, 3)
    shifts = np.broadcast_to(np.eye(3), turns.shape)
    jacobian = np.concatenate([turns, shifts, arms[..., None, :]], axis=-2)
    weighted = _by_start((trust[..., None, None] * jacobian) @ metric)
    matrix = weighted @ np.swapaxes(_by_start(jacobian), 1, 2)
    gradient = (weighted @ (moved - front.points[nearest]).reshape(len(size), -1, 1))[..., 0]
    hold = _SIGMA**2 * np.array([0, 0, 0, *[_SHIFT**-2] * 3, _SIZES**-2]) + 1e-6
    away = np.column_stack([np.zeros((len(size), 3)), translation - front.middle, size])
    step = -np.linalg.solve(matrix + np.diag(hold), (gradient + hold * away)[..., None])[..., 0]
    step[:, :3] *= np.minimum(1, 0.3 / np.maximum(np.linalg.norm(step[:, :3], axis=1, keepdims=True), 1e-12))
    turned = Rotation.from_rotvec(step[:, :3]).as_matrix() @ rotation
    return turned, translation + step[:, 3:6], size + np.clip(step[:, 6], -0.1, 0.1)


def _by_start(jacobian: np.ndarray) -> np.ndarray:
    """(S, M, 7, 3) as (S, 7, 3 M)."""
    return np.swapaxes(jacobian, 1, 2).reshape(len(jacobian), jacobian.shape[2], -1)


def _meet(front: Front, cloud, state):
    """The turned and scaled cloud about its middle, its place, the nearest point of the skin and its distance."""
    rotation, translation, size = state
    arms = np.exp(size)[:, None, None] * cloud @ np.swapaxes(rotation, 1, 2)
    moved = arms + translation[:, None]
    distance, nearest = front.tree.query(moved.reshape(-1, 3))
    return arms, moved, nearest.reshape(moved.shape[:2]), distance.reshape(moved.shape[:2])


def _cost(front: Front, cloud, outward, state) -> np.ndarray:
    """(S,): the trimmed distances, the disagreement of the normals and the priors of each start."""
    rotation, translation, size = state
    _, moved, nearest, distance = _meet(front, cloud, state)
    normals = front.normals[nearest]
    across = np.abs(((moved - front.points[nearest]) * normals).sum(-1))
    off = np.minimum((1 - _SLIDE) * across + _SLIDE * distance, 15.0) ** 2
    agreement = ((outward @ np.swapaxes(rotation, 1, 2)) * normals).sum(-1)
    fit = (off / (off + (1.5 * _SIGMA) ** 2)).sum(1) + 0.25 * (1 - agreement).sum(1)
    return fit + 0.5 * ((size / _SIZES) ** 2 + (((translation - front.middle) / _SHIFT) ** 2).sum(1))


def _outward(cloud: np.ndarray) -> np.ndarray:
    """Unit normals (M, 3) of the cloud, each from its nearest markers, pointing out of the sphere that fits all."""
    from scipy.spatial import KDTree

    sphere = np.linalg.lstsq(np.column_stack([2 * cloud, np.ones(len(cloud))]), (cloud**2).sum(1), rcond=None)[0]
    _, near = KDTree(cloud).query(cloud, k=min(9, len(cloud)))
    patches = cloud[near] - cloud[near].mean(1, keepdims=True)
    normals = np.linalg.svd(patches)[2][:, 2]
    return normals * np.where(((cloud - sphere[:3]) * normals).sum(1, keepdims=True) < 0, -1.0, 1.0)


def _closest(rig: Rig, front: Front, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The closest point of the skin, as faces (M,) and barycentric weights (M, 3)."""
    _, near = front.tree.query(positions, k=min(40, len(front.points)))
    faces = front.faces[near]
    triangles = rig.mesh.vertices[rig.mesh.faces[faces]]
    weights = project_on(triangles, positions[:, None])
    reached = np.einsum("mqc,mqck->mqk", weights, triangles)
    best = ((reached - positions[:, None]) ** 2).sum(-1).argmin(1)
    rows = np.arange(len(positions))
    return faces[rows, best], weights[rows, best]
