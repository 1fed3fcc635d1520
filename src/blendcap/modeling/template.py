"""What of a template is fitted to a scan, and what is carried along: eyeballs, teeth, the inside of the mouth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from blendcap.data import InputError, Mesh, Rig
from blendcap.modeling.contacts import find_contacts, gaps
from blendcap.numerics.geodesic import sewn_vertices
from blendcap.numerics.similarity import align, apply
from blendcap.numerics.surfaces import border_vertices, face_normals, parts, vertex_normals
from blendcap.rendering.light import openness

OPEN = 0.12  # a vertex that sees less of the sky than this is inside: no scanner sees it either
CLOSED = 1.0  # mm: a contact that is closer at rest stays together
FLESH = 0.025  # of the template's size: flesh that is thicker between two sides does not join them
AMONG, OPPOSITE = 64, 0.3  # vertices looked at for the other side; cosine by which two sides look away from each other
NEAR = 0.012  # of the template's size: parts closer than this belong together, as teeth and gums do
CLINGS = 0.006  # of the template's size: a part that is nowhere farther from the skin than this clings to it (lashes)
AROUND = 0.05  # of the template's size: how far around a part the skin decides how it is carried


@dataclass(frozen=True, eq=False)
class Skin:
    """The part of a template that is solved for, with seams sewn.

    Parameters
    ----------
    rows : (n,) int64
        The template's vertices that are solved for.
    stands_for : (V,) int64
        The place in `rows` of each vertex of the skin; -1 elsewhere.
    faces : (T, 3) int64
        Triangles between `rows`.
    visible : (n,) bool
        Which of them a scan can show; the others follow by stiffness alone.
    touching : (P, 2) int64
        Places in `rows` that meet at rest though no edge joins them, as closed lips do.
    walls : (Q, 2) int64
        Places in `rows` on two sides of thin flesh: a lid and the pocket behind it, the two sides of an ear.
    """

    rows: np.ndarray
    stands_for: np.ndarray
    faces: np.ndarray
    visible: np.ndarray
    touching: np.ndarray
    walls: np.ndarray

    def without(self, vertices: np.ndarray) -> Skin:
        """The same with these vertices (K,) of the template followed by stiffness, as if no scanner saw them."""
        visible = self.visible.copy()
        places = self.stands_for[vertices]
        visible[places[places >= 0]] = False
        return replace(self, visible=visible)

    def landmarks(self, sampling: Any, positions: np.ndarray) -> tuple[Any, np.ndarray]:
        """Sampling (L, n) of `rows` and positions (L, 3) of the landmarks that lie on the skin.

        `sampling` (K, V) samples the template's vertices at `positions` (K, 3).
        """
        on_skin = np.flatnonzero(self.stands_for >= 0)
        entries = (np.ones(len(on_skin)), (on_skin, self.stands_for[on_skin]))
        sewing = sparse.csr_matrix(entries, shape=(len(self.stands_for), len(self.rows)))
        sampled = sparse.csr_matrix(sampling @ sewing)
        whole = np.asarray(sampled.sum(1)).ravel() > 1 - 1e-6
        return sampled[whole], positions[whole]


def find_skin(template: Mesh | Rig) -> Skin:
    """The largest connected part of a template, and what of it is visible from outside."""
    mesh = template.mesh if isinstance(template, Rig) else template
    if not len(mesh.faces):
        raise InputError("The template has no triangles; give a surface, not points.")
    sewn = _sewn(template)
    faces = sewn[mesh.faces]
    part = parts(faces, len(sewn))
    area = np.linalg.norm(face_normals(mesh.vertices, faces), axis=1)
    largest = int(np.argmax(np.bincount(part[faces[:, 0]], area)))
    faces = faces[part[faces[:, 0]] == largest]
    rows = np.unique(faces)
    place = np.full(len(sewn), -1)
    place[rows] = np.arange(len(rows))
    seen = openness(mesh.vertices, vertex_normals(mesh.vertices, mesh.faces), mesh.faces) > OPEN
    walls = _walls(mesh.vertices[rows], place[faces], seen[rows])
    return Skin(rows, place[sewn], place[faces], seen[rows], _touching(template, place[sewn]), walls)


def _walls(vertices: np.ndarray, faces: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Pairs (Q, 2) of a vertex and the nearest visible one across thin flesh; what lies across air is no neighbour."""
    normals, reach = vertex_normals(vertices, faces), FLESH * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    distance, near = KDTree(vertices).query(vertices, k=min(AMONG, len(vertices)), distance_upper_bound=reach)
    known = np.isfinite(distance)
    near = np.where(known, near, 0)
    across = vertices[near] - vertices[:, None]
    inwards, outwards = (across * normals[:, None]).sum(2), (across * normals[near]).sum(2)
    facing = (normals[near] * normals[:, None]).sum(2)
    between = np.minimum(-inwards, outwards) > OPPOSITE * distance
    flesh = known & visible[near] & between & (facing < -OPPOSITE)
    found = np.flatnonzero(flesh.any(1))
    return np.stack([found, near[found, flesh[found].argmax(1)]], axis=1)


