"""Lids slide over eyeballs, never through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUND = 0.1  # of the radius: how far from a sphere a piece of the eye may be and still count as an eyeball
ONE = 0.5  # of the radius: pieces whose centers are nearer are one eyeball
WAY = (0.5, 0.75, 1.0)  # weights of a shape at which the lids are looked at
NEAR, FAR = 1.0, 4.0  # mm above the eyeball: skin below the first is kept clear of it, above the second left alone


@dataclass(frozen=True, eq=False)
class Globe:
    """An eyeball.

    Parameters
    ----------
    vertices : (K,) int64
        Its vertices.
    center : (3,) float64
        mm.
    radius : float
        mm.
    """

    vertices: np.ndarray
    center: np.ndarray
    radius: float

    def height(self, points: np.ndarray) -> np.ndarray:
        """How far points (..., 3) are above the surface, mm."""
        return np.linalg.norm(points - self.center, axis=-1) - self.radius


def find_globes(vertices: np.ndarray, pieces: list[np.ndarray], eyes: np.ndarray) -> list[Globe]:
    """The eyeballs among the pieces that belong to the region of the eyes; nested shells become one."""
    found: list[Globe] = []
    for piece in pieces:
        globe = _fit(vertices, piece)
        if not np.isin(piece, eyes).all() or globe is None:
            continue
        twin = next((k for k, g in enumerate(found) if np.linalg.norm(g.center - globe.center) < ONE * g.radius), None)
        if twin is None:
            found.append(globe)
        else:
            joined = np.concatenate([found[twin].vertices, piece])
            found[twin] = _fit(vertices, joined) or found[twin]
    return found


def clearing_push(
    template: np.ndarray, template_delta: np.ndarray, rest: np.ndarray, delta: np.ndarray, globes: tuple[Globe, Globe]
) -> np.ndarray:
    """What the displacements (K, 3) of skin near an eyeball lack to stay as clear of it as in the template.

    Parameters
    ----------
    template, template_delta : (K, 3) float64
        Template skin at rest and what the shape adds, aligned to the new face.
    rest, delta : (K, 3) float64
        The same of the new face.
    globes : (Globe, Globe)
        The template's eyeball, aligned, and the new one.
    """
    old, new = globes
    push = np.zeros_like(delta)
    largest = np.zeros(len(delta))
    for weight in WAY:
        points = rest + weight * delta
        height = new.height(points)
        floor = np.minimum(old.height(template + weight * template_delta), new.height(rest))
        missing = (floor - height) * np.clip((FAR - height) / (FAR - NEAR), 0, 1) / weight
        outward = (points - new.center) / (height + new.radius)[:, None]
        worse = missing > largest
        push[worse] = missing[worse, None] * outward[worse]
        largest[worse] = missing[worse]
    return push


def shared_push(push: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """The pushes (V, 3) with both vertices of each meeting pair pushed alike, as the one that needs more."""
    shared = push.copy()
    size = np.linalg.norm(push, axis=1)
    more = pairs[np.arange(len(pairs)), size[pairs].argmax(1)]
    shared[pairs] = push[more, None]
    return shared


def _fit(vertices: np.ndarray, piece: np.ndarray) -> Globe | None:
    """The sphere through a piece, by linear least squares, if the piece is round."""
    points = vertices[piece]
    middle = points.mean(0)
    local = points - middle
    solution, _, rank, _ = np.linalg.lstsq(np.c_[2 * local, np.ones(len(local))], (local**2).sum(1), rcond=None)
    if rank < 4:
        return None
    center = solution[:3]
    radius = float(np.sqrt(solution[3] + center @ center))
    off = np.abs(np.linalg.norm(local - center, axis=1) - radius).max()
    return Globe(piece, middle + center, radius) if off <= ROUND * radius else None
