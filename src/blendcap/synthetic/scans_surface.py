"""What a scanner makes of a surface: depth maps from around it, fused into one mesh that knows nothing of the original.

The depth maps go into a volume of truncated signed distances (Curless and Levoy 1996, doi:10.1145/237170.237269), and
surface nets (Gibson 1998, doi:10.1007/BFb0056277) draw the mesh through it. So what no camera sees is missing, lips
that touch are one skin, and the triangles follow a grid that lies askew to everything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from blendcap.data import Camera
from blendcap.numerics.barycentric import barycentric
from blendcap.numerics.closest import Closest
from blendcap.numerics.surfaces import parts
from blendcap.rendering import look_at, rasterize
from blendcap.rendering.camera import to_homogeneous

VIEWS = ((2, (-64, -48, -30, -10, 10, 30, 48, 64)), (30, (-55, -20, 20, 55)), (-28, (-60, -22, 22, 60)))
"""Pitch and yaws of the cameras, degrees; none stands behind the head."""
DISTANCE = 900.0  # mm, of a camera from the middle of the head
DETAIL = 0.4  # what a pixel of a depth map covers, in grid steps
GRAZING = 0.17  # cosine: a camera does not measure surface that it sees more obliquely
TRUNCATED = 2.5  # grid steps
GRID = 1.13  # step of the grid, in lengths of the edges that come out
RELAXED = 3  # rounds
SHORT = 0.25  # edges below this part of the spacing shrink to a vertex
ISLAND = 300  # faces; smaller pieces are swept away


@dataclass(frozen=True, eq=False)
class Resurfaced:
    """A new mesh that lies on an old one.

    Parameters
    ----------
    vertices : (V, 3) float64
        mm, each exactly on the old surface.
    faces : (F, 3) int64
    places : (V,) int64
        The old triangle that each vertex lies on.
    barycentric : (V, 3) float64
    """

    vertices: np.ndarray
    faces: np.ndarray
    places: np.ndarray
    barycentric: np.ndarray


@dataclass(frozen=True, eq=False)
class _View:
    camera: Camera
    depth: np.ndarray  # (H, W) mm, infinite where nothing is
    cosine: np.ndarray  # (H, W) between the surface and the line of sight; 0 where it is not measured
    face: np.ndarray  # (H, W), -1 where nothing is


@dataclass(frozen=True, eq=False)
class _Grid:
    origin: np.ndarray  # (3,) mm
    axes: np.ndarray  # (3, 3), a row a step, mm
    shape: tuple[int, ...]

    def points(self, places: np.ndarray) -> np.ndarray:
        return self.origin + places @ self.axes


def resurface(vertices: np.ndarray, faces: np.ndarray, spacing: float, rng: np.random.Generator) -> Resurfaced:
    """The surface as cameras around it see it, in even triangles of its own.

    Parameters
    ----------
    vertices : (V, 3) float64
        mm, +y up, +z where the face looks.
    faces : (F, 3) int64
    spacing : float
        Length of the new edges, mm.
    rng : numpy.random.Generator
        Turns and shifts the grid.
    """
    step = GRID * spacing
    views = [_look(vertices, faces, camera, size) for camera, size in _cameras(vertices, DETAIL * step)]
    samples = np.concatenate([_measured(view) for view in views])
    grid = _grid_around(samples, step, rng)
    drawn, triangles = _drawn(_fused(views, samples, grid, TRUNCATED * step), grid)
    drawn, triangles = _tidied(drawn, triangles)
    drawn = _relaxed(drawn, triangles)
    seen = np.unique(np.concatenate([view.face[view.cosine > 0] for view in views]))
    squared, nearest, closest = Closest(vertices, faces[seen])(drawn)
    triangles = _without_slivers(closest, triangles[(squared < spacing**2)[triangles].all(1)], SHORT * spacing)
    kept, triangles = _tidied(np.arange(len(drawn)), triangles)
    places = seen[nearest[kept]]
    corners = vertices[faces[places]]
    weights = barycentric(closest[kept], corners)
    return Resurfaced(np.einsum("vk,vkc->vc", weights, corners), triangles, places, weights)


def _cameras(vertices: np.ndarray, pixel: float):
    """Cameras around the face and the size of their pictures; a pixel covers `pixel` mm."""
    low, high = vertices.min(0), vertices.max(0)
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    side = int(np.ceil(2 * reach * DISTANCE / (DISTANCE - reach) / pixel)) + 2
    focal = DISTANCE / pixel
    intrinsics = np.array([[focal, 0, (side - 1) / 2], [0, focal, (side - 1) / 2], [0, 0, 1.0]])
    for pitch, yaws in VIEWS:
        for yaw in yaws:
            p, y = np.deg2rad([pitch, yaw])
            towards = np.array([np.sin(y) * np.cos(p), np.sin(p), np.cos(y) * np.cos(p)])
            yield Camera(intrinsics, look_at(middle + DISTANCE * towards, middle)), (side, side)


def _look(vertices: np.ndarray, faces: np.ndarray, camera: Camera, size: tuple[int, int]) -> _View:
    seen = rasterize(vertices, faces, camera, size)
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    sight = camera.position - vertices[faces].mean(1)
    scale = np.linalg.norm(normals, axis=1) * np.linalg.norm(sight, axis=1)
    cosine = (normals * sight).sum(1) / np.maximum(scale, 1e-30)
    cosine = np.where(cosine > GRAZING, cosine, 0)  # a back that shows through an open neck is not measured either
    return _View(camera, seen.depth, np.where(seen.face >= 0, cosine[seen.face], 0), seen.face)


def _measured(view: _View) -> np.ndarray:
    """The points (P, 3) that a depth map measures, mm."""
    row, column = np.nonzero(view.cosine)
    rays = np.stack([column, row, np.ones(len(row))], axis=1) @ np.linalg.inv(view.camera.intrinsics).T
    rotation, shift = view.camera.pose[:3, :3], view.camera.pose[:3, 3]
    return (rays * view.depth[row, column, None] - shift) @ rotation


def _grid_around(samples: np.ndarray, step: float, rng: np.random.Generator) -> _Grid:
    """A grid in a random direction that holds the samples (P, 3) and a margin."""
    axes = step * Rotation.from_quat(rng.normal(size=4)).as_matrix()
    local = samples @ np.linalg.inv(axes)
    low = np.floor(local.min(0)) - 3 - rng.uniform(size=3)
    shape = tuple(int(n) for n in np.ceil(local.max(0) - low) + 4)
    return _Grid(low @ axes, axes, shape)


def _fused(views: list[_View], samples: np.ndarray, grid: _Grid, reach: float) -> np.ndarray:
    """Signed distances at the nodes of the grid near the samples, positive outside, mm; NaN elsewhere."""
    near = np.zeros(grid.shape, dtype=bool)
    node = np.round((samples - grid.origin) @ np.linalg.inv(grid.axes)).astype(np.int64)
    near.reshape(-1)[np.ravel_multi_index(tuple(node.T), grid.shape)] = True
    near = binary_dilation(near, np.ones((3, 3, 3), dtype=bool))
    places = np.argwhere(near)
    points = grid.points(places)
    total, weight = np.zeros((2, len(points)))
    for view in views:
        pixel = to_homogeneous(points, view.camera)
        depth = pixel[:, 2]
        column, row = np.round(pixel[:, :2].T / depth).astype(np.int32)
        cosine = view.cosine[row, column]
        behind = view.depth[row, column] - depth
        empty = ~np.isfinite(behind)
        distance = np.where(empty, reach, np.minimum(np.where(empty, 0, behind) * cosine, reach))
        counts = np.where(empty, GRAZING**2, np.where(distance > -reach, cosine**2, 0))
        total += counts * distance
        weight += counts
    field = np.full(grid.shape, np.nan)
    field.reshape(-1)[np.flatnonzero(near)] = np.where(weight > 0, total / np.maximum(weight, 1e-30), np.nan)
    return field


def _drawn(field: np.ndarray, grid: _Grid) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3), mm, and triangles (F, 3) where the field changes its sign: one vertex in each such cell."""
    rings, crossings = zip(*(_crossed(field, axis) for axis in range(3)), strict=True)
    ring, crossing = np.concatenate(rings), np.concatenate(crossings)
    cells, corner = np.unique(np.ravel_multi_index(tuple(ring.reshape(-1, 3).T), field.shape), return_inverse=True)
    corner = corner.ravel()
    count = np.bincount(corner, minlength=len(cells))
    sums = [np.bincount(corner, np.repeat(crossing[:, k], 4), minlength=len(cells)) for k in range(3)]
    vertices = grid.points(np.stack(sums, axis=1) / count[:, None])
    quads = corner.reshape(-1, 4)
    diagonals = np.linalg.norm(vertices[quads[:, :2]] - vertices[quads[:, 2:]], axis=2)
    turned = np.where((diagonals[:, :1] > diagonals[:, 1:]), np.roll(quads, -1, axis=1), quads)
    return vertices, np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])


