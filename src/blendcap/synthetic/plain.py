"""Any face laid over the plain mannequin, so that what is known there by place is known here too.

A similarity and a thin-plate spline through the 68 landmarks take the face's neutral to the plain one (Bookstein 1989;
in space its kernel is |r|, Duchon 1977). From there each vertex goes to the nearest place of the plain surface that
looks the same way.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from blendcap.data import Rig, landmarks68
from blendcap.numerics.similarity import align, apply
from blendcap.numerics.surfaces import edges_of
from blendcap.rendering import vertex_normals
from blendcap.synthetic.mannequin.landmarks import landmarks
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.mannequin.texture import plain_mesh, skin_table

STIFFNESS, LOOSENESS = 0.2, 60.0  # mm: how much the spline may miss a landmark, and another place
ROUNDS, ANCHORS = 2, 500
CLEAR, REACH = 18.0, 25.0  # mm: anchors keep off the features; what is farther from the plain skin is none
TURN = 18.0  # mm that a normal turned by a right angle counts
NEAREST = 6
KNOTS = np.r_[0:17, 18:21, 23:26, 27:68]  # landmarks but the ends of the brows, whose height nobody agrees on
EAR_RIM = 4.0  # mm
FAINT = 1e-9  # what a part that is torn all over holds on to itself
TORN = 3.0  # times as far apart as they were, and 1 mm: neighbors that are torn from each other


def plain_places(rig: Rig, vertices: np.ndarray) -> np.ndarray:
    """Place on the plain mannequin, mm, and fields (K, 9), as `skin_table`, of skin vertices (K,) of a rig.

    Raises
    ------
    InputError
        If the rig has no "landmarks68".
    """
    source, target = landmarks68(rig).positions(rig.mesh), plain_landmarks()
    fit = align(source, target)
    faces = _within(rig.mesh.faces, vertices, len(rig.mesh.vertices))
    skin, source = apply(rig.mesh.vertices[vertices], *fit), apply(source, *fit)
    ears = _ears(skin, source), _ears(plain_mesh().vertices, target)
    source, target = source[KNOTS], target[KNOTS]
    if len(ears[0]) == len(ears[1]):
        source, target = np.concatenate([source, ears[0]]), np.concatenate([target, ears[1]])
    warped = _warped(skin, source, target, np.full(len(source), STIFFNESS))
    for _ in range(ROUNDS):
        some, onto = _anchors(warped, faces, target)
        stiffness = np.concatenate([np.full(len(source), STIFFNESS), np.full(len(some), LOOSENESS)])
        warped = _warped(skin, np.concatenate([source, skin[some]]), np.concatenate([target, onto]), stiffness)
    face, weights = _on_plain(warped, vertex_normals(warped, faces))
    table = np.einsum("kc,kcd->kd", weights, skin_table()[plain_mesh().faces[face]])
    return _mended(table, warped, faces)


def _mended(table: np.ndarray, warped: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The table (K, 9) where neighbors went to places far apart, as in the fold of a lid, filled in from around."""
    edges, count = edges_of(faces)[0], len(table)
    i, j = edges.T
    length = np.linalg.norm(warped[i] - warped[j], axis=1)
    torn = edges[np.linalg.norm(table[i, :3] - table[j, :3], axis=1) > TORN * length + 1.0]
    links = sparse.csr_matrix((np.ones(edges.size), (np.r_[i, j], np.r_[j, i])), shape=(count, count))
    lost = np.zeros(count, dtype=bool)
    lost[torn] = True
    lost |= links @ lost > 0  # and their neighbors: a fold is torn along both its sides
    if not lost.any():
        return table
    smooth = (sparse.diags(np.asarray(links.sum(1)).ravel() + FAINT) - links).tocsr()[lost]
    moved = table - np.pad(warped, ((0, 0), (0, table.shape[1] - 3)))  # a place is where its point was, and a step
    filled = table.copy()
    steps = spsolve(smooth[:, lost].tocsc(), FAINT * moved[lost] - smooth[:, ~lost] @ moved[~lost])
    filled[lost] += steps - moved[lost]
    return filled


