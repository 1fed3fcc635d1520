"""A template comes to a scan as a whole by its shape, where nobody gives landmarks."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError
from blendcap.modeling.matching import ScanSurface
from blendcap.numerics.similarity import align, apply
from blendcap.numerics.surfaces import vertex_normals

Similarity = tuple[np.ndarray, np.ndarray, np.ndarray]

SAMPLES = 1500
KEPT = 0.8  # share of the matches that count, the nearest ones
COSINE = 0.5
STILL = 1e-4  # of the template's size: smaller steps end the iteration
STEPS = 60


def align_by_shape(vertices: np.ndarray, faces: np.ndarray, visible: np.ndarray, surface: ScanSurface) -> Similarity:
    """The similarity from a template (V, 3) to a scan that looks the same way: trimmed ICP from several starts.

    Raises
    ------
    InputError
        If from no start enough of the template finds the scan.
    """
    normals, size = vertex_normals(vertices, faces), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    rows = np.flatnonzero(visible)
    rows = rows[:: max(1, len(rows) // SAMPLES)]
    tries = [icp(vertices[rows], normals[rows], surface, start) for start in _starts(vertices[visible], surface)]
    similarity, misfit = min(tries, key=lambda answer: answer[1])
    if not misfit < 0.05 * size * float(similarity[2]):
        raise InputError(
            "The template does not find the scan by shape alone; give landmarks, or turn the scan so that it looks "
            "along +z with +y up."
        )
    return similarity


def icp(points: np.ndarray, normals: np.ndarray, surface: ScanSurface, start: Similarity) -> tuple[Similarity, float]:
    """Trimmed iterative closest points with compatible normals.

    Parameters
    ----------
    points, normals : (n, 3) float64
        Of the template.
    surface : ScanSurface
    start : similarity
        Rotation, translation and scale to begin with.

    Returns
    -------
    similarity
    misfit : float
        The root mean square distance of the matches that count, mm; infinite if there were too few.
    """
    similarity, size, misfit = start, float(np.linalg.norm(np.ptp(points, axis=0))), np.inf
    for _ in range(STEPS):
        placed = apply(points, *similarity)
        targets, distance, faces = surface.closest(placed)
        good = surface.believable(faces, distance, normals @ similarity[0].T, COSINE, np.inf)
        if good.sum() < 0.2 * len(points):
            return similarity, np.inf
        limit = np.quantile(distance[good], KEPT)
        kept = good & (distance <= limit)
        misfit = float(np.sqrt((distance[kept] ** 2).mean()))
        better = align(points[kept], targets[kept])
        moved = np.linalg.norm(apply(points, *better) - placed, axis=1).max()
        similarity = better
        if moved < STILL * size:
            break
    return similarity, misfit


def _starts(vertices: np.ndarray, surface: ScanSurface) -> list[Similarity]:
    """Upright, at the scan's own scale and at the ratio of the sizes: box on box, and nose on nose."""
    there = surface.vertices
    sizes = np.linalg.norm(np.ptp(there, axis=0)) / np.linalg.norm(np.ptp(vertices, axis=0))
    scales = [1.0] if 0.5 < sizes < 2 else []
    width = np.ptp(there[:, 0]) / max(float(np.ptp(vertices[:, 0])), 1e-12)
    anchors = [(_middle(vertices), _middle(there)), (_nose(vertices), _nose(there))]
    return [
        (np.eye(3), to - scale * source, np.asarray(scale)) for scale in sorted({*scales, float(sizes), float(width)})
        for source, to in anchors
    ]  # fmt: skip


def _middle(vertices: np.ndarray) -> np.ndarray:
    return (vertices.min(0) + vertices.max(0)) / 2


def _nose(vertices: np.ndarray) -> np.ndarray:
    """The foremost point of the middle third."""
    low, high = vertices.min(0), vertices.max(0)
    central = np.abs(vertices[:, 0] - (low[0] + high[0]) / 2) < (high[0] - low[0]) / 6
    rows = np.flatnonzero(central) if central.any() else np.arange(len(vertices))
    return vertices[rows[np.argmax(vertices[rows, 2])]]