def _crossed(field: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """For each edge along an axis on which the sign changes: its four cells (E, 4, 3), in turn, and where (E, 3)."""
    along, u, v = np.roll(np.eye(3, dtype=np.int64), -axis, axis=0)
    before, after = [slice(None)] * 3, [slice(None)] * 3
    before[axis], after[axis] = slice(None, -1), slice(1, None)
    start = np.argwhere(field[tuple(before)] * field[tuple(after)] < 0)  # not where either is NaN
    low, high = field[tuple(start.T)], field[tuple((start + along).T)]
    crossing = start + along * (low / (low - high))[:, None]
    ring = np.stack([start - u - v, start - v, start, start - u], axis=1)
    ring[low > 0] = ring[low > 0, ::-1]
    return ring, crossing


def _without_slivers(vertices: np.ndarray, triangles: np.ndarray, short: float) -> np.ndarray:
    """Triangles (F, 3) in which the ends of edges shorter than `short`, mm, are one vertex."""
    pairs = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    pairs = pairs[np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1) < short]
    links = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(len(vertices),) * 2)
    group = connected_components(links, directed=False)[1]
    leader = np.zeros(len(vertices), dtype=np.int64)
    leader[group[::-1]] = np.arange(len(vertices))[::-1]
    triangles = leader[group[triangles]]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def _tidied(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Without edges of three and more triangles, small islands, and vertices that no triangle uses."""
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, label, count = np.unique(edges @ [len(vertices), 1], return_inverse=True, return_counts=True)
    triangles = triangles[(count[label.reshape(-1, 3)] <= 2).all(1)]
    piece = parts(triangles, len(vertices))[triangles[:, 0]]
    triangles = triangles[np.bincount(piece)[piece] >= ISLAND]
    used, renumbered = np.unique(triangles, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)


def _relaxed(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Each vertex moved half-way to the middle of its neighbors, some rounds; borders stay."""
    pairs = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    ones = np.ones(2 * len(pairs))
    graph = csr_matrix((ones, np.concatenate([pairs, pairs[:, ::-1]]).T), shape=(len(vertices),) * 2)
    border = np.zeros(len(vertices), dtype=bool)
    border[graph.tocoo().row[graph.tocoo().data == 1]] = True
    graph.data[:] = 1
    degree = np.asarray(graph.sum(1))
    for _ in range(RELAXED):
        vertices = np.where(border[:, None], vertices, (vertices + graph @ vertices / degree) / 2)
    return vertices