def _touching(template: Mesh | Rig, stands_for: np.ndarray) -> np.ndarray:
    """The contacts of a rig that are closed in its neutral."""
    if isinstance(template, Mesh):
        return np.zeros((0, 2), np.int64)
    contacts = template.contacts or find_contacts(template)
    pairs = np.concatenate([np.zeros((0, 2), np.int64), *contacts.values()])
    pairs = pairs[gaps(template.mesh.vertices, pairs) < CLOSED]
    pairs = stands_for[pairs]
    return pairs[(pairs >= 0).all(1) & (pairs[:, 0] != pairs[:, 1])]


def _sewn(template: Mesh | Rig) -> np.ndarray:
    """(V,) the vertex that stands for each: where borders meet exactly, and nothing parts them."""
    mesh = template.mesh if isinstance(template, Rig) else template
    border = border_vertices(mesh.faces, len(mesh.vertices))
    deltas = template.deltas if isinstance(template, Rig) else np.zeros((0, len(border), 3), np.float32)
    sewn = np.arange(len(border))
    rows = np.flatnonzero(border)
    sewn[rows] = rows[sewn_vertices(mesh.vertices[rows], deltas[:, rows])]
    return sewn


def carry(template: Mesh, skin: Skin, fitted: np.ndarray) -> np.ndarray:
    """All vertices (V, 3) of the template when its skin lies at `fitted` (n, 3).

    Parts that cling to the skin follow it point by point; other parts, and those near each other together, move by the
    similarity of the skin around them: eyeballs stay round, teeth keep their rows.
    """
    result = np.where((skin.stands_for >= 0)[:, None], fitted[skin.stands_for], template.vertices)
    loose = np.flatnonzero(skin.stands_for < 0)
    if not len(loose):
        return result
    rest = template.vertices[skin.rows]
    size = float(np.linalg.norm(np.ptp(rest, axis=0)))
    tree = KDTree(rest)
    for group in _groups(template, loose, NEAR * size):
        distance, _ = tree.query(template.vertices[group])
        if distance.max() < CLINGS * size:
            result[group] += _followed(tree, rest, fitted, template.vertices[group])
        else:
            result[group] = _as_a_whole(rest, fitted, template.vertices[group], AROUND * size)
    return result


def _groups(template: Mesh, loose: np.ndarray, near: float) -> list[np.ndarray]:
    """The loose vertices, part by part; parts closer than `near` are one group."""
    part = parts(template.faces, len(template.vertices))[loose]
    pairs = KDTree(template.vertices[loose]).query_pairs(near, output_type="ndarray")
    links = np.unique(part[pairs], axis=0)
    count = int(part.max()) + 1
    graph = sparse.csr_matrix((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    group = connected_components(graph, directed=False)[1][part]
    return [loose[group == number] for number in np.unique(group)]


def _followed(tree, rest, fitted, places) -> np.ndarray:
    """How the skin next to each place moves, (k, 3): the mean of its eight nearest vertices, the nearer the more."""
    distance, rows = tree.query(places, k=8)
    weight = 1 / np.maximum(distance, 1e-6 * (1 + distance.max())) ** 2
    weight /= weight.sum(1, keepdims=True)
    return np.einsum("kj,kjc->kc", weight, (fitted - rest)[rows])


def _as_a_whole(rest, fitted, places, reach: float) -> np.ndarray:
    """Places (k, 3) moved by the similarity of the skin around them."""
    distance, _ = KDTree(places).query(rest)
    weight = np.exp(-(((distance - distance.min()) / reach) ** 2))
    near = weight > 1e-3
    return apply(places, *align(rest[near], fitted[near], weights=weight[near]))
