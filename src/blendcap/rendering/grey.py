"""Grey pictures under small lights that stand near the face, fast: what a head-mounted camera sees.

A light's strength falls with the square of the distance, with the cosine at the surface and with a power of the cosine
at the light. Nothing casts a shadow: a ring light around the lens lights what the lens sees. The inside of the
surface is not drawn. Light is found at the
vertices and is smooth between them; the texture and the edges are as sharp as the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from blendcap.data import Camera
from blendcap.numerics.surfaces import vertex_normals
from blendcap.rendering.camera import to_homogeneous
from blendcap.rendering.rasterize import edges, fill, line_up

# columns of the table of what is interpolated over a triangle
DIFFUSE, SHINE, ALBEDO, WIDTH = 0, 1, 2, 3
# columns of a light
AXIS, STRENGTH, POWER = 3, 6, 7
AWAY = -0.6  # cosine between the direction of the camera and the normal of a vertex that nobody sees
# places of the samples in a pixel, so that three pictures a frame also smooth its edges
MOMENT = 8**-0.5  # of the exposure, before and after its middle: a streak spreads light as far as one without gaps
JITTER = 0.22 * np.array([[1, -1], [-2, 2], [1, -1]])  # in no step with the moments, or it would bend a streak


@dataclass(frozen=True, eq=False)
class GreySurface:
    """A surface in grey, ready to be seen in any pose.

    Parameters
    ----------
    faces : (F, 3) int64
    albedo, sky, gloss : (V,) float64
        Reflectance, openness to the ambient light and strength of the highlights of each vertex.
    uv : (U, 2) float64, uv_faces : (F, 3) int64
        Texture coordinates, v up.
    texture : (H, W) uint8
        Reflectance in uv, 255 for 1, which takes the place of `albedo`; empty if there is none.
    paint : (H, W) uint8
        How much each place of the texture is covered with paint, 255 for all.
    painted : (F,) bool
        The faces that may wear paint.
    reflectance : float
        Of the paint; more than 1 if it sends light back to where it comes from.
    """

    faces: np.ndarray
    albedo: np.ndarray
    sky: np.ndarray
    gloss: np.ndarray
    uv: np.ndarray
    uv_faces: np.ndarray
    texture: np.ndarray
    paint: np.ndarray
    painted: np.ndarray
    reflectance: float = 1.0

    def picture(
        self,
        vertices: np.ndarray,
        camera: Camera,
        size: tuple[int, int],
        lights: np.ndarray,
        *,
        ambient: float = 0.0,
        shift: np.ndarray | None = None,
    ) -> np.ndarray:
        """Light that reaches the sensor, (H, W) float32: 1 from white paper at a light's distance of strength 1.

        Parameters
        ----------
        vertices : (V, 3) float64
            mm, in the middle of the exposure.
        size : (width, height)
        lights : (L, 8)
            Position, direction, strength (mm^2: what paper reflects times the squared distance), power of the cosine.
        ambient : float
            Light from everywhere.
        shift : (V, 3) float64, optional
            How far the vertices move during the exposure, mm; the picture is the mean of three moments.
        """
        vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        table = np.empty((len(vertices), WIDTH))
        table[:, ALBEDO] = self.albedo
        normals = vertex_normals(vertices, self.faces)
        lights = np.ascontiguousarray(lights, dtype=np.float64)
        _light(vertices, normals, self.sky, self.gloss, camera.position, lights, ambient, table)
        middle = to_homogeneous(vertices, camera)
        step = np.zeros_like(middle) if shift is None else to_homogeneous(vertices + MOMENT * shift, camera) - middle
        shape = (size[1], size[0])
        out = np.zeros(shape, dtype=np.float32)
        buffers = (np.empty(shape, dtype=np.int32), np.empty(shape))
        look = (self.texture, self.paint, self.painted, self.uv, self.uv_faces, self.reflectance)
        for moment, (x, y) in zip((-1, 0, 1), JITTER, strict=True):
            corners = middle + moment * step
            corners[:, 0] += x * corners[:, 2]
            corners[:, 1] += y * corners[:, 2]
            _expose(corners, self.faces, table, *look, 1 / len(JITTER), *buffers, out)
        return out


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _expose(corners, faces, table, texture, paint, painted, uv, uv_faces, reflectance, share, face, nearness, out):
    """Add one moment's picture, times `share`, to `out` (H, W)."""
    height, width = out.shape
    queue, fronts, _ = line_up(corners, faces, width, height)
    fill(corners, faces, queue, fronts, 0, 0, face, nearness)  # the backs of faces are not drawn
    textured = len(texture) > 0
    values, texels = np.empty((3, WIDTH)), np.empty((3, 2))
    for y in range(height):
        last = -1
        for x in range(width):
            f = face[y, x]
            if f < 0:
                continue
            if f != last:  # neighbors mostly see the same face
                e0, e1, e2, _ = edges(corners, faces[f, 0], faces[f, 1], faces[f, 2])
                for corner in range(3):
                    for column in range(WIDTH):
                        values[corner, column] = table[faces[f, corner], column]
                    for column in range(2):
                        texels[corner, column] = uv[uv_faces[f, corner], column]
                last = f
            u, v = e0[0] * x + (e0[1] * y + e0[2]), e1[0] * x + (e1[1] * y + e1[2])
            w = e2[0] * x + (e2[1] * y + e2[2])
            scale = 1 / (u + v + w)
            u, v, w = u * scale, v * scale, w * scale
            diffuse = u * values[0, DIFFUSE] + v * values[1, DIFFUSE] + w * values[2, DIFFUSE]
            shine = u * values[0, SHINE] + v * values[1, SHINE] + w * values[2, SHINE]
            albedo, cover = u * values[0, ALBEDO] + v * values[1, ALBEDO] + w * values[2, ALBEDO], 0.0
            if textured or painted[f]:
                s = u * texels[0, 0] + v * texels[1, 0] + w * texels[2, 0]
                t = u * texels[0, 1] + v * texels[1, 1] + w * texels[2, 1]
                if textured:
                    albedo = _texel(texture, s, t)
                if painted[f]:
                    cover = _texel(paint, s, t)
            albedo += cover * (reflectance - albedo)
            out[y, x] += share * (albedo * diffuse + (1 - cover) * shine)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _light(vertices, normals, sky, gloss, eye, lights, ambient, table):
    """Write what all lights bring to each vertex, and of that what a rough mirror sends to the camera."""
    for p in range(len(vertices)):
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        vx, vy, vz = _unit(eye[0] - vertices[p, 0], eye[1] - vertices[p, 1], eye[2] - vertices[p, 2])[:3]
        diffuse, shine = ambient * sky[p], 0.0
        turned = nx * vx + ny * vy + nz * vz < AWAY  # no face that it belongs to is seen
        for n in range(0 if turned else len(lights)):
            lx, ly, lz, square = _unit(
                lights[n, 0] - vertices[p, 0], lights[n, 1] - vertices[p, 1], lights[n, 2] - vertices[p, 2]
            )
            facing = nx * lx + ny * ly + nz * lz
            leaving = -(lights[n, AXIS] * lx + lights[n, AXIS + 1] * ly + lights[n, AXIS + 2] * lz)
            if facing <= 0 or leaving <= 0:
                continue
            power = lights[n, POWER]
            arriving = lights[n, STRENGTH] / square * facing * (leaving if power == 1 else leaving**power)
            hx, hy, hz = _unit(lx + vx, ly + vy, lz + vz)[:3]
            diffuse += arriving
            shine += arriving * _highlight(nx * hx + ny * hy + nz * hz)
        table[p, DIFFUSE], table[p, SHINE] = diffuse, gloss[p] * shine


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _highlight(half):
    """The cosine between the normal and the middle of light and view, to the power of 24."""
    h2 = max(half, 0.0) ** 2
    h8 = h2 * h2 * h2 * h2
    return h8 * h8 * h8


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _unit(x, y, z):
    """The direction of a vector, and its squared length."""
    square = max(x * x + y * y + z * z, 1e-24)
    scale = 1 / np.sqrt(square)
    return x * scale, y * scale, z * scale, square


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _texel(image, s, t):
    """Bilinear look-up of an image (H, W), 0 to 1, at texture coordinates with v up; the border goes on."""
    height, width = image.shape[0], image.shape[1]
    x = min(max(s * width - 0.5, 0.0), width - 1.0)
    y = min(max((1 - t) * height - 0.5, 0.0), height - 1.0)
    left, top = int(x), int(y)
    right, low = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = x - left, y - top
    upper = (1 - a) * image[top, left] + a * image[top, right]
    lower = (1 - a) * image[low, left] + a * image[low, right]
    return ((1 - b) * upper + b * lower) / 255
