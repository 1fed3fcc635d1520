"""A template is laid onto a scan: optimal-step non-rigid ICP, with a certificate for every level of stiffness."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.modeling.alignment import align_by_shape
from blendcap.modeling.landmark_checks import check_landmarks
from blendcap.modeling.matching import ScanSurface
from blendcap.modeling.nonrigid import Level, fit_skin
from blendcap.modeling.schedule import Schedule, schedule_of
from blendcap.modeling.template import carry, find_skin
from blendcap.numerics.leastsq import Backend
from blendcap.numerics.similarity import align, apply
from blendcap.numerics.surfaces import turned_over


@dataclass(frozen=True, eq=False)
class Registration:
    """A template in the shape of a scan.

    Parameters
    ----------
    mesh : Mesh
        The template's vertices, in its order, at the scan's place.
    energies : {term: (K,) float64}
        What the data, the stiffness and the landmarks cost at the end of each level, mm²; without alpha and beta.
    levels : tuple of Level
        One for each stiffness: the certificate.
    distance : (V,) float64
        From each vertex to the scan, mm; NaN where the template has no counterpart in it (inside, holes, beyond its
        border, carried parts, matches that folded the skin and were dropped).
    flipped : (K,) int64
        Faces that are folded over and were not in the template.
    alignment : (rotation (3, 3), translation (3,), scale)
        The similarity from the template to the scan that it started from.
    backend : str
        The sparse solver.
    """

    mesh: Mesh
    energies: Mapping[str, np.ndarray]
    levels: tuple[Level, ...]
    distance: np.ndarray
    flipped: np.ndarray
    alignment: tuple[np.ndarray, np.ndarray, np.ndarray]
    backend: str


def register(
    template: Mesh | Rig,
    scan: Mesh,
    landmarks: tuple[SurfacePoints, np.ndarray] | None = None,
    *,
    free: ArrayLike | None = None,
    method: str | Schedule = "even",
    backend: Backend = "auto",
    tell: Callable[..., None] | None = None,
) -> Registration:
    """Lay a template onto a scan by optimal-step non-rigid ICP.

    Thesis, section 3.2.3, Eqs. 2 to 7 and Algorithm 1, after Amberg, Romdhani and Vetter (2007), "Optimal step nonrigid
    ICP algorithms for surface registration", CVPR, doi:10.1109/CVPR.2007.383165. Holes of the scan, its borders, and
    what no scanner sees follow by stiffness; parts not connected to the skin are carried along.

    Parameters
    ----------
    template : Mesh or Rig
        Its neutral is laid onto the scan. A rig tells seams of the texture from lips that touch.
    scan : Mesh
        Any triangles, mm, normals outwards.
    landmarks : (SurfacePoints (L), (L, 3) float64), optional
        Points on the template and where they are on the scan, mm; a NaN row is left out. Without landmarks the
        template is aligned by its shape, which needs the two to look the same way.
    free : (K,) int, optional
        Vertices of the template that are not drawn to the scan but follow by stiffness, as lids where the scan's eyes
        are shut.
    method : {"even", "paper"} or Schedule
        "even" weighs edges by length and accelerates every level; "paper" is the plain schedule.
    backend : {"auto", "cholmod", "splu"}
        The sparse solver.
    tell : callable, optional
        Called with the number of levels done.

    Returns
    -------
    Registration

    Raises
    ------
    InputError
        If the two are too far apart to match, or the landmarks do not fit the template.
    """
    schedule = schedule_of(method)
    mesh = template.mesh if isinstance(template, Rig) else template
    if not len(scan.faces):
        raise InputError("The scan has no triangles; give a surface, not points.")
    surface, skin = ScanSurface(scan.vertices, scan.faces), find_skin(template)
    if free is not None:
        skin = skin.without(_rows(free, len(mesh.vertices)))
    names, sampling, positions = _landmarks(mesh, landmarks)
    if names:
        check_landmarks(names, sampling @ mesh.vertices, positions, mesh, scan)
        similarity = align(sampling @ mesh.vertices, positions)
    else:
        similarity = align_by_shape(mesh.vertices[skin.rows], skin.faces, skin.visible, surface)
    start = apply(mesh.vertices, *similarity)
    fit = fit_skin(start[skin.rows], skin, surface, *skin.landmarks(sampling, positions), schedule, backend, tell)
    placed = mesh.with_vertices(carry(mesh.with_vertices(start), skin, fit.vertices))
    folded = turned_over(placed.vertices, mesh.faces) & ~turned_over(mesh.vertices, mesh.faces)
    return Registration(
        placed,
        fit.energies,
        fit.levels,
        distance=np.where(skin.stands_for >= 0, fit.distance[skin.stands_for], np.nan),
        flipped=np.flatnonzero(folded),
        alignment=similarity,
        backend=fit.backend,
    )


def _rows(free: ArrayLike, count: int) -> np.ndarray:
    rows = np.asarray(free)
    if rows.ndim != 1 or (len(rows) and (rows.dtype.kind not in "iu" or rows.min() < 0 or rows.max() >= count)):
        raise InputError(f"The free vertices must be whole numbers from 0 to {count - 1}, in one row.")
    return rows.astype(np.int64)


def _landmarks(mesh: Mesh, landmarks) -> tuple[list[str], sparse.csr_matrix, np.ndarray]:
    """Names, sampling (L, V) and positions (L, 3) of the landmarks that have a position."""
    if landmarks is None:
        return [], sparse.csr_matrix((0, len(mesh.vertices))), np.zeros((0, 3))
    points, positions = landmarks
    positions = np.asarray(positions, dtype=np.float64)
    if positions.shape != (len(points.names), 3):
        raise InputError(
            f"There are {len(points.names)} landmarks on the template, but their positions have the shape "
            f"{positions.shape}; give one row of three for each."
        )
    known = np.isfinite(positions).all(1)
    if known.sum() < 3:
        raise InputError(f"Only {known.sum()} landmarks have a position; give at least three, or none.")
    names = [points.names[k] for k in np.flatnonzero(known)]
    return names, points.matrix(mesh)[known], positions[known]