def _ears(skin: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Middle of the outermost part of each ear, (2, 3), left first; (0, 3) if nothing stands out beside the face."""
    low, high = landmarks[[48, 54], 1].mean(), landmarks[17:27, 1].mean()
    beside = skin[(skin[:, 1] > low) & (skin[:, 1] < high)]
    ears = []
    for side, edge in ((1, 16), (-1, 0)):
        out = side * beside[:, 0]
        if not len(out) or out.max() < 1.08 * side * landmarks[edge, 0]:
            return np.empty((0, 3))
        ears.append(beside[out > out.max() - EAR_RIM].mean(0))
    return np.array(ears)


def _within(faces: np.ndarray, vertices: np.ndarray, count: int) -> np.ndarray:
    """The faces between some vertices (K,), as rows of these."""
    place = np.full(count, -1)
    place[vertices] = np.arange(len(vertices))
    own = place[faces]
    return own[(own >= 0).all(1)]


def _anchors(warped: np.ndarray, faces: np.ndarray, landmarks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Some vertices (A,) away from the features of the face, and the places (A, 3) of the plain skin under them."""
    away, _ = KDTree(landmarks).query(warped)
    far = np.flatnonzero(away > CLEAR)
    some = far[np.random.default_rng(0).permutation(len(far))[:ANCHORS]]
    face, weights = _on_plain(warped[some], vertex_normals(warped, faces)[some])
    onto = np.einsum("kc,kcd->kd", weights, plain_mesh().vertices[plain_mesh().faces[face]])
    near = np.linalg.norm(onto - warped[some], axis=1) < REACH
    return some[near], onto[near]


def _warped(points: np.ndarray, source: np.ndarray, target: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Points (V, 3) moved as the spline moves knots `source` (L, 3) to `target`, within its `stiffness` (L,)."""
    count = len(source)
    ends = np.c_[np.ones(count), source]
    system = np.zeros((count + 4, count + 4))
    system[:count, :count] = np.diag(stiffness) - cdist(source, source)
    system[:count, count:], system[count:, :count] = ends, ends.T
    knots = np.linalg.solve(system, np.concatenate([target - source, np.zeros((4, 3))]))
    return points + np.c_[np.ones(len(points)), points] @ knots[count:] - cdist(points, source) @ knots[:count]


def _on_plain(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The face (K,) of the plain skin nearest to each point in place and direction, and its corners' weights (K, 3)."""
    corners, across, tree = _plain_tree()
    _, near = tree.query(np.concatenate([points, TURN * normals], 1), k=NEAREST)
    weights = _closest(np.repeat(points, NEAREST, 0), corners[near.ravel()])
    place = np.einsum("kc,kcd->kd", weights, corners[near.ravel()]).reshape(len(points), NEAREST, 3)
    away = ((place - points[:, None]) ** 2).sum(2) + (TURN * (across[near] - normals[:, None]) ** 2).sum(2)
    best, rows = np.argmin(away, axis=1), np.arange(len(points))
    return np.asarray(near)[rows, best], weights.reshape(len(points), NEAREST, 3)[rows, best]


@lru_cache(maxsize=1)
def _plain_tree() -> tuple[np.ndarray, np.ndarray, KDTree]:
    """Corners (F, 3, 3) and normals (F, 3) of the plain skin's faces, and a tree of middles beside normals."""
    corners = plain_mesh().vertices[plain_mesh().faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return corners, across, KDTree(np.concatenate([corners.mean(1), TURN * across], 1))


@lru_cache(maxsize=1)
def plain_landmarks() -> np.ndarray:
    """The 68 landmarks (68, 3) of the plain mannequin, mm."""
    head = shared()
    return landmarks(head.cage, plain_mesh(), head.surface.middles).positions(plain_mesh())


def _closest(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Barycentric weights (K, 3) of the place on each triangle (K, 3, 3) that is closest to a point (K, 3)."""
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    gram = [(x * y).sum(1) for x, y in ((ab, ab), (ab, ac), (ac, ac))]
    p, q = ((points - a) * ab).sum(1), ((points - a) * ac).sum(1)
    det = np.maximum(gram[0] * gram[2] - gram[1] ** 2, 1e-12)
    v, w = (gram[2] * p - gram[1] * q) / det, (gram[0] * q - gram[1] * p) / det
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    best = np.stack([1 - v - w, v, w], 1)
    outside = np.flatnonzero(~inside)
    least = np.full(len(outside), np.inf)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        start, edge = corners[outside, first], corners[outside, second] - corners[outside, first]
        t = ((points[outside] - start) * edge).sum(1) / np.maximum((edge * edge).sum(1), 1e-12)
        t = np.clip(t, 0, 1)
        away = ((start + t[:, None] * edge - points[outside]) ** 2).sum(1)
        here, least = away < least, np.minimum(away, least)
        weights = np.zeros((len(outside), 3))
        weights[:, first], weights[:, second] = 1 - t, t
        best[outside[here]] = weights[here]
    return best
