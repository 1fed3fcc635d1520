"""Wrinkles and pores of high-resolution scans, baked into tangent-space normal maps of a rig."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt

from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.modeling.rays import RayTarget
from blendcap.numerics.similarity import align, apply
from blendcap.rendering import normal_map_of, vertex_normals
from blendcap.rendering.relief import tangents_of
from blendcap.rendering.texels import texels_of

NEUTRAL = "neutral"
START = 1e-3  # of the reach, that a ray starts behind its texel, or it might miss a scan that lies on it
BLEED = 8  # texels, that a map goes on beyond the border of its charts

_log = logging.getLogger(__name__)

Pairs = tuple[SurfacePoints, np.ndarray]


@dataclass(frozen=True, eq=False)
class Baked:
    """What one scan says about a surface, texel by texel.

    Parameters
    ----------
    slopes : (H, W, 2) float32
        Along u and v; 0 where the scan says nothing.
    known : (H, W) bool
        Where the scan was met, near enough and facing the same way.
    seen : (H, W) bool
        Which texels show the surface at all.
    distance : (H, W) float32
        From the surface to the scan, mm; NaN where not known.
    """

    slopes: np.ndarray
    known: np.ndarray
    seen: np.ndarray
    distance: np.ndarray

    @property
    def coverage(self) -> float:
        """The share of the surface's texels that is known."""
        return float(self.known.sum() / max(int(self.seen.sum()), 1))


@dataclass(frozen=True, eq=False)
class Baking:
    """A rig with normal maps, and how they came about.

    Parameters
    ----------
    rig : Rig
        With `mesh.normal_map`, if there was a neutral scan, and `normal_maps` of the shapes that were scanned.
    baked : {name: Baked}
        Each scan on the rig in the same expression.
    rms : {name: float}
        How well the correspondences of each scan meet after its rigid alignment, mm; only of scans that have some.
    """

    rig: Rig
    baked: dict[str, Baked]
    rms: dict[str, float]


def bake_normals(
    rig: Rig,
    scans: Mapping[str, Mesh],
    correspondences: Mapping[str, Pairs] | None = None,
    *,
    size: int = 1024,
    reach: float = 4.0,
    angle: float = 1.0,
) -> Baking:
    """Bake the detail of high-resolution scans into normal maps: of the neutral and, as differences, of shapes.

    Parameters
    ----------
    rig : Rig
        With uv.
    scans : {name: Mesh}
        A scan of the face under each shape at weight 1, and of the face at rest by the name "neutral", mm.
    correspondences : {name: (SurfacePoints, (L, 3))}, optional
        Points on the rig and where they lie on the scan; three or more align it rigidly. A scan without lies in place.
    size : int
        Width and height of the maps, texels.
    reach : float
        mm; what is farther from the surface is not believed.
    angle : float
        rad; nor is what turns farther away from it.

    Returns
    -------
    Baking
        Its maps hold what a shape adds to the neutral, so that the slopes of several add up by weight.

    Raises
    ------
    InputError
        If the rig has no uv, a scan belongs to no shape, correspondences are too few, or a scan is nowhere near.
    """
    _check(rig, scans, size)
    baked, rms = {}, {}
    for name, scan in scans.items():
        posed = rig.mesh if name == NEUTRAL else rig.mesh.with_vertices(rig.pose(_alone(rig, name)))
        if correspondences and name in correspondences:
            scan, rms[name] = _in_place(posed, scan, correspondences[name], name)  # noqa: PLW2901
        baked[name] = bake(posed, scan, size, reach, angle)
        if not baked[name].known.any():
            raise InputError(f"The scan {name!r} is nowhere within {reach:g} mm of the rig; give correspondences, "
                             "or bring it into place and unit first.")  # fmt: skip
        _log.info("%s: %.0f %% of the texels are known.", name, 100 * baked[name].coverage)
    rest = baked.get(NEUTRAL)
    maps = {name: normal_map_of(dilated(_added(own, rest), own.seen)) for name, own in baked.items() if name != NEUTRAL}
    mesh = rig.mesh
    if rest is not None:
        mesh = replace(mesh, normal_map=normal_map_of(dilated(rest.slopes, rest.seen)))
    return Baking(replace(rig, mesh=mesh, normal_maps={**rig.normal_maps, **maps}), baked, rms)


