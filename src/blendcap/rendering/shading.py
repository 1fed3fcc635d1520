"""From what a pixel sees to its color: a studio with a key light that casts shadows, a fill, a rim and a sky."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from blendcap.data import Camera
from blendcap.rendering.color import LINEAR, PIXELS, STEPS
from blendcap.rendering.rasterize import weights_at

# columns of the table of what is interpolated over a triangle
POSITION, NORMAL, COLOR, SKY, WIDTH = 0, 3, 6, 9, 10
# places of what the lights need in one flat array: tuples of arrays cost Numba more than the shading itself
EYE, LIGHTS, STRENGTHS, GLOSS, SHADOW, FOCAL, SCENE = 0, 3, 12, 16, 17, 29, 30
WRAP = (0.28, 0.16, 0.12)  # how far each color's light reaches around the form
INSIDE = 0.15  # of its color, where the inside of the surface is seen
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

    def scene(self, camera: Camera, shadow_camera: Camera) -> np.ndarray:
        """What the kernels need to know of lights and cameras, (SCENE,)."""
        scene = np.empty(SCENE)
        scene[EYE:LIGHTS] = camera.position
        scene[LIGHTS:STRENGTHS] = self.directions(camera.pose[:3, :3]).ravel()
        scene[STRENGTHS:GLOSS] = self.strengths
        scene[GLOSS] = self.gloss
        scene[SHADOW:FOCAL] = (shadow_camera.intrinsics @ shadow_camera.pose[:3]).ravel()
        scene[FOCAL] = shadow_camera.intrinsics[0, 0]
        return scene


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def shade(corners, faces, face, nearness, table, image, uv, uv_faces, scene, shadow, backdrop, top, bottom, out):
    """Write rows `top` to `bottom` of `out` (H, W, 3), sRGB bytes, from a z-buffer of twice the size.

    A pixel whose four samples lie on one surface is shaded once, in its middle and on the face nearest to the camera
    (a face behind may be seen from inside, and dark); at an edge each sample is shaded.
    """
    point = np.empty(WIDTH)
    for y in range(top, bottom):
        for x in range(out.shape[1]):
            near, far, covered, nearest = 0.0, np.inf, 0, -1
            for s in range(4):
                row, column = 2 * y + s // 2, 2 * x + s % 2
                covered += face[row, column] >= 0
                far = min(far, nearness[row, column])
                if nearness[row, column] > near:
                    near, nearest = nearness[row, column], face[row, column]
            if covered == 4 and near < far * (1 + SAME_DEPTH):
                look_up(corners, faces, nearest, 2 * x + 0.5, 2 * y + 0.5, table, image, uv, uv_faces, point)
                red, green, blue = light(point, scene, shadow)
            else:
                free = 1 - covered / 4
                red, green, blue = free * backdrop[y, x, 0], free * backdrop[y, x, 1], free * backdrop[y, x, 2]
                for s in range(4 if covered else 0):
                    row, column = 2 * y + s // 2, 2 * x + s % 2
                    if face[row, column] >= 0:
                        look_up(corners, faces, face[row, column], column, row, table, image, uv, uv_faces, point)
                        r, g, b = light(point, scene, shadow)
                        red, green, blue = red + r / 4, green + g / 4, blue + b / 4
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = _byte(red), _byte(green), _byte(blue)


@njit(cache=True, nogil=True, error_model="numpy")
def _byte(linear):
    return PIXELS[int(min(max(linear, 0.0), 1.0) * (STEPS - 1) + 0.5)]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def look_up(corners, faces, f, x, y, table, image, uv, uv_faces, out):
    """What the table says at a pixel in or near face `f`; the inside of the surface turns its normal and is dark."""
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    u, v, w, back = weights_at(corners, i, j, k, x, y)
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    total = u + v + w
    u, v, w = u / total, v / total, w / total
    for c in range(WIDTH):
        out[c] = u * table[i, c] + v * table[j, c] + w * table[k, c]
    if len(uv_faces) > 0:
        i, j, k = uv_faces[f, 0], uv_faces[f, 1], uv_faces[f, 2]
        s = u * uv[i, 0] + v * uv[j, 0] + w * uv[k, 0]
        t = u * uv[i, 1] + v * uv[j, 1] + w * uv[k, 1]
        _texel(image, s, t, out)
    if back:
        for c in range(NORMAL, NORMAL + 3):
            out[c] = -out[c]
        for c in range(COLOR, COLOR + 3):
            out[c] *= INSIDE


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _texel(image, s, t, out):
    """Bilinear look-up of an image (H, W, 3), sRGB, at texture coordinates with v up; the border goes on."""
    height, width = image.shape[0], image.shape[1]
    x = min(max(s * width - 0.5, 0.0), width - 1.0)
    y = min(max((1 - t) * height - 0.5, 0.0), height - 1.0)
    left, top = int(x), int(y)
    right, low = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = x - left, y - top
    for c in range(3):
        upper = (1 - a) * LINEAR[image[top, left, c]] + a * LINEAR[image[top, right, c]]
        lower = (1 - a) * LINEAR[image[low, left, c]] + a * LINEAR[image[low, right, c]]
        out[COLOR + c] = (1 - b) * upper + b * lower


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def light(point, scene, shadow):
    """The light (red, green, blue) that leaves a point of the table towards the camera.

    Diffuse light wraps around the form, the red most, as it does under skin.
    """
    gloss = scene[GLOSS]
    nx, ny, nz = _unit(point[3], point[4], point[5])
    vx, vy, vz = _unit(scene[EYE] - point[0], scene[EYE + 1] - point[1], scene[EYE + 2] - point[2])
    sky = point[SKY]
    dome = scene[STRENGTHS + 3] * (0.72 + 0.28 * ny) * sky
    red, green, blue = dome * 0.97, dome, dome * 1.05
    shine = 0.0
    for n in range(3):
        lx, ly, lz = scene[LIGHTS + 3 * n], scene[LIGHTS + 3 * n + 1], scene[LIGHTS + 3 * n + 2]
        facing = nx * lx + ny * ly + nz * lz
        if facing < -WRAP[0]:
            continue
        strength = scene[STRENGTHS + n] * (_lit(point, facing, scene, shadow) if n == 0 else 0.35 + 0.65 * sky)
        red += strength * max(facing + WRAP[0], 0.0) / (1 + WRAP[0])
        green += strength * max(facing + WRAP[1], 0.0) / (1 + WRAP[1])
        blue += strength * max(facing + WRAP[2], 0.0) / (1 + WRAP[2])
        if facing > 0 and gloss > 0:
            hx, hy, hz = _unit(lx + vx, ly + vy, lz + vz)
            half = nx * hx + ny * hy + nz * hz
            if half > 0.6:
                shine += strength * (0.6 * half**14 + 0.4 * half**48)
    shine *= gloss
    return _roll_off(point[6] * red + shine), _roll_off(point[7] * green + shine), _roll_off(point[8] * blue + shine)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _unit(x, y, z):
    scale = 1 / np.sqrt(max(x * x + y * y + z * z, 1e-24))
    return x * scale, y * scale, z * scale


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _roll_off(value):
    """Bright light is compressed as film does it, so that highlights keep their form."""
    return min(1.12 * value / (1 + 0.2 * value), 1.0)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _lit(point, facing, scene, shadow):
    """The share of the key light, 0 to 1, that reaches a point: 3 x 3 texels of its depth map, blended."""
    px, py, pz = point[0], point[1], point[2]
    x = scene[SHADOW] * px + scene[SHADOW + 1] * py + scene[SHADOW + 2] * pz + scene[SHADOW + 3]
    y = scene[SHADOW + 4] * px + scene[SHADOW + 5] * py + scene[SHADOW + 6] * pz + scene[SHADOW + 7]
    z = scene[SHADOW + 8] * px + scene[SHADOW + 9] * py + scene[SHADOW + 10] * pz + scene[SHADOW + 11]
    x, y = x / z - 1, y / z - 1
    column, row = int(np.floor(x)), int(np.floor(y))
    if row < 0 or column < 0 or row >= len(shadow) - 3 or column >= len(shadow) - 3:
        return 1.0
    a, b = x - column, y - row
    slack = z / scene[FOCAL] * (0.5 + 1.5 / max(facing, 0.15))  # a slope lies behind itself by more
    limit = 1 / (z - slack)
    free = 0.0
    for r in range(4):
        height = 1 - b if r == 0 else (b if r == 3 else 1.0)
        for c in range(4):
            if shadow[row + r, column + c] < limit:
                free += height * (1 - a if c == 0 else (a if c == 3 else 1.0))
    return free / 9
