"""Where a solve of the markers says that the skin is, frame by frame, as cameras see it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from blendcap.data import Binding, Camera, InputError, MarkerTake, Rig, Solution
from blendcap.makeup.skin_points import SkinPoints
from blendcap.numerics.similarity import align, apply
from blendcap.rendering import project

FEWEST = 4  # markers that place the face
MOST_WARP = 3.0  # the largest entry of a warp: beyond it a triangle is seen edge-on


class Guess(NamedTuple):
    """Where points are expected in the pictures of one camera."""

    places: np.ndarray  # (F, K, 3) mm, in the take's space
    pixels: np.ndarray  # (F, K, 2)
    warps: np.ndarray  # (F, K, 2, 2) from an arm in the neutral picture to one in the frame's


class Expectation:
    """Where the skin is in the take's space by a solve: its own motion, and the face placed by the markers.

    Parameters
    ----------
    rig : Rig
        Its weights are shares of a full shape (`in_shares`).
    take : MarkerTake
    binding : Binding
    solution : Solution
        Of that take, rig and binding.
    full : (N,)
        The weight of the solution that is all of each shape.

    Raises
    ------
    InputError
        If no frame has enough markers to place the face, or the solution does not say where it put them.
    """

    def __init__(self, rig: Rig, take: MarkerTake, binding: Binding, solution: Solution, full: np.ndarray):
        fitted = solution.fitted
        if fitted is None:
            raise InputError("The solution does not say where it put the markers; give one of blendcap.solve.")
        self.rig, self.binding = rig, binding
        self.weights = solution.animation.select(rig.names).weights / full
        seen = binding.to_rig(take.select(solution.marker_names).positions)
        seen = np.where(np.isfinite(fitted).all(2, keepdims=True), seen, np.nan)
        enough = np.isfinite(seen).all(2).sum(1) >= FEWEST
        if not enough.any():
            raise InputError(f"No frame of the take has {FEWEST} markers, which it takes to place the face.")
        motion = align(fitted[enough], seen[enough], scale=False)[:2]
        nearest = np.maximum(np.cumsum(enough) - 1, 0)  # where there are too few, the frame before
        self.rotation, self.translation = (part[nearest] for part in motion)

    def guess(
        self, points: SkinPoints, camera: Camera, frames: slice, instead: Mapping[int, float] | None = None
    ) -> Guess:
        """Where points are in some frames; `instead` are shares of shapes, by row, that stand for the solve's."""
        rest = self.rig.mesh.vertices[self.rig.mesh.faces[points.faces]]
        corners = self._corners(points.faces, frames, instead or {})
        places = np.einsum("kc,fkcd->fkd", points.barycentric, corners)
        warps = _warps(project(self.binding.to_take(rest), camera)[0], project(corners, camera)[0])
        return Guess(places, project(places, camera)[0], warps)

    def _corners(self, faces: np.ndarray, frames: slice, instead: Mapping[int, float]) -> np.ndarray:
        """The corners (F, K, 3, 3) of triangles (K,), mm."""
        corners = self.rig.mesh.faces[faces].ravel()
        deltas = self.rig.deltas[:, corners].reshape(len(self.rig.names), -1).astype(np.float64)
        weights = self.weights[frames].copy()
        for row, weight in instead.items():
            weights[:, row] = weight
        still = self.rig.mesh.vertices[corners] + (weights @ deltas).reshape(len(weights), len(corners), 3)
        posed = self.binding.to_take(apply(still, self.rotation[frames], self.translation[frames]))
        return posed.reshape(len(posed), len(faces), 3, 3)


def _warps(rest: np.ndarray, posed: np.ndarray) -> np.ndarray:
    """(F, K, 2, 2) how triangles (K, 3, 2) are turned and stretched in the picture when posed (F, K, 3, 2)."""
    before, after = (corners[..., 1:, :] - corners[..., :1, :] for corners in (rest, posed))
    flat = np.abs(np.linalg.det(before)) < 1e-9
    before = np.where(flat[:, None, None], np.eye(2), before)
    warps = np.swapaxes(np.linalg.inv(before) @ after, -1, -2)
    warps = np.where(flat[:, None, None], np.eye(2), warps)
    return np.clip(warps, -MOST_WARP, MOST_WARP)
