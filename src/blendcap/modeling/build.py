"""From a raw scan to the actor's rig: made ready, registered, transferred, set upright."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from blendcap.data import Mesh, Rig, SurfacePoints
from blendcap.modeling.registration import Registration, register
from blendcap.modeling.transfer import transfer_rig
from blendcap.numerics.leastsq import Backend
from blendcap.numerics.similarity import align_robust, apply

FEWEST = 50  # vertices that no shape moves and the scan shows, to hold the head by


@dataclass(frozen=True, eq=False)
class BuiltRig:
    """An actor's rig and how it came about.

    Parameters
    ----------
    rig : Rig
        Stands as the template stands, at the actor's size.
    scan : Mesh
        The scan, moved to where the rig is.
    start : Mesh
        The template as it was aligned, before anything bent, at the same place.
    registration : Registration
        At the scan's own place.
    """

    rig: Rig
    scan: Mesh
    start: Mesh
    registration: Registration


def build_rig(
    template: Rig,
    scan: Mesh,
    landmarks: tuple[SurfacePoints, np.ndarray] | None = None,
    *,
    free: ArrayLike | None = None,
    backend: Backend = "auto",
    tell: Callable[..., None] | None = None,
) -> BuiltRig:
    """Register a template's neutral to a scan (mm, see `ready_scan`) and carry every shape over to it.

    `landmarks` and `free` as `register` takes them; for a scan with shut eyes `keep_eyes_open` gives both.
    """
    registration = register(template, scan, landmarks, free=free, backend=backend, tell=tell)
    rotation, translation, scale = registration.alignment

    def upright(mesh: Mesh) -> Mesh:
        return mesh.with_vertices((mesh.vertices - translation) @ rotation)

    neutral = upright(registration.mesh)
    start = template.mesh.with_vertices(apply(template.mesh.vertices, np.eye(3), np.zeros(3), scale))
    return BuiltRig(transfer_rig(template, neutral), upright(scan), start, registration)


def register_example(rig: Rig, scan: Mesh, landmarks: tuple[SurfacePoints, np.ndarray] | None = None) -> Mesh:
    """An expression of the actor in the rig's topology, with the head where the rig's is.

    Parameters
    ----------
    rig : Rig
        The actor's rig, as `build_rig` makes it.
    scan : Mesh
        An expression of the same person, mm, see `ready_scan`.
    landmarks
        As for `register`.
    """
    found = register(rig, scan, landmarks)
    moving = np.zeros(len(rig.mesh.vertices), dtype=bool)
    moving[rig.moving_vertices()] = True
    still = ~moving & np.isfinite(found.distance)
    rows = np.flatnonzero(still if still.sum() >= FEWEST else np.isfinite(found.distance))
    back = align_robust(found.mesh.vertices[rows], rig.mesh.vertices[rows], scale=False)
    return rig.mesh.with_vertices(apply(found.mesh.vertices, *back))
