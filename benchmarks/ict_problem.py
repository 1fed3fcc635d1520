"""The benchmark problem: ICT-FaceKit shapes driven by a real performance, seen by 50 noisy markers."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

DATA = Path(os.environ.get("BLENDCAP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
SKIN = 9409  # vertices of the face
UNSEEN = ("PupilDilate", "cheekRaiser")  # no skin motion; nearly the same as cheekSquint
RIDGE, DUMMY_RIDGE, SPARSITY = 0.4, 0.04, 0.5  # mm²: Tikhonov of shapes and of dummies, L1 of shapes


@dataclass(frozen=True, eq=False)
class Problem:
    """`|y_t - B a_t|² + a'Γa + β|a|₁` as a Gram matrix and linear terms; shapes first, then the rigid unknowns."""

    gram: np.ndarray
    linear: np.ndarray
    basis: np.ndarray
    targets: np.ndarray
    weights: np.ndarray

    @property
    def shapes(self) -> int:
        """How many of the unknowns are shapes."""
        return self.weights.shape[1]


def ict_problem(
    shapes: int = 53, markers: int = 50, noise: float = 0.2, seed: int = 0, signed: bool = False
) -> Problem:
    """53 shapes of ICT-FaceKit, or up to 140 with half-splits and pair correctives, and six rigid motions.

    The rigid unknowns are twelve unsigned dummies of 5 mm and 3 degrees, or six `signed` ones.
    """
    rng = np.random.default_rng(seed)
    neutral, deltas, weights = _rig()
    if shapes > len(deltas):
        deltas, weights = _enlarge(neutral, deltas, weights, shapes, rng)
    moving = np.flatnonzero(np.linalg.norm(deltas[:53, :SKIN], axis=2).max(0) > 0.5)
    places = moving[_spread(neutral[moving], markers)]
    basis = deltas[:, places].reshape(len(deltas), -1).T
    rigid = _rigid(neutral[places])
    time = np.arange(len(weights))[:, None] / 30
    motion = 0.3 * np.sin(2 * np.pi * time / (7 + 3 * np.arange(6)) + np.arange(6))
    targets = weights @ basis.T + motion @ rigid.T + noise * rng.normal(size=(len(weights), 3 * markers))
    whole = np.hstack([basis, rigid] if signed else [basis, rigid, -rigid])
    dummies = whole.shape[1] - len(deltas)
    gram = whole.T @ whole + np.diag([RIDGE] * len(deltas) + [DUMMY_RIDGE] * dummies)
    linear = -targets @ whole + np.array([SPARSITY / 2] * len(deltas) + [0.0] * dummies)
    return Problem(gram, linear, whole, targets, weights)


def _rig():
    pack = np.load(DATA / "rigs" / "ict_facekit.npz", allow_pickle=False)
    names = [str(n) for n in pack["expression_names"]]
    kept = [i for i, n in enumerate(names) if not n.startswith(UNSEEN)]
    names = [names[i] for i in kept]
    parts = json.loads((DATA / "rigs" / "ict_arkit52_map.json").read_text())
    with open(DATA / "performances" / "alexdjulin_alex_rom_3.csv", newline="") as file:
        header, *lines = csv.reader(file)
    curves = np.clip(np.array(lines, float), 0, 1)
    weights = np.zeros((len(curves), len(names)))
    for arkit, shapes in parts.items():
        for shape in shapes:
            weights[:, names.index(shape)] = curves[:, header.index(arkit)]
    return 10.0 * pack["neutral"], 10.0 * pack["expression_deltas"][kept].astype(float), weights  # cm to mm


def _enlarge(neutral, deltas, weights, shapes, rng):
    """Left and right halves of shapes that have none, and correctives of pairs at a quarter of their size."""
    size = np.linalg.norm(deltas, axis=2)
    whole = np.argsort(np.abs((size * neutral[:, 0]).sum(1)) / size.sum(1))[:14]  # the least one-sided
    side = 1 / (1 + np.exp(-neutral[:, 0] / 8))[:, None]
    halves = np.concatenate([deltas[whole] * side, deltas[whole] * (1 - side)])
    pairs = np.argwhere(np.tri(len(deltas), k=-1))
    pairs = pairs[rng.permutation(len(pairs))[: shapes - len(deltas) - len(halves)]]
    extra, driven = [], []
    for i, j in pairs:
        both = np.sqrt(size[i] * size[j])[:, None] / max(size[i].max(), size[j].max())
        direction = rng.normal(size=3)
        lift = np.minimum(size[i], size[j])[:, None] * direction / np.linalg.norm(direction)
        extra.append(0.25 * ((deltas[i] - deltas[j]) * both + lift))
        driven.append(weights[:, i] * weights[:, j])
    deltas = np.concatenate([deltas, halves, np.array(extra)])
    return deltas, np.hstack([weights, np.zeros((len(weights), len(halves))), np.array(driven).T])


def _spread(points, count):
    """Farthest point sampling."""
    chosen, distance = [int(np.argmax(points[:, 2]))], np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, ((points - points[chosen[-1]]) ** 2).sum(1))
        chosen.append(int(np.argmax(distance)))
    return np.array(chosen)


def _rigid(points):
    """(3 M, 6) motion of points by 5 mm along and 3 degrees about each axis."""
    result = np.zeros((points.size, 6))
    for k, axis in enumerate(np.eye(3)):
        result[:, k] = np.tile(5 * axis, len(points))
        result[:, 3 + k] = np.cross(np.deg2rad(3) * axis, points - points.mean(0)).ravel()
    return result
