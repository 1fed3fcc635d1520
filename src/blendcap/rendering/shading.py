"""From what a pixel sees to its color: a studio with a key light that casts shadows, a fill, a rim and a sky."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from blendcap.rendering.color import LINEAR
from blendcap.rendering.rasterize import edges, weights_at

# columns of the table of what is interpolated over a triangle
POSITION, NORMAL, COLOR, SKY, WIDTH = 0, 3, 6, 9, 10
SAME_DEPTH = 1.5e-3  # samples of a pixel that differ by less, relative to the depth, lie on one surface


@dataclass(frozen=True)
class Light:
    """The studio. Directions are as the camera sees them: +x to the right of the picture, +y up, +z towards the camera.

    Parameters
    ----------
    key, fill, rim : (x, y, z)
        Where the lights stand; the length does not matter.
    strengths : (key, fill, rim, sky)
        Of white light on white paper that faces it.
    gloss : float
        Strength of the highlights; 0 for a matt surface.
    """

    key: tuple[float, float, float] = (-0.55, 0.62, 0.80)
    fill: tuple[float, float, float] = (0.85, 0.10, 0.55)
    rim: tuple[float, float, float] = (0.45, 0.45, -0.85)
    strengths: tuple[float, float, float, float] = (0.78, 0.22, 0.35, 0.46)
    gloss: float = 0.22

    def directions(self, camera_rotation: np.ndarray) -> np.ndarray:
        """Unit vectors (3, 3) towards key, fill and rim in the world, for a camera with this rotation (3, 3)."""
        lights = np.array([self.key, self.fill, self.rim], dtype=np.float64) * [1, -1, -1]  # to OpenCV's axes
        return lights / np.linalg.norm(lights, axis=1, keepdims=True) @ camera_rotation


@njit(cache=True, nogil=True)
def shade(corners, faces, face, nearness, table, texture, scene, shadow, backdrop, top, bottom, out):
    """Write rows `top` to `bottom` of `out` (H, W, 3), linear 0 to 1, from a z-buffer of twice the size.

    The four samples of a pixel are shaded as one where they lie on one surface, and each for itself where they do not.
    """
    sample, mean = np.empty(WIDTH), np.empty(WIDTH)
    color = np.empty(3)
    for y in range(top, bottom):
        for x in range(out.shape[1]):
            out[y, x] = 0
            near, far, covered, alike = 0.0, np.inf, 0, True
            first = face[2 * y, 2 * x]
            for s in range(4):
                row, column = 2 * y + s // 2, 2 * x + s % 2
                covered += face[row, column] >= 0
                alike = alike and face[row, column] == first
                near, far = max(near, nearness[row, column]), min(far, nearness[row, column])
            if covered == 0:
                out[y, x] = backdrop[y, x]
            elif covered == 4 and alike:
                look_up(corners, faces, first, 2 * x + 0.5, 2 * y + 0.5, table, texture, mean)
                light(mean, scene, shadow, color)
                out[y, x] = color
            elif covered == 4 and near < far * (1 + SAME_DEPTH):
                mean[:] = 0
                for s in range(4):
                    row, column = 2 * y + s // 2, 2 * x + s % 2
                    look_up(corners, faces, face[row, column], column, row, table, texture, sample)
                    mean += sample / 4
                light(mean, scene, shadow, color)
                out[y, x] = color
            else:
                for s in range(4):
                    row, column = 2 * y + s // 2, 2 * x + s % 2
                    if face[row, column] < 0:
                        out[y, x] += backdrop[y, x] / 4
                    else:
                        look_up(corners, faces, face[row, column], column, row, table, texture, sample)
                        light(sample, scene, shadow, color)
                        out[y, x] += color / 4


@njit(cache=True, nogil=True)
def look_up(corners, faces, f, x, y, table, texture, out):
    """Interpolate the table at a pixel of face `f`; the inside of the surface turns its normal and is dark."""
    i, j, k = faces[f]
    u, v, w = weights_at(corners, i, j, k, x, y)
    for c in range(WIDTH):
        out[c] = u * table[i, c] + v * table[j, c] + w * table[k, c]
    image, uv, uv_faces = texture
    if len(uv_faces):
        i_uv, j_uv, k_uv = uv_faces[f]
        s = u * uv[i_uv, 0] + v * uv[j_uv, 0] + w * uv[k_uv, 0]
        t = u * uv[i_uv, 1] + v * uv[j_uv, 1] + w * uv[k_uv, 1]
        _texel(image, s, t, out)
    if edges(corners, i, j, k)[3] > 0:
        out[NORMAL : NORMAL + 3] *= -1
        out[COLOR : COLOR + 3] *= 0.15


@njit(cache=True, nogil=True)
def _texel(image, s, t, out):
    """Bilinear look-up of an image (H, W, 3), sRGB, at texture coordinates with v up; the border goes on."""
    height, width = image.shape[:2]
    x = min(max(s * width - 0.5, 0.0), width - 1.0)
    y = min(max((1 - t) * height - 0.5, 0.0), height - 1.0)
    left, top = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
    right, low = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = x - left, y - top
    for c in range(3):
        upper = (1 - a) * LINEAR[image[top, left, c]] + a * LINEAR[image[top, right, c]]
        lower = (1 - a) * LINEAR[image[low, left, c]] + a * LINEAR[image[low, right, c]]
        out[COLOR + c] = (1 - b) * upper + b * lower


@njit(cache=True, nogil=True)
def light(point, scene, shadow, out):
    """The light (3,) that leaves a point of the table towards the camera.

    Diffuse light wraps around the form, the red most, as it does under skin.
    """
    eye, directions, strengths, gloss = scene
    nx, ny, nz = point[3], point[4], point[5]
    length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
    nx, ny, nz = nx / length, ny / length, nz / length
    vx, vy, vz = eye[0] - point[0], eye[1] - point[1], eye[2] - point[2]
    length = max(np.sqrt(vx * vx + vy * vy + vz * vz), 1e-12)
    vx, vy, vz = vx / length, vy / length, vz / length
    sky = point[SKY]
    dome = strengths[3] * (0.72 + 0.28 * ny) * sky
    red, green, blue = dome * 0.97, dome, dome * 1.05
    shine = 0.0
    for n in range(3):
        lx, ly, lz = directions[n]
        facing = nx * lx + ny * ly + nz * lz
        if facing < -0.28:
            continue
        strength = strengths[n] * (_lit(point, facing, shadow) if n == 0 else 0.35 + 0.65 * sky)
        red += strength * max(facing + 0.28, 0.0) / 1.28
        green += strength * max(facing + 0.16, 0.0) / 1.16
        blue += strength * max(facing + 0.12, 0.0) / 1.12
        if facing > 0 and gloss > 0:
            hx, hy, hz = lx + vx, ly + vy, lz + vz
            half = (nx * hx + ny * hy + nz * hz) / np.sqrt(max(hx * hx + hy * hy + hz * hz, 1e-12))
            if half > 0.6:
                shine += strength * (0.6 * half**14 + 0.4 * half**48)
    shine *= gloss
    out[0] = _roll_off(point[6] * red + shine)
    out[1] = _roll_off(point[7] * green + shine)
    out[2] = _roll_off(point[8] * blue + shine)


@njit(cache=True, nogil=True)
def _roll_off(value):
    """Bright light is compressed as film does it, so that highlights keep their form."""
    return min(1.12 * value / (1 + 0.2 * value), 1.0)


@njit(cache=True, nogil=True)
def _lit(point, facing, shadow):
    """The share of the key light, 0 to 1, that reaches a point: nine texels of its depth map."""
    projection, nearness, texel = shadow
    if len(nearness) == 0:
        return 1.0
    x = projection[0, 0] * point[0] + projection[0, 1] * point[1] + projection[0, 2] * point[2] + projection[0, 3]
    y = projection[1, 0] * point[0] + projection[1, 1] * point[1] + projection[1, 2] * point[2] + projection[1, 3]
    z = projection[2, 0] * point[0] + projection[2, 1] * point[1] + projection[2, 2] * point[2] + projection[2, 3]
    column, row = int(np.round(x / z)), int(np.round(y / z))
    if row < 1 or column < 1 or row >= len(nearness) - 1 or column >= len(nearness) - 1:
        return 1.0
    slack = texel * (0.5 + 1.5 / max(facing, 0.15))  # a slope lies behind itself by more
    free = 0
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            free += nearness[r, c] * (z - slack) < 1
    return free / 9
