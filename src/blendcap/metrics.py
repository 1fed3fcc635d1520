"""How far an animation is from the truth on a rig: errors by region, blinks, gaps, smoothness, sparsity.

Errors of vertices come from the Gram matrix of the deltas, so that their cost does not depend on the number of
vertices: with z the weights and G = D D', the mean squared error of a frame is z' G z / K over K vertices.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from scipy.signal import find_peaks

from blendcap.data import Animation, InputError, Rig
from blendcap.data.anatomy import inside_vertices
from blendcap.data.names import canonical

ACTIVE = 0.02  # a weight above this counts as used
BLINK_WIDTH = 0.5  # seconds, at half height; longer is a closed eye, not a blink
BLINK_REACH = 0.35  # seconds on both sides of the peak
BLINK_HEIGHT = 0.25  # of the lid's full travel


@dataclass(frozen=True)
class Metrics:
    """An answer judged against the truth. NaN where a rig or a take has nothing to judge by.

    Parameters
    ----------
    frames : int
    vertex_rmse_mm : float
        Root of the mean squared distance over the moving face in each frame, averaged over frames. The face is what
        any shape moves by more than 0.5 mm, without eyes, teeth, tongue, lashes and the inside of the mouth where
        the names of the rig's regions tell them.
    by_region_mm : {region: float}
        The same over the moving vertices of each region.
    weight_mae : float
        Mean absolute difference of the weights.
    sparsity, sparsity_truth : float
        Weights above 0.02 in a frame, on average.
    roughness, roughness_truth, roughness_ratio : float
        Mean squared second difference of the weights over time, and answer / truth.
    blink_gain : float
        Slope of the regression of the answered on the true lid travel around true blinks, mean of sides; 1 is right.
    blinks : int
        True blinks found, both sides together.
    lid_gap_error_mm, lip_gap_error_mm : float
        Mean absolute error of the opening of lids and lips.
    leak : float
        Part of the true difference between left and right that the answer lacks, as it gave it to both sides; 0 is
        right, below 0 the sides differ more than they did.
    """

    frames: int
    vertex_rmse_mm: float
    by_region_mm: dict[str, float]
    weight_mae: float
    sparsity: float
    sparsity_truth: float
    roughness: float
    roughness_truth: float
    roughness_ratio: float
    blink_gain: float
    blinks: int
    lid_gap_error_mm: float
    lip_gap_error_mm: float
    leak: float

    def as_dict(self) -> dict:
        """For JSON: plain numbers, None for NaN."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def evaluate(answer: Animation, truth: Animation, rig: Rig, *, truth_rig: Rig | None = None) -> Metrics:
    """Judge an animation of a rig.

    Parameters
    ----------
    answer : Animation
        Shapes by name; those that it lacks are 0.
    truth : Animation
        As many frames at the same rate.
    rig : Rig
        That of the answer, and of the truth unless `truth_rig` is given.
    truth_rig : Rig, optional
        What really moved, on the same vertices: a performer who is not the rig. Vertices, lids and lips are then
        compared between the two rigs, neutral faces included.

    Returns
    -------
    metrics : Metrics
        Lengths in mm.

    Raises
    ------
    InputError
        If lengths, rates or vertices differ, a shape is unknown or a weight is NaN.
    """
    _check(answer, truth, rig, truth_rig)
    true_rig = rig if truth_rig is None else truth_rig
    answered, true = _weights(answer, rig, "answer"), _weights(truth, true_rig, "truth")
    true_on_rig = _weights(truth, rig, "truth", known=true_rig)
    moving = rig.moving_vertices()
    face = moving[~inside_vertices(rig)[moving]]
    errors = {name: _rmse(rig, true_rig, answered, true, np.intersect1d(vertices, moving))
              for name, vertices in rig.regions.items()}  # fmt: skip
    roughness, roughness_truth = _roughness(answered), _roughness(true_on_rig)
    gain, blinks = _blink_gain(rig, true_rig, answered, true, truth.rate)
    return Metrics(
        frames=len(answered),
        vertex_rmse_mm=_rmse(rig, true_rig, answered, true, face),
        by_region_mm={name: error for name, error in errors.items() if not np.isnan(error)},
        weight_mae=float(np.abs(answered - true_on_rig).mean()),
        sparsity=float((answered > ACTIVE).sum(1).mean()),
        sparsity_truth=float((true_on_rig > ACTIVE).sum(1).mean()),
        roughness=roughness,
        roughness_truth=roughness_truth,
        roughness_ratio=roughness / roughness_truth if roughness_truth > 0 else float("nan"),
        blink_gain=gain,
        blinks=blinks,
        lid_gap_error_mm=_gap_error(rig, true_rig, answered, true, ("lids_left", "lids_right")),
        lip_gap_error_mm=_gap_error(rig, true_rig, answered, true, ("lips",)),
        leak=_leak(rig, answered, true_on_rig),
    )


def _check(answer: Animation, truth: Animation, rig: Rig, truth_rig: Rig | None) -> None:
    if len(answer.weights) != len(truth.weights):
        raise InputError(
            f"The answer has {len(answer.weights)} frames, but the truth has {len(truth.weights)}; "
            "cut or resample one so that they show the same frames."
        )
    if abs(answer.rate - truth.rate) > 1e-3 * truth.rate:
        raise InputError(
            f"The answer runs at {answer.rate:g} frames a second, but the truth at {truth.rate:g}; resample one."
        )
    if truth_rig is not None and len(truth_rig.mesh.vertices) != len(rig.mesh.vertices):
        raise InputError(
            f"The rig has {len(rig.mesh.vertices)} vertices, but the rig of the truth has "
            f"{len(truth_rig.mesh.vertices)}; they must share their vertices to be compared."
        )


