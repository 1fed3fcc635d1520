"""Triangles near a marker on its own side of the mouth and lid slits, and the closest point on each."""

from __future__ import annotations

import numpy as np

from blendcap.data import Mesh, Rig, SurfacePoints
from blendcap.numerics.geodesic import surface_distances, weld


def candidates(mesh: Mesh, points: SurfacePoints, radius: float, count: int) -> np.ndarray:
    """The nearest triangles of each point, by distance along the surface.

    Closed lips touch in space but are a walk around the mouth corner apart on the surface, so a marker on the upper
    lip is never offered the lower one. These are the nearest Q triangles of the 2016 paper, section 6, step 4.

    Parameters
    ----------
    mesh : Mesh
    points : SurfacePoints
        M points to search from.
    radius : float
        How far a triangle's center may lie, mm along the surface.
    count : int
        At most so many triangles for each point.

    Returns
    -------
    (M, count) int64
        Faces, nearest first, beginning with the point's own; -1 where fewer lie within the radius.
    """
    result = np.full((len(points.faces), count), -1, dtype=np.int64)
    for row, (distances, own) in enumerate(zip(_from_points(mesh, points, radius), points.faces, strict=True)):
        center = distances[mesh.faces].mean(1)
        center[own] = 0.0
        near = np.flatnonzero(center <= radius)
        near = near[np.argsort(center[near], kind="stable")][:count]
        result[row, : len(near)] = near
    return result


def project_on(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of the closest point on triangles.

    Parameters
    ----------
    triangles : (..., 3, 3) float64
        Corners, mm; may be degenerate.
    points : (..., 3) float64
        mm; leading axes broadcast with the triangles'.

    Returns
    -------
    (..., 3) float64
        Weights of the corners, not negative, summing to 1.
    """
    triangles = np.asarray(triangles, dtype=np.float64)
    points = np.broadcast_to(points, np.broadcast_shapes(np.shape(points), triangles.shape[:-1]))
    inside = _plane_coordinates(triangles, points)
    options = np.stack([inside, *(_edge_coordinates(triangles, points, k) for k in range(3))])
    reached = np.einsum("o...c,...ck->o...k", options, triangles)
    squared = ((reached - points) ** 2).sum(-1)
    squared[0] = np.where((inside >= 0).all(-1), -1.0, np.inf)  # the foot of the perpendicular, where it is inside
    best = squared.argmin(0)
    return np.take_along_axis(options, best[None, ..., None], axis=0)[0]


def _from_points(mesh: Mesh, points: SurfacePoints, radius: float):
    """For each point the distances (V,) of all vertices along the surface: through the corners of its triangle."""
    corners = mesh.faces[points.faces]
    sources, rows = np.unique(corners, return_inverse=True)
    spread = surface_distances(mesh.vertices, mesh.faces, sources, 2.0 * radius)
    to_corners = np.linalg.norm(mesh.vertices[corners] - points.positions(mesh)[:, None], axis=-1)
    for row, start in zip(rows.reshape(corners.shape), to_corners, strict=True):
        yield (spread[row] + start[:, None]).min(0)


def _plane_coordinates(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of the foot of the perpendicular on the plane; negative for a degenerate triangle."""
    first, second = triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :]
    arm = points - triangles[..., 0, :]
    aa, ab, bb = (first**2).sum(-1), (first * second).sum(-1), (second**2).sum(-1)
    pa, pb = (arm * first).sum(-1), (arm * second).sum(-1)
    determinant = aa * bb - ab * ab
    flat = determinant <= 1e-14 * aa * bb
    divisor = np.where(flat, 1.0, determinant)
    v, w = (bb * pa - ab * pb) / divisor, (aa * pb - ab * pa) / divisor
    return np.where(flat[..., None], -1.0, np.stack([1 - v - w, v, w], -1))


def _edge_coordinates(triangles: np.ndarray, points: np.ndarray, first: int) -> np.ndarray:
    """Barycentric coordinates of the closest point on the edge from corner `first` to the next."""
    second = (first + 1) % 3
    start, edge = triangles[..., first, :], triangles[..., second, :] - triangles[..., first, :]
    along = ((points - start) * edge).sum(-1) / np.maximum((edge**2).sum(-1), 1e-300)
    along = np.clip(along, 0.0, 1.0)
    result = np.zeros((*along.shape, 3))
    result[..., first], result[..., second] = 1 - along, along
    return result


def seamless(rig: Rig) -> Mesh:
    """The rig's mesh with its texture seams sewn up (see `weld`), for walks along the surface."""
    return Mesh(rig.mesh.vertices, weld(rig.mesh.faces, rig.mesh.vertices, rig.deltas))
