"""What must survive when shapes change: contact, stillness, clear eyeballs, solid bodies, what hangs on the skin."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import KDTree

from blendcap.data import Rig
from blendcap.modeling.closing import PATCH, close, make_patch, wanted_gaps
from blendcap.modeling.contacts import drivers_of
from blendcap.modeling.differences import Differences, Faces, hang
from blendcap.modeling.globes import Globe, clearing_push, find_globes, shared_push
from blendcap.modeling.parts import carried, solid_motions
from blendcap.numerics.easing import smoothstep

FADE = 0.02  # of a shape's largest motion, below which a change fades to nothing
ATTACHED = 3.0  # mm from the skin, at the template's size: a piece that near hangs on it


def keep(
    template: Rig, faces: Faces, solved: Differences, sewn: np.ndarray, contacts: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, float]:
    """The changed shapes (N, V, 3), with what holds in the template's mended, and the largest residual of the solves.

    Parameters
    ----------
    template : Rig
        Says which shapes drive others and which vertices are eyes.
    faces : Faces
        The template's shapes beside the new face.
    solved : Differences
        What shall be added to the shapes.
    sewn : (V,) int64
        The vertex that stands for each once texture seams are sewn.
    contacts : {name: (P, 2) int64}
        Pairs that meet.
    """
    motion = np.linalg.norm(faces.deltas, axis=2)
    full = FADE * motion.max(1, keepdims=True)
    fade = smoothstep(0, 1, motion / np.where(full > 0, full, 1.0))[..., None]
    deltas = faces.deltas + fade * solved.field
    pairs = sewn[np.concatenate([np.zeros((0, 2), np.int64), *contacts.values()])]
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    globes = _globes(faces, template.regions.get("eyes", np.zeros(0, np.int64)))
    patch = make_patch(faces.rest, pairs, solved.stiffness, PATCH * faces.unit) if len(pairs) else None
    residual = 0.0 if patch is None else patch.residual
    drivers = [drivers_of(template, name) for name in template.names]
    for i in sorted(range(len(drivers)), key=lambda i: len(drivers[i])):
        wanted, meets = _wanted(faces, deltas, pairs, i, drivers[i])
        deltas[i] = _clear(faces, deltas[i], i, globes, pairs[meets])
        if patch is not None:
            deltas[i], off = close(patch, deltas[i], wanted, meets, motion[i])
            residual = max(residual, off)
    residual = max(residual, _hang(faces, solved, deltas, fade))
    for body in solid_motions(faces.template, faces.deltas, faces.pieces[1:]):
        deltas[body.shape, body.vertices] = carried(body, faces.template, faces.rest, solved.areas)
    return deltas, residual


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


def _hang(faces: Faces, solved: Differences, deltas: np.ndarray, fade: np.ndarray) -> float:
    """Pieces near the skin follow what was done to it (in place); the largest relative residual of their solves."""
    skin, *others = faces.pieces
    residual = 0.0
    if not others:
        return residual
    tree = KDTree(faces.template[skin])
    field = deltas - faces.deltas
    for piece in others:
        distance, nearest = tree.query(faces.template[piece], distance_upper_bound=ATTACHED * faces.unit)
        near = np.isfinite(distance)
        if near.any():
            off = hang(solved, field, piece, np.where(near, skin[np.where(near, nearest, 0)], -1))
            residual = max(residual, off)
            deltas[:, piece] = faces.deltas[:, piece] + fade[:, piece] * field[:, piece]
    return residual
