"""Which triangle each pixel sees: a z-buffer in homogeneous coordinates.

Edge functions are cross products of the triangle's corners in homogeneous pixels (x z, y z, z), after Olano and
Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates" (1997). So nothing needs clipping: a triangle may
reach behind the camera. The three edge values over their sum are the perspective-correct barycentric coordinates, and
their sum over the determinant is one over the depth. Two triangles that share an edge compute exactly opposite values
on it, so that with a tie rule each pixel on the edge belongs to exactly one of them.

Triangles that turn their back come last: on a closed surface the front has hidden them, and the farthest depth of each
tile of pixels says so before a pixel is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from blendcap.data import Camera
from blendcap.rendering.camera import to_homogeneous
from blendcap.rendering.parallel import each_band

NEAR = 1e-3  # mm; what is nearer to the camera is not seen
BAND = 144  # rows that one thread fills at a time
TILE = 16  # pixels, of a side
ABOVE_ZERO = 2.3e-308  # smaller than any edge function that is not zero


@dataclass(frozen=True, eq=False)
class Fragments:
    """What each pixel sees.

    Parameters
    ----------
    depth : (H, W) float64
        Distance along the camera's axis, mm; infinite where nothing is seen.
    face : (H, W) int32
        The triangle; -1 where nothing is seen.
    barycentric : (H, W, 3) float64
        Perspective-correct weights of the triangle's corners; 0 where nothing is seen.
    """

    depth: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray


def rasterize(vertices: np.ndarray, faces: np.ndarray, camera: Camera, size: tuple[int, int]) -> Fragments:
    """The nearest triangle at the centre of each pixel.

    Parameters
    ----------
    vertices : (V, 3)
        mm.
    faces : (F, 3)
        Both sides are seen.
    size : (width, height)
        Pixels; the centre of the first one is at (0, 0).
    """
    corners = to_homogeneous(vertices, camera)
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    face, nearness = visibility(corners, faces, size)
    barycentric = np.zeros((*face.shape, 3))
    each_band(len(face), BAND, lambda start, stop: _barycentric(corners, faces, face, start, stop, barycentric))
    with np.errstate(divide="ignore"):
        return Fragments(1 / nearness, face, barycentric)


def visibility(corners: np.ndarray, faces: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The triangle (H, W) int32, -1 for none, and one over its depth (H, W): 0 for none.

    `corners` (V, 3) come from `to_homogeneous`.
    """
    width, height = size
    face, nearness = np.empty((height, width), dtype=np.int32), np.empty((height, width))
    queue = line_up(corners, faces, width, height)
    each_band(height, BAND, lambda top, stop: fill(corners, faces, *queue, top, face[top:stop], nearness[top:stop]))
    return face, nearness


