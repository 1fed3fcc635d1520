"""Deformation transfer: every shape of a template rig for another neutral face of the same topology."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from blendcap.data import InputError, Mesh, Rig
from blendcap.modeling.closing import PATCH, close, make_patch, wanted_gaps
from blendcap.modeling.contacts import drivers_of, find_contacts
from blendcap.modeling.differences import Differences, Faces, differences, hang
from blendcap.modeling.globes import Globe, clearing_push, find_globes, shared_push
from blendcap.modeling.parts import carried, pieces, solid_motions
from blendcap.numerics.geodesic import sewn_vertices
from blendcap.numerics.similarity import align

Method = Literal["contact", "paper"]

FADE = 0.02  # of a shape's largest motion, below which what transfer adds fades to nothing
ATTACHED = 3.0  # mm from the skin, at the template's size: a piece that near hangs on it


@dataclass(frozen=True, eq=False)
class Transfer:
    """A transferred rig and what its making can prove.

    Parameters
    ----------
    rig : Rig
    scale : float
        Size of the new neutral against the template's.
    energies : (N,) float64
        What Eq. 24 costs at each shape before contact is mended, mm²: squared differences of gradients times area.
    residual : float
        Largest relative residual of the linear solves.
    """

    rig: Rig
    scale: float
    energies: np.ndarray
    residual: float


def transfer_rig(template: Rig, mesh: Mesh, *, method: Method = "contact") -> Rig:
    """The template's shapes on another neutral face; see `transfer`."""
    return transfer(template, mesh, method=method).rig


def transfer(template: Rig, mesh: Mesh, *, method: Method = "contact") -> Transfer:
    """Carry every shape of a template over to another neutral face of the same topology.

    Parameters
    ----------
    template : Rig
    mesh : Mesh
        The neutral face: the template's vertices and triangles, other positions, mm.
    method : "contact" or "paper"
        "paper" is deformation transfer as in the thesis (Eq. 18 to 25, Sumner and Popovic 2004): nothing but the
        gradients of each shape. "contact" keeps besides what must not change: pairs that meet in the template
        (`Rig.contacts`, found where the template has none) meet in the result, what a shape does not move stays put,
        eyeballs and teeth move as solid bodies, and lashes hang on their lids.

    Returns
    -------
    Transfer
        The rig has the template's names, bounds, mirror, combinations, points, regions and contacts.

    Raises
    ------
    InputError
        If the face has other vertices or triangles than the template.
    """
    if method not in ("contact", "paper"):
        raise InputError(f"There is no transfer method {method!r}; choose contact or paper.")
    _check(template, mesh)
    sewn = sewn_vertices(template.mesh.vertices, template.deltas)
    faces = _aligned(template, mesh, sewn[mesh.faces])
    solved = differences(faces)
    contacts = dict(template.contacts)
    if method == "paper":
        deltas = faces.deltas + solved.field
    else:
        contacts = contacts or find_contacts(template)
        deltas = _kept(template, faces, solved, sewn, contacts)
    deltas = deltas[:, sewn].astype(np.float32)
    rig = replace(template, mesh=_dressed(mesh, template.mesh), deltas=deltas, contacts=contacts)
    return Transfer(rig, faces.unit, solved.energies, solved.residual)


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
    return Mesh(mesh.vertices, mesh.faces, polygons, uv, uv_faces, mesh.texture)


def _kept(template: Rig, faces: Faces, solved: Differences, sewn: np.ndarray, contacts) -> np.ndarray:
    """The shapes (N, V, 3) with contact, stillness and solid bodies kept."""
    motion = np.linalg.norm(faces.deltas, axis=2)
    full = FADE * motion.max(1, keepdims=True)
    part = np.clip(motion / np.where(full > 0, full, 1.0), 0, 1)
    fade = (part**2 * (3 - 2 * part))[..., None]
    deltas = faces.deltas + fade * solved.field
    pairs = sewn[np.concatenate([np.zeros((0, 2), np.int64), *contacts.values()])]
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    globes = _globes(faces, template.regions.get("eyes", np.zeros(0, np.int64)))
    patch = make_patch(faces.rest, pairs, solved.stiffness, PATCH * faces.unit) if len(pairs) else None
    drivers = [drivers_of(template, name) for name in template.names]
    for i in sorted(range(len(drivers)), key=lambda i: len(drivers[i])):
        wanted, meets = _wanted(faces, deltas, pairs, i, drivers[i])
        deltas[i] = _clear(faces, deltas[i], i, globes, pairs[meets])
        deltas[i] = deltas[i] if patch is None else close(patch, deltas[i], wanted, meets, motion[i])
    _hang(faces, solved, deltas, fade)
    for body in solid_motions(faces.template, faces.deltas, faces.pieces[1:]):
        deltas[body.shape, body.vertices] = carried(body, faces.template, faces.rest, solved.areas)
    return deltas


def _wanted(faces: Faces, deltas, pairs, shape: int, drivers) -> tuple[np.ndarray, np.ndarray]:
    """What each contact pair shall do in a shape, and whether it meets there; see `wanted_gaps`."""

    def gap(vectors: np.ndarray) -> np.ndarray:
        return vectors[pairs[:, 0]] - vectors[pairs[:, 1]]

    template_base = gap(faces.template) + sum(gap(faces.deltas[d]) for d in drivers)
    base = gap(faces.rest) + sum(gap(deltas[d]) for d in drivers)
    return wanted_gaps(template_base, gap(faces.deltas[shape]), base, faces.unit)


def _globes(faces: Faces, eyes: np.ndarray) -> list[tuple[Globe, Globe, np.ndarray]]:
    """The template's and the new eyeballs, and the skin near each."""
    skin, *others = faces.pieces
    olds, news = (find_globes(at, others, eyes) for at in (faces.template, faces.rest))
    near = [skin[np.abs(old.height(faces.template[skin])) < old.radius / 2] for old in olds]
    return list(zip(olds, news, near, strict=False))


def _clear(faces: Faces, delta: np.ndarray, shape: int, globes, meeting: np.ndarray) -> np.ndarray:
    """The displacements (V, 3) of one shape with the lids kept out of the eyeballs."""
    push = np.zeros_like(delta)
    for old, new, skin in globes:
        near = skin[faces.deltas[shape, skin].any(1)]
        at = faces.template[near], faces.deltas[shape, near], faces.rest[near], delta[near]
        push[near] = clearing_push(*at, (old, new))
    return delta + shared_push(push, meeting) * faces.deltas[shape].any(1)[:, None]


def _hang(faces: Faces, solved: Differences, deltas: np.ndarray, fade: np.ndarray) -> None:
    """Pieces near the skin follow what was done to it (in place)."""
    skin, *others = faces.pieces
    if not others:
        return
    tree = KDTree(faces.template[skin])
    field = deltas - faces.deltas
    for piece in others:
        distance, nearest = tree.query(faces.template[piece], distance_upper_bound=ATTACHED * faces.unit)
        near = np.isfinite(distance)
        if near.any():
            hang(solved, field, piece, np.where(near, skin[np.where(near, nearest, 0)], -1))
            deltas[:, piece] = faces.deltas[:, piece] + fade[:, piece] * field[:, piece]
