"""Errors on the face, from green over yellow to red."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from blendcap.data import Animation, InputError, Rig, SurfacePoints
from blendcap.io.images import write_image
from blendcap.numerics.easing import smoothstep
from blendcap.numerics.geodesic import sewn_vertices, surface_distances
from blendcap.rendering import Light, default_colors, prepare
from blendcap.view.image import draw_text
from blendcap.view.posing import VIEWS, side_by_side, weights_on

SCALE = np.array([[0.30, 0.66, 0.38], [0.96, 0.84, 0.36], [0.84, 0.20, 0.18]])  # sRGB: none, half, the largest
UNKNOWN = np.array([0.72, 0.73, 0.75])
REACH = 22.0  # mm along the surface over which a marker speaks for its surroundings
MATT = Light(strengths=(0.46, 0.26, 0.12, 0.56), gloss=0.03)  # a lit form must not be mistaken for an error


def write_heatmap(
    path: str | Path,
    rig: Rig,
    errors: np.ndarray,
    trust: np.ndarray | None = None,
    *,
    largest: float | None = None,
    size: tuple[int, int] = (1280, 720),
    yaws: Sequence[float] = VIEWS,
    title: str = "",
) -> None:
    """Write a PNG of the neutral face colored by errors (V,), mm; see `heatmap`."""
    write_image(path, heatmap(rig, errors, trust, largest=largest, size=size, yaws=yaws, title=title))


def heatmap(
    rig: Rig,
    errors: np.ndarray,
    trust: np.ndarray | None = None,
    *,
    largest: float | None = None,
    size: tuple[int, int] = (1280, 720),
    yaws: Sequence[float] = VIEWS,
    title: str = "",
) -> np.ndarray:
    """Picture (H, W, 3) uint8 of the neutral face colored by an error at each vertex, with a legend.

    Parameters
    ----------
    errors : (V,)
        mm; NaN (grey) where unknown.
    trust : (V,), optional
        0 (grey) to 1.
    largest : float, optional
        mm, of the reddest red; the 99th percentile of the errors if not given, but at least 1 mm: an even, small
        error is green.
    """
    if len(errors) != len(rig.mesh.vertices):
        raise InputError(f"There are {len(errors)} errors for {len(rig.mesh.vertices)} vertices; give one for each.")
    known = errors[np.isfinite(errors)]
    if largest is None:
        largest = max(float(f"{np.percentile(known, 99) if len(known) else 0:.2g}"), 1.0)
    colors, own = heat_colors(errors, largest), default_colors(rig)
    if trust is not None:
        colors = UNKNOWN + trust[:, None] * (colors - UNKNOWN)
    if own is not None:
        colors[np.isnan(own).any(1)] = np.nan
    surface = prepare(rig.mesh, colors)
    picture = np.hstack([surface.picture(camera, part, light=MATT) for camera, part in side_by_side(rig, size, yaws)])
    _legend(picture, largest, title)
    return picture


def heat_colors(errors: np.ndarray, largest: float) -> np.ndarray:
    """Colors (..., 3), sRGB 0 to 1, of errors from 0, green, to `largest`, red; grey where they are NaN."""
    place = np.clip(np.nan_to_num(errors) / largest, 0, 1) * (len(SCALE) - 1)
    colors = np.stack([np.interp(place, np.arange(len(SCALE)), channel) for channel in SCALE.T], -1)
    return np.where(np.isnan(errors)[..., None], UNKNOWN, colors)


def marker_heat(rig: Rig, points: SurfacePoints, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of markers (M,), mm, spread to the vertices (V,), and how far to trust that (V,), 0 to 1.

    Along the surface, not through the air: a marker on the upper lip says nothing about the lower.
    """
    known = np.flatnonzero(np.isfinite(errors))
    count = len(rig.mesh.vertices)
    if not len(known):
        return np.full(count, np.nan), np.zeros(count)
    sewn = sewn_vertices(rig.mesh.vertices, rig.deltas)
    corners = sewn[rig.mesh.faces[points.faces[known], points.barycentric[known].argmax(1)]]
    distances = surface_distances(rig.mesh.vertices, sewn[rig.mesh.faces], corners, 2.5 * REACH)[:, sewn]
    nearest = distances.min(0)
    near = np.isfinite(nearest)
    weights = np.exp(0.5 * (nearest[near] ** 2 - distances[:, near] ** 2) / (REACH / 2.2) ** 2)  # the nearest counts 1
    spread = np.full(count, np.nan)
    spread[near] = errors[known] @ weights / weights.sum(0)
    return spread, smoothstep(0, 1, (1.5 * REACH - np.where(near, nearest, np.inf)) / (0.7 * REACH))


def vertex_error(answer: Animation, truth: Animation, rig: Rig) -> np.ndarray:
    """Root mean square distance over time (V,), mm, of each vertex under two animations of the same length.

    Computed from the second moment of the weights' difference, so its cost does not grow with the number of frames.
    """
    if len(answer.weights) != len(truth.weights):
        raise InputError(f"The animations have {len(answer.weights)} and {len(truth.weights)} frames; cut them alike.")
    difference = weights_on(rig, answer) - weights_on(rig, truth)
    values, vectors = np.linalg.eigh(difference.T @ difference / len(difference))
    roots = (vectors * np.sqrt(np.maximum(values, 0))).T[values > 1e-12 * max(values.max(), 1e-300)]
    squares = np.zeros(len(rig.mesh.vertices))
    flat = rig.deltas.reshape(len(rig.names), -1)
    for root in roots:
        squares += ((root.astype(np.float32) @ flat).reshape(-1, 3).astype(np.float64) ** 2).sum(1)
    return np.sqrt(squares)


def _legend(picture: np.ndarray, largest: float, title: str) -> None:
    height, width = picture.shape[:2]
    letters, border, thick = max(height // 42, 9), height // 30, max(height // 50, 6)
    long, top = width // 4, height - border - thick
    ramp = heat_colors(np.linspace(0, largest, long), largest)
    left = width - border - long
    picture[top : top + thick, left : left + long] = np.round(255 * ramp).astype(np.uint8)
    for value, at, anchor in ((0, left, "ls"), (largest / 2, left + long // 2, "ms"), (largest, left + long, "rs")):
        draw_text(
            picture,
            f"{value:.3g}" + (" mm" if value == largest else ""),
            (at, top - letters // 3),
            height=letters,
            anchor=anchor,
        )
    draw_text(picture, title, (border, height - border), height=letters, anchor="ls")