def bake(mesh: Mesh, scan: Mesh, size: int, reach: float, angle: float) -> Baked:
    """The slopes of a scan over a mesh with uv, which lies in the same place.

    From each texel a ray goes out along the interpolated normal and one inwards; the nearer hit counts, if it is
    within `reach`, mm, and its normal within `angle`, rad, of the texel's.
    """
    texels = texels_of(mesh, (size, size))
    seen = texels.face >= 0
    faces, weights = texels.face[seen], texels.barycentric[seen]
    points = _mixed(mesh.vertices, mesh.faces[faces], weights)
    normals = _unit(_mixed(vertex_normals(mesh.vertices, mesh.faces), mesh.faces[faces], weights))
    hit, distance, own = _nearer(RayTarget(scan.vertices, scan.faces), points, normals, START * reach)
    met = _unit(_mixed(vertex_normals(scan.vertices, scan.faces), scan.faces[hit], own))
    facing = (met * normals).sum(1)
    good = (hit >= 0) & (np.abs(distance) <= reach) & (facing >= np.cos(angle))
    slopes = _slopes(mesh, faces, weights, normals, met)
    return Baked(
        slopes=_spread(seen, np.where(good[:, None], slopes, 0), 0),
        known=_spread(seen, good, False),
        seen=seen,
        distance=_spread(seen, np.where(good, np.abs(distance), np.nan), np.nan),
    )


def dilated(slopes: np.ndarray, seen: np.ndarray, reach: int = BLEED) -> np.ndarray:
    """Slopes that go on for `reach` texels beyond the charts: there each texel takes the value of the nearest one."""
    if seen.all() or not seen.any():
        return slopes
    distance, (rows, columns) = distance_transform_edt(~seen, return_indices=True)  # pyright: ignore
    return np.where((distance <= reach)[..., None], slopes[rows, columns], 0)


def _added(own: Baked, rest: Baked | None) -> np.ndarray:
    """What a shape adds to the slopes of the neutral, where both are known."""
    if rest is None:
        return own.slopes
    return np.where((own.known & rest.known)[..., None], own.slopes - rest.slopes, 0)


def _nearer(target: RayTarget, points, normals, start) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Face, signed distance and barycentric coordinates of the nearer hit outwards and inwards."""
    outwards = target.first(points - start * normals, normals)
    inwards = target.first(points + start * normals, -normals)
    far, near = outwards[1] - start, inwards[1] - start
    choose = np.abs(near) < np.abs(far)
    faces = np.where(choose, inwards[0], outwards[0])
    return faces, np.where(choose, -near, far), np.where(choose[:, None], inwards[2], outwards[2])


def _slopes(mesh: Mesh, faces: np.ndarray, weights: np.ndarray, normals: np.ndarray, met: np.ndarray) -> np.ndarray:
    """The slopes (P, 2) along u and v that lead from the normals of a mesh to those that were met."""
    frame = tangents_of(mesh)
    along = _mixed(frame.directions, frame.faces[faces], weights)
    along = _unit(along - (along * normals).sum(1, keepdims=True) * normals)
    across = frame.signs[faces, None] * np.cross(normals, along)
    outward = np.maximum((met * normals).sum(1), 1e-6)
    return np.stack([(met * along).sum(1) / outward, (met * across).sum(1) / outward], 1)


def _in_place(posed: Mesh, scan: Mesh, pairs: Pairs, name: str) -> tuple[Mesh, float]:
    """The scan moved rigidly so that its correspondences meet those on the rig, and their RMS distance, mm."""
    points, places = pairs
    places = np.asarray(places, dtype=np.float64)
    if places.shape != (len(points.names), 3) or np.isfinite(places).all(1).sum() < 3:
        raise InputError(
            f"The correspondences of the scan {name!r} must be a place (x, y, z) for each of "
            f"{len(points.names)} points, three or more of them known; their shape is {places.shape}."
        )
    wanted = points.positions(posed)
    fit = align(places, wanted, scale=False)
    off = np.linalg.norm(apply(places, *fit) - wanted, axis=1)
    return scan.with_vertices(apply(scan.vertices, *fit)), float(np.sqrt(np.nanmean(off**2)))


def _check(rig: Rig, scans: Mapping[str, Mesh], size: int) -> None:
    if rig.mesh.uv is None:
        raise InputError(
            f"The rig {rig.name!r} has no texture coordinates, on which normals could be baked; unwrap it."
        )
    if not scans:
        raise InputError("There are no scans to bake; give at least one, by the name of its shape or 'neutral'.")
    for name in scans:
        if name != NEUTRAL:
            rig.index(name)
    if not 16 <= size <= 16384:
        raise InputError(f"A normal map of {size!r} texels is not to be had; choose 16 to 16384.")


def _alone(rig: Rig, name: str) -> np.ndarray:
    return (np.arange(len(rig.names)) == rig.index(name)).astype(np.float64)


def _mixed(values: np.ndarray, rows: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("pk,pkd->pd", weights, values[rows])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _spread(seen: np.ndarray, values: np.ndarray, empty) -> np.ndarray:
    """Values of the texels that are seen, as a picture."""
    kind = bool if values.dtype == bool else np.float32
    picture = np.full((*seen.shape, *values.shape[1:]), empty, dtype=kind)
    picture[seen] = values
    return picture
