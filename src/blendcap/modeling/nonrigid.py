"""Algorithm 1 of the thesis: match, solve, repeat; then soften, and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blendcap.data import InputError
from blendcap.modeling.affine import AffineField
from blendcap.modeling.matching import ScanSurface
from blendcap.modeling.schedule import Schedule
from blendcap.modeling.template import Skin
from blendcap.numerics.anderson import Anderson
from blendcap.numerics.coarsening import coarse_basis
from blendcap.numerics.leastsq import Backend
from blendcap.numerics.surfaces import edges_of, turned_over, vertex_normals

TOUCHING = 100.0  # stiffness between places that touch, in that of an edge of median length
PATIENCE = 8  # steps of a level after which a match that is lost does not come back: in ears they come and go for ever
UNFOLD = 4  # times, at most, that matches are dropped because they fold the skin
FIRMER = 10.0  # stiffness of folded skin each time, of what it was before
FEW = 0.05  # share of the visible template that must find a match
HEAD = (
    4.75  # diagonal of a face's box over the root mean square distance from its centre: what stiffness is relative to
)


@dataclass(frozen=True)
class Level:
    """How one level of stiffness ended.

    Parameters
    ----------
    stiffness, landmarks : float
        alpha and beta.
    steps : int
        Steps made.
    converged : bool
        Whether it ended because the template stood still, and not at the most steps.
    change : float
        How far the last step moved the vertices, mm, root mean square.
    residual : float
        The relative residual of its last linear solve.
    matched : float
        The share of the skin with a match.
    """

    stiffness: float
    landmarks: float
    steps: int
    converged: bool
    change: float
    residual: float
    matched: float


@dataclass(frozen=True, eq=False)
class SkinFit:
    """The fitted skin (n, 3), mm; energies and levels as in `Registration`; distances (n,) with NaN without a match."""

    vertices: np.ndarray
    energies: dict[str, np.ndarray]
    levels: tuple[Level, ...]
    distance: np.ndarray
    backend: str


def fit_skin(
    start: np.ndarray, skin: Skin, surface: ScanSurface, sampling: Any, positions: np.ndarray, schedule: Schedule,
    backend: Backend, tell: Callable[..., None] | None,
) -> SkinFit:  # fmt: skip
    """Non-rigid ICP of the aligned skin `start` (n, 3), mm; `sampling` (L, n) takes it to the landmarks."""
    center = start.mean(0)
    size = HEAD * float(np.sqrt(((start - center) ** 2).sum(1).mean()))
    unit = (start - center) / size
    edges, joined = _edges(unit, skin, schedule.even)
    coarse = schedule.stiffness[0] >= schedule.coarse
    basis = coarse_basis(len(unit), edges, joined) if coarse else None
    field = AffineField(unit, edges, joined, sampling, backend, basis)
    held = (positions - center) / size
    match = _Matcher(skin, surface, schedule, center, size, unit)
    maps, levels, costs = field.identity, [], []
    for number, (alpha, beta) in enumerate(zip(schedule.stiffness, schedule.landmarks, strict=True)):
        if coarse and alpha < schedule.coarse:
            maps, field, coarse = field.maps(maps), AffineField(unit, edges, joined, sampling, backend), False
        maps, weights, targets, level = _settle(field, maps, match, alpha, beta, held, schedule, size)
        levels.append(level)
        costs.append(field.energies(maps, weights, targets, held))
        if tell is not None:
            tell(number + 1)
    for _ in range(UNFOLD):
        folds = match.drop_folds(field.moved(maps))
        if not folds.any():
            break
        joined = joined * np.where(folds[edges].all(1), FIRMER, 1.0)
        whole, field = field.maps(maps), AffineField(unit, edges, joined, sampling, backend)
        maps, weights, targets, level = _settle(field, whole, match, alpha, beta, held, schedule, size)
        levels[-1] = replace(level, steps=levels[-1].steps + level.steps)
        costs[-1] = field.energies(maps, weights, targets, held)
    fitted = field.moved(maps)
    weights, _ = match(fitted)
    vertices = fitted * size + center
    distance = np.where(weights > 0, surface.closest(vertices)[1], np.nan)
    energies = {term: size**2 * np.array([cost[term] for cost in costs]) for term in costs[0]}
    return SkinFit(vertices, energies, tuple(levels), distance, field.backend)


def _settle(field, maps, match, alpha, beta, held, schedule: Schedule, size: float):
    """One level: steps until the template stands still. The answer is a solve, never an extrapolation."""
    faster = Anderson(schedule.memory)
    step, change, before = 0, np.inf, np.ones(1)
    while True:
        weights, targets = match(field.moved(maps))
        if step >= PATIENCE:
            weights = np.minimum(weights, before)
        before = weights
        answer = field.solve(alpha, weights, targets, beta, held)
        motion = field.moved(answer) - field.moved(maps)
        change = float(np.sqrt((motion**2).sum(1).mean()))
        step += 1
        if change < schedule.tolerance or step >= schedule.steps:
            break
        maps = faster.step(answer, motion)
    level = Level(
        alpha, beta, step, change < schedule.tolerance, size * change, field.residual, float((weights > 0).mean())
    )
    return answer, weights, targets, level


class _Matcher:
    """Weights (n,) and targets (n, 3) of the data term, for vertices in the template's own scale."""

    def __init__(
        self, skin: Skin, surface: ScanSurface, schedule: Schedule, center: np.ndarray, size: float, start: np.ndarray
    ):
        self._skin, self._surface, self._schedule = skin, surface, schedule
        self._center, self._size = center, size
        self._folded_before = turned_over(start, skin.faces)
        self._fitted = skin.visible

    def __call__(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        placed, schedule = vertices * self._size + self._center, self._schedule
        find = self._surface.closest if schedule.triangles else self._surface.nearest_vertices
        points, distance, faces = find(placed)
        normals = vertex_normals(placed, self._skin.faces)
        good = self._fitted & self._surface.believable(
            faces, distance, normals, schedule.cosine, schedule.reach * self._size
        )
        if good.sum() < FEW * max(self._skin.visible.sum(), 1):
            raise InputError(
                f"Only {good.sum()} of {self._skin.visible.sum()} template vertices find a place on the scan within "
                f"{schedule.reach * self._size:.0f} mm that faces the same way; give landmarks, or turn its normals "
                "outwards."
            )
        return good.astype(np.float64), (points - self._center) / self._size

    def drop_folds(self, vertices: np.ndarray) -> np.ndarray:
        """(n,) triangles that came to lie folded over, and those around them, which are fitted no more."""
        faces = self._skin.faces
        folded = np.zeros(len(vertices), dtype=bool)
        folded[faces[turned_over(vertices, faces) & ~self._folded_before]] = True
        folded[faces[folded[faces].any(1)]] = True
        self._fitted = self._fitted & ~folded
        return folded


def _edges(vertices: np.ndarray, skin: Skin, even: bool) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2) and the weights (E,) of their squared differences; places that touch are joined like neighbours."""
    edges = edges_of(skin.faces)[0]
    if not even:
        return edges, np.ones(len(edges))
    typical = float(np.median(_lengths(vertices, edges)))
    edges = np.concatenate([edges, skin.walls])
    weights = (typical / np.maximum(_lengths(vertices, edges), 1e-2 * typical)) ** 2
    return np.concatenate([edges, skin.touching]), np.concatenate([weights, np.full(len(skin.touching), TOUCHING)])


def _lengths(vertices: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
