"""Deformation transfer: every shape of a template rig for another neutral face of the same topology."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from blendcap.data import InputError, Mesh, Rig
from blendcap.modeling.contacts import find_contacts
from blendcap.modeling.differences import Faces, differences
from blendcap.modeling.keeping import keep
from blendcap.modeling.parts import pieces
from blendcap.numerics.geodesic import sewn_vertices
from blendcap.numerics.similarity import align

Method = Literal["contact", "paper"]


@dataclass(frozen=True, eq=False)
class Transfer:
    """A transferred rig and what its making can prove.

    Parameters
    ----------
    rig : Rig
    scale : float
        Size of the new neutral against the template's.
    energies : (N,) float64
        What Eq. 24 costs at each shape of the rig: squared differences of gradients, times the triangle's area (mm²)
        with "contact".
    residual : float
        Largest relative residual of the linear solves, those that mend contact included.
    """

    rig: Rig
    scale: float
    energies: np.ndarray
    residual: float


def transfer_rig(template: Rig, mesh: Mesh, *, method: Method = "contact") -> Rig:
    """Carry every shape of a template over to another neutral face of the same topology.

    Parameters
    ----------
    template : Rig
    mesh : Mesh
        The neutral face: the template's vertices and triangles, other positions, mm.
    method : "contact" or "paper"
        "paper" is deformation transfer as in the thesis (Eq. 18 to 25, Sumner and Popovic 2004): nothing but the
        gradients of each shape, every triangle counted alike. "contact" counts a triangle by its area and keeps besides
        what must not change: pairs that meet in the template (`Rig.contacts`, found where the template has none) meet
        in the result, what a shape does not move stays put, eyeballs and teeth move as solid bodies, and lashes hang
        on their lids.

    Returns
    -------
    Rig
        With the template's names, bounds, mirror, combinations, points, regions and contacts.

    Raises
    ------
    InputError
        If the face has other vertices or triangles than the template, or the template has no shape that moves.
    """
    return transfer(template, mesh, method=method).rig


def transfer(template: Rig, mesh: Mesh, *, method: Method = "contact") -> Transfer:
    """The same as `transfer_rig`, with the certificate beside the rig."""
    if method not in ("contact", "paper"):
        raise InputError(f"There is no transfer method {method!r}; choose contact or paper.")
    _check(template, mesh)
    sewn = sewn_vertices(template.mesh.vertices, template.deltas)
    faces = _aligned(template, mesh, sewn[mesh.faces])
    contacts = dict(template.contacts)
    if method == "paper":
        solved, costs = differences(faces, np.ones(len(faces.faces)))
        deltas, residual = faces.deltas + solved.field, solved.residual
    else:
        contacts = contacts or find_contacts(template)
        solved, costs = differences(faces)
        deltas, residual = keep(template, faces, solved, sewn, contacts)
    deltas = deltas[:, sewn].astype(np.float32)
    rig = replace(template, mesh=_dressed(mesh, template.mesh), deltas=deltas, contacts=contacts)
    return Transfer(rig, faces.unit, costs.at(rig.deltas - faces.deltas), max(residual, solved.residual))


def _check(template: Rig, mesh: Mesh) -> None:
    own, given = len(template.mesh.vertices), len(mesh.vertices)
    if own != given:
        raise InputError(
            f"The face has {given} vertices, but the template {template.name!r} has {own}; "
            "register the template to the face first, so that both have the same vertices."
        )
    if not np.array_equal(template.mesh.faces, mesh.faces):
        raise InputError(
            f"The face has as many vertices as the template {template.name!r}, but other triangles; "
            "register the template to the face first."
        )
    if not template.deltas.any():
        raise InputError(f"The template {template.name!r} has no shape that moves a vertex; there is nothing to carry.")


def _aligned(template: Rig, mesh: Mesh, faces: np.ndarray) -> Faces:
    """The template turned, scaled and moved onto the face: gradients are only comparable in one orientation."""
    rotation, translation, scale = align(template.mesh.vertices, mesh.vertices)
    turn = (scale * rotation).T
    rest = template.mesh.vertices @ turn + translation
    deltas = (template.deltas.reshape(-1, 3) @ turn).reshape(template.deltas.shape)
    return Faces(rest, deltas, mesh.vertices, faces, pieces(faces, len(rest)), float(scale))


def _dressed(mesh: Mesh, template: Mesh) -> Mesh:
    """The face with the template's polygons and texture coordinates where it has none."""
    polygons = template.polygons if mesh.polygons is None else mesh.polygons
    uv, uv_faces = (template.uv, template.uv_faces) if mesh.uv is None else (mesh.uv, mesh.uv_faces)
    return replace(mesh, polygons=polygons, uv=uv, uv_faces=uv_faces)