@njit(cache=True, nogil=True, error_model="numpy")
def line_up(corners, faces, width, height):
    """Queue the triangles that may be seen: (F, 5) face, first and last column, first and last row.

    Those that show their front stand at the start, those that show their back at the end, in reverse; the numbers of
    both follow.
    """
    pixels = np.empty((len(corners), 2))
    for v in range(len(corners)):
        depth = corners[v, 2]
        pixels[v, 0] = corners[v, 0] / depth if depth > NEAR else np.inf
        pixels[v, 1] = corners[v, 1] / depth if depth > NEAR else np.inf
    queue = np.empty((len(faces), 5), dtype=np.int32)
    fronts, backs = 0, 0
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if corners[i, 2] <= NEAR and corners[j, 2] <= NEAR and corners[k, 2] <= NEAR:
            continue
        left, right = _span(pixels[i, 0], pixels[j, 0], pixels[k, 0], width)
        top, bottom = _span(pixels[i, 1], pixels[j, 1], pixels[k, 1], height)
        if left > right or top > bottom:
            continue
        det = edges(corners, i, j, k)[3]
        if not abs(det) > 0:  # seen exactly from its edge, or not a number
            continue
        place = fronts if det < 0 else len(faces) - 1 - backs
        fronts, backs = fronts + (det < 0), backs + (det > 0)
        queue[place, 0], queue[place, 1], queue[place, 2], queue[place, 3], queue[place, 4] = (
            f,
            left,
            right,
            top,
            bottom,
        )
    return queue, fronts, backs


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _span(a, b, c, stop):
    """First and last pixel along an axis that a triangle may cover; all of them where it reaches behind the camera."""
    low, high = min(a, b, c), max(a, b, c)
    if not high - low < np.inf:
        return 0, stop - 1
    first = min(max(np.ceil(low - 1e-9), 0), stop)  # clamped before the whole number: a far corner may be at 1e20
    return int(first), int(max(min(np.floor(high + 1e-9), stop - 1), -1))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def edges(corners, i, j, k):
    """The three edge functions (a, b, c) of a triangle, for `a x + b y + c`, and its determinant."""
    x0, y0, z0 = corners[i, 0], corners[i, 1], corners[i, 2]
    x1, y1, z1 = corners[j, 0], corners[j, 1], corners[j, 2]
    x2, y2, z2 = corners[k, 0], corners[k, 1], corners[k, 2]
    e0 = (y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2)
    e1 = (y2 * z0 - z2 * y0, z2 * x0 - x2 * z0, x2 * y0 - y2 * x0)
    e2 = (y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1)
    return e0, e1, e2, x0 * e0[0] + y0 * e0[1] + z0 * e0[2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _least(a, b):
    """The least value inside an edge; what is exactly on it belongs to the triangle that has it on its left or top."""
    return 0.0 if a > 0 or (a == 0 and b > 0) else ABOVE_ZERO


@njit(cache=True, nogil=True, error_model="numpy")
def fill(corners, faces, queue, fronts, backs, start, face, nearness):
    """Write the rows from `start` of a z-buffer: `face` (H, W), and one over the depth, `nearness` (H, W)."""
    height, width = face.shape
    face[:], nearness[:] = -1, 0.0
    tiles = np.zeros(((height - 1) // TILE + 1, (width - 1) // TILE + 1))
    for n in range(fronts + backs):
        if n == fronts:
            _farthest(nearness, tiles)
        place = n if n < fronts else len(queue) - 1 - (n - fronts)
        top, bottom = max(queue[place, 3] - start, 0), min(queue[place, 4] - start, height - 1)
        if top > bottom:
            continue
        f, left, right = queue[place, 0], queue[place, 1], queue[place, 2]
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if n >= fronts and _hidden(corners, i, j, k, tiles, left, right, top, bottom):
            continue
        _cover(edges(corners, i, j, k), f, left, right, top, bottom, start, face, nearness)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cover(triangle, f, left, right, top, bottom, start, face, nearness):
    """Write one triangle in a box of the z-buffer, where it is the nearest so far."""
    (a0, b0, c0), (a1, b1, c1), (a2, b2, c2), det = triangle
    if det < 0:  # seen from behind: turn all signs, so that inside is positive
        a0, b0, c0, a1, b1, c1, a2, b2, c2 = -a0, -b0, -c0, -a1, -b1, -c1, -a2, -b2, -c2
    scale = 1 / abs(det)
    least0, least1, least2 = _least(a0, b0), _least(a1, b1), _least(a2, b2)
    for y in range(top, bottom + 1):
        r0, r1, r2 = b0 * (y + start) + c0, b1 * (y + start) + c1, b2 * (y + start) + c2
        entered = False
        for x in range(left, right + 1):
            e0, e1, e2 = a0 * x + r0, a1 * x + r1, a2 * x + r2
            if (e0 >= least0) & (e1 >= least1) & (e2 >= least2):
                entered = True
                near = (e0 + e1 + e2) * scale
                if (near > nearness[y, x]) & (near < 1 / NEAR):
                    nearness[y, x] = near
                    face[y, x] = f
            elif entered:  # a triangle is convex: nothing more in this row
                break


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _farthest(nearness, tiles):
    """Write the farthest of each tile of pixels, the least `nearness`."""
    height, width = nearness.shape
    for row in range(len(tiles)):
        for column in range(tiles.shape[1]):
            least = np.inf
            for y in range(row * TILE, min((row + 1) * TILE, height)):
                for x in range(column * TILE, min((column + 1) * TILE, width)):
                    least = min(least, nearness[y, x])
            tiles[row, column] = least


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _hidden(corners, i, j, k, tiles, left, right, top, bottom):
    """Whether all of a triangle lies behind the farthest that its tiles of pixels see."""
    nearest = min(corners[i, 2], corners[j, 2], corners[k, 2])
    if not nearest > NEAR:
        return False
    for row in range(top // TILE, bottom // TILE + 1):
        for column in range(left // TILE, right // TILE + 1):
            if tiles[row, column] * nearest < 1:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def weights_at(corners, i, j, k, x, y):
    """Perspective-correct barycentric coordinates of a triangle at a pixel, and whether its back is seen."""
    (a0, b0, c0), (a1, b1, c1), (a2, b2, c2), det = edges(corners, i, j, k)
    e0, e1, e2 = a0 * x + (b0 * y + c0), a1 * x + (b1 * y + c1), a2 * x + (b2 * y + c2)
    total = e0 + e1 + e2
    return e0 / total, e1 / total, e2 / total, det > 0


@njit(cache=True, nogil=True, error_model="numpy")
def _barycentric(corners, faces, face, top, bottom, out):
    for y in range(top, bottom):
        for x in range(face.shape[1]):
            if face[y, x] >= 0:
                f = face[y, x]
                u, v, w, _ = weights_at(corners, faces[f, 0], faces[f, 1], faces[f, 2], x, y)
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = u, v, w