def _weights(animation: Animation, rig: Rig, what: str, known: Rig | None = None) -> np.ndarray:
    """(T, N) by the rig's names, 0 where the animation has none; its names must be on `known`, the rig if not given."""
    unknown = [n for n in animation.names if n not in (known or rig).names]
    if unknown:
        raise InputError(
            f"The {what} has a shape {unknown[0]!r} that the rig {rig.name!r} lacks; rename or "
            "remove it, or write it in the rig's shapes first: blendcap convert IN OUT --rig RIG."
        )
    if np.isnan(animation.weights).any():
        frame, shape = np.argwhere(np.isnan(animation.weights))[0]
        raise InputError(
            f"The {what} has no weight for {animation.names[shape]!r} in frame {frame}; fill or cut the gap."
        )
    column = {name: i for i, name in enumerate(animation.names)}
    weights = np.zeros((len(animation.weights), len(rig.names)))
    shared = [i for i, name in enumerate(rig.names) if name in column]
    weights[:, shared] = animation.weights[:, [column[rig.names[i]] for i in shared]]
    return weights


def _rmse(rig: Rig, true_rig: Rig, answered, true, vertices) -> float:
    if not len(vertices):
        return float("nan")
    if rig is true_rig:
        shapes, z = rig.deltas[:, vertices], answered - true
    else:
        apart = (rig.mesh.vertices - true_rig.mesh.vertices)[None, vertices]
        shapes = np.concatenate([rig.deltas[:, vertices], -true_rig.deltas[:, vertices], apart])
        z = np.concatenate([answered, true, np.ones((len(true), 1))], axis=1)
    flat = shapes.reshape(len(shapes), -1).astype(np.float64)
    squared = np.einsum("ti,ij,tj->t", z, flat @ flat.T, z, optimize=True) / len(vertices)
    return float(np.sqrt(np.maximum(squared, 0)).mean())


def _roughness(weights: np.ndarray) -> float:
    return float((np.diff(weights, n=2, axis=0) ** 2).mean()) if len(weights) > 2 else float("nan")


def _blink_gain(rig: Rig, true_rig: Rig, answered, true, rate: float) -> tuple[float, int]:
    gains, blinks = [], 0
    for name in rig.names:
        if canonical(name) not in ("eyeBlinkLeft", "eyeBlinkRight") or name not in true_rig.names:
            continue
        answered_travel, true_travel = _lid_travel(rig, name, rig, answered), _lid_travel(rig, name, true_rig, true)
        full = np.linalg.norm(_lid_direction(rig, name)[1])
        peaks = find_peaks(true_travel, prominence=BLINK_HEIGHT * full, width=(None, BLINK_WIDTH * rate))[0]
        slopes = []
        for peak in peaks:
            window = slice(max(0, peak - round(BLINK_REACH * rate)), peak + round(BLINK_REACH * rate) + 1)
            a, b = true_travel[window], answered_travel[window]
            slopes.append(((a - a.mean()) @ (b - b.mean())) / ((a - a.mean()) @ (a - a.mean())))
        blinks += len(slopes)
        if slopes:
            gains.append(np.mean(slopes))
    return (float(np.mean(gains)) if gains else float("nan")), blinks


def _lid_direction(rig: Rig, blink: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of the lid that a blink shape moves most, and their mean motion (3,), mm."""
    delta = rig.deltas[rig.index(blink)]
    length = np.linalg.norm(delta, axis=1)
    lid = np.flatnonzero(length >= 0.5 * length.max())
    return lid, delta[lid].mean(0)


def _lid_travel(rig: Rig, blink: str, moved: Rig, weights) -> np.ndarray:
    """(T,) how far the lid has travelled in the direction of the rig's blink, mm."""
    lid, direction = _lid_direction(rig, blink)
    along = direction / (np.linalg.norm(direction) + 1e-12)
    return weights @ (moved.deltas[:, lid].mean(1) @ along).astype(np.float64)


def _gap_error(rig: Rig, true_rig: Rig, answered, true, contacts: tuple[str, ...]) -> float:
    errors = [np.abs(_gap(rig, answered, rig.contacts[name]) - _gap(true_rig, true, rig.contacts[name])).mean()
              for name in contacts if len(rig.contacts.get(name, ()))]  # fmt: skip
    return float(np.mean(errors)) if errors else float("nan")


def _gap(rig: Rig, weights, pairs) -> np.ndarray:
    """(T,) mean distance of the pairs that meet when closed, mm."""
    rest = rig.mesh.vertices[pairs[:, 0]] - rig.mesh.vertices[pairs[:, 1]]
    deltas = (rig.deltas[:, pairs[:, 0]] - rig.deltas[:, pairs[:, 1]]).astype(np.float64)
    return np.linalg.norm(rest + np.tensordot(weights, deltas, axes=1), axis=2).mean(1)


def _leak(rig: Rig, answered, true) -> float:
    """1 - slope of the answered on the true difference between left and right, each pair by what it moves."""
    left = np.flatnonzero(rig.mirror > np.arange(len(rig.names)))
    if not len(left):
        return float("nan")
    right = rig.mirror[left]
    size = np.linalg.norm(rig.deltas[left].reshape(len(left), -1), axis=1).astype(np.float64)
    difference, true_difference = (size * (w[:, left] - w[:, right]) for w in (answered, true))
    energy = (true_difference**2).sum()
    return float(1 - (difference * true_difference).sum() / energy) if energy > 0 else float("nan")


def _plain(value):
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    return None if isinstance(value, float) and np.isnan(value) else value
