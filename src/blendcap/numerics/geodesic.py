"""Along a surface: how far apart two places are, and where a straight walk ends. Neither jumps over a slit."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra


def surface_distances(mesh_vertices, faces, sources, limit: float = np.inf) -> np.ndarray:
    """Distances along the surface from each source vertex to every vertex.

    Shortest paths over the edges and over the unfolded diagonals of neighbouring triangles: never shorter than the
    true distance on the unfolded surface, and a few per cent longer on an even mesh.

    Parameters
    ----------
    mesh_vertices : (V, 3) float64
        mm.
    faces : (F, 3) int64
    sources : (K,) int64
        Vertices to start from.
    limit : float
        mm; what lies beyond is not searched.

    Returns
    -------
    (K, V) float64
        mm; inf beyond the limit or where no path leads.
    """
    graph = surface_graph(mesh_vertices, faces)
    return np.asarray(dijkstra(graph, directed=False, indices=np.asarray(sources, dtype=np.int64), limit=limit))


def sewn_vertices(mesh_vertices, deltas) -> np.ndarray:
    """(V,) for each vertex the one that stands for it once texture seams are sewn: same place, same motion.

    Lips that touch stay two: some shape parts them.

    Parameters
    ----------
    mesh_vertices : (V, 3) float64
        mm.
    deltas : (N, V, 3) float32
        mm; vertices are told apart down to 0.001 mm.
    """
    _, place, count = np.unique(np.round(mesh_vertices, 3), axis=0, return_inverse=True, return_counts=True)
    place = place.ravel()
    twins = np.flatnonzero(count[place] > 1)
    motion = np.round(np.moveaxis(deltas[:, twins], 0, 1).reshape(len(twins), 3 * len(deltas)), 3) + 0.0  # no -0
    _, first, same = np.unique(np.column_stack([place[twins], motion]), axis=0, return_index=True, return_inverse=True)
    merged = np.arange(len(place))
    merged[twins] = twins[first][same.ravel()]
    return merged


def weld(faces, mesh_vertices, deltas) -> np.ndarray:
    """Faces (F, 3) that use one vertex where a texture seam split it (see `sewn_vertices`).

    Files such as glTF need this before anything is measured along their surface.
    """
    return sewn_vertices(mesh_vertices, deltas)[np.asarray(faces)]


def surface_graph(mesh_vertices, faces) -> sparse.csr_matrix:
    """The graph that `surface_distances` searches: (V, V) lengths of edges and of unfolded diagonals, mm."""
    vertices, faces = np.asarray(mesh_vertices, dtype=np.float64), np.asarray(faces)
    edges = np.stack([np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)], axis=2).reshape(-1, 2)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    diagonals, diagonal_lengths = _diagonals(vertices, edges, faces.ravel())
    pairs = np.sort(np.concatenate([edges, diagonals]), axis=1)
    lengths = np.maximum(np.concatenate([lengths, diagonal_lengths]), 1e-12)  # a zero would read as "no edge"
    order = np.lexsort([lengths, pairs[:, 1], pairs[:, 0]])  # the shortest of double entries comes first
    pairs, first = np.unique(pairs[order], axis=0, return_index=True)
    count = len(vertices)
    return sparse.csr_matrix((lengths[order][first], pairs.T), shape=(count, count))


def _diagonals(vertices, edges, opposite) -> tuple[np.ndarray, np.ndarray]:
    """Opposite corners (D, 2) of triangles that share an edge, and their distance once unfolded into one plane."""
    low, high = edges.min(1), edges.max(1)
    order = np.lexsort([high, low])
    same = (low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1])
    one, two = order[:-1][same], order[1:][same]
    start, end = vertices[low[one]], vertices[high[one]]
    along = end - start
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    along = along / length[:, None]
    flat = []
    for corner in (opposite[one], opposite[two]):
        arm = vertices[corner] - start
        x = np.einsum("ij,ij->i", arm, along)
        flat.append((x, np.linalg.norm(arm - x[:, None] * along, axis=1)))
    (x1, y1), (x2, y2) = flat
    crossing = (x1 * y2 + x2 * y1) / np.maximum(y1 + y2, 1e-12)
    inside = (crossing > 0) & (crossing < length)  # else the straight line leaves the two triangles
    pairs = np.stack([opposite[one], opposite[two]], axis=1)
    return pairs[inside], np.hypot(x1 - x2, y1 + y2)[inside]


def face_neighbors(faces) -> np.ndarray:
    """(F, 3) int64: the face across the edge opposite each corner; -1 at a border or where three or more faces meet."""
    faces = np.asarray(faces)
    edges = np.sort(np.stack([np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, label, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    label = label.ravel()
    order = np.argsort(label, kind="stable")
    paired = order[count[label[order]] == 2].reshape(-1, 2)
    result = np.full(faces.size, -1, dtype=np.int64)
    result[paired[:, 0]], result[paired[:, 1]] = paired[:, 1] // 3, paired[:, 0] // 3
    return result.reshape(-1, 3)


def walk(mesh_vertices, faces, neighbors, *, face: int, barycentric, step) -> tuple[int, np.ndarray]:
    """Walk straight on the surface: over an edge as if the two triangles lay in one plane; a border ends the walk.

    Parameters
    ----------
    mesh_vertices : (V, 3) float64
        mm.
    faces : (F, 3) int64
    neighbors : (F, 3) int64
        As `face_neighbors` gives it.
    face, barycentric : int, (3,) float64
        Where to start.
    step : (3,) float64
        Direction and length, mm; laid into the plane of the first face with its length kept.

    Returns
    -------
    (int, (3,) float64)
        Face and barycentric weights of the end.

    References
    ----------
    Straightest geodesics: Polthier and Schmies 1998, doi:10.1007/978-3-662-03567-2_11.
    """
    vertices, faces = np.asarray(mesh_vertices, dtype=np.float64), np.asarray(faces)
    left = float(np.linalg.norm(step))
    if left == 0:
        return face, np.array(barycentric, dtype=np.float64)
    where = 0.9999 * np.asarray(barycentric, dtype=np.float64) + 0.0001 / 3  # a corner belongs to no single face
    corners = vertices[faces[face]]
    direction = _unit(step - _normal(corners) * (_normal(corners) @ step))
    while left > 1e-9:
        speed = _barycentric_speed(corners, direction)
        with np.errstate(divide="ignore"):
            reach = np.where(speed < -1e-12, -where / speed, np.inf)
        side = int(reach.argmin())
        length = min(left, float(reach[side]))
        where = np.maximum(where + length * speed, 0)
        where /= where.sum()
        left -= length
        if left <= 1e-9 or neighbors[face, side] < 0:
            break
        edge = faces[face, [(side + 1) % 3, (side + 2) % 3]]
        crossing = where[[(side + 1) % 3, (side + 2) % 3]]
        following = int(neighbors[face, side])
        direction = _unfold(direction, corners, side, vertices[faces[following]], vertices[edge])
        face, corners = following, vertices[faces[following]]
        where = np.array([crossing[edge == v].sum() for v in faces[face]])
    return face, where


def _unfold(direction, corners, side: int, following, edge) -> np.ndarray:
    """The direction after crossing the edge opposite corner `side`, in the plane of the triangle that follows."""
    axis = _unit(edge[1] - edge[0])
    outward = -_across(axis, edge[0], corners[side])
    apex = following[np.abs(following[:, None] - edge[None]).sum(2).min(1).argmax()]
    inward = _across(axis, edge[0], apex)
    return _unit(axis * (axis @ direction) + inward * (outward @ direction))


def _across(axis, origin, point) -> np.ndarray:
    arm = point - origin
    return _unit(arm - axis * (axis @ arm))


def _barycentric_speed(corners, direction) -> np.ndarray:
    """How fast the three weights change along a direction in the triangle's plane, 1/mm; they sum to 0."""
    edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)
    u, v = np.linalg.lstsq(edges, direction, rcond=None)[0]
    return np.array([-u - v, u, v])


def _normal(corners) -> np.ndarray:
    return _unit(np.cross(corners[1] - corners[0], corners[2] - corners[0]))


def _unit(vector) -> np.ndarray:
    length = np.linalg.norm(vector)
    return vector / length if length > 0 else vector
