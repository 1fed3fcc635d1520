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
SAME_TURN = 0.7  # if the cosine between their normals is not less: lids that meet are as near, and turned away


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
def shade(
    corners, faces, face, nearness, table,
    image, uv, uv_faces,
    slopes, relief_uv, relief_uv_faces, directions, tangent_faces, signs,
    scene, shadow, top, out,
):  # fmt: skip
    """Paint a band of a picture over its background, `out` (H, W, 3), sRGB, from a z-buffer of twice the size.

    A pixel whose four samples lie on one surface is shaded once, in its middle and on the face nearest to the camera;
    at an edge, and where surfaces meet, each sample is shaded. `top` is the picture's row in
    which the band starts.
    """
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            covered, even, nearest = _survey(face, nearness, 2 * y, 2 * x, table, faces)
            if covered == 0:
                continue
            samples = 1 if even else 4
            red, green, blue = 0.0, 0.0, 0.0
            for n in range(samples):
                right, down = (0.5, 0.5) if even else (n % 2, n // 2)
                f = nearest if even else face[2 * y + n // 2, 2 * x + n % 2]
                if f < 0:
                    r, g, b = LINEAR[out[y, x, 0]], LINEAR[out[y, x, 1]], LINEAR[out[y, x, 2]]
                else:
                    back, weights = _weights(corners, faces, f, 2 * x + right, 2 * (y + top) + down)
                    point, normal = (
                        _mixed3(table, POSITION, faces, f, weights),
                        _mixed3(table, NORMAL, faces, f, weights),
                    )
                    if len(uv_faces) > 0:
                        s, t = _mixed(uv, 0, uv_faces, f, weights), _mixed(uv, 1, uv_faces, f, weights)
                        color = _texel(image, s, t)
                    else:
                        color = _mixed3(table, COLOR, faces, f, weights)
                    if len(tangent_faces) > 0:
                        s = _mixed(relief_uv, 0, relief_uv_faces, f, weights)
                        t = _mixed(relief_uv, 1, relief_uv_faces, f, weights)
                        along = _mixed3(directions, 0, tangent_faces, f, weights)
                        normal = bent(normal, along, signs[f], _slope(slopes, s, t))
                    sky = _mixed(table, SKY, faces, f, weights)
                    r, g, b = light(point, normal, color, sky, back, scene, shadow)
                red, green, blue = red + r / samples, green + g / samples, blue + b / samples
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = _byte(red), _byte(green), _byte(blue)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _survey(face, nearness, row, column, table, faces):
    """How many of a pixel's four samples see something, whether all see one surface, and the face nearest to them."""
    near, far, covered, nearest = 0.0, np.inf, 0, -1
    for s in range(4):
        y, x = row + s // 2, column + s % 2
        covered += face[y, x] >= 0
        far = min(far, nearness[y, x])
        if nearness[y, x] > near:
            near, nearest = nearness[y, x], face[y, x]
    even = covered == 4 and near < far * (1 + SAME_DEPTH)
    for s in range(4):
        f = face[row + s // 2, column + s % 2]
        even = even and (f == nearest or _cosine(table, faces[nearest, 0], faces[f, 0]) > SAME_TURN)
    return covered, even, nearest


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _cosine(table, i, j):
    """The cosine between the normals of two vertices."""
    return (
        table[i, NORMAL] * table[j, NORMAL]
        + table[i, NORMAL + 1] * table[j, NORMAL + 1]
        + table[i, NORMAL + 2] * table[j, NORMAL + 2]
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _byte(linear):
    return PIXELS[int(min(max(linear, 0.0), 1.0) * (STEPS - 1) + 0.5)]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _weights(corners, faces, f, x, y):
    """Whether the back of face `f` is seen, and the barycentric coordinates of the place in it nearest to a pixel."""
    u, v, w, back = weights_at(corners, faces[f, 0], faces[f, 1], faces[f, 2], x, y)
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    scale = 1 / (u + v + w)
    return back, (u * scale, v * scale, w * scale)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _mixed(table, column, faces, f, weights):
    """A column of a table between the three rows of a face."""
    u, v, w = weights
    return u * table[faces[f, 0], column] + v * table[faces[f, 1], column] + w * table[faces[f, 2], column]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _mixed3(table, column, faces, f, weights):
    """Three columns of a table, from `column`, between the three rows of a face."""
    return (
        _mixed(table, column, faces, f, weights),
        _mixed(table, column + 1, faces, f, weights),
        _mixed(table, column + 2, faces, f, weights),
    )


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _texel(image, s, t):
    """Bilinear look-up of an image (H, W, 3), sRGB, at texture coordinates with v up; the border goes on."""
    left, right, top, low, a, b = _four_texels(image, s, t)
    red, green, blue = 0.0, 0.0, 0.0
    for row, column, part in ((top, left, (1 - a) * (1 - b)), (top, right, a * (1 - b)),
                              (low, left, (1 - a) * b), (low, right, a * b)):  # fmt: skip
        red += part * LINEAR[image[row, column, 0]]
        green += part * LINEAR[image[row, column, 1]]
        blue += part * LINEAR[image[row, column, 2]]
    return red, green, blue


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _slope(slopes, s, t):
    """Bilinear look-up of slopes (H, W, 2), as of an image."""
    left, right, top, low, a, b = _four_texels(slopes, s, t)
    along, up = 0.0, 0.0
    for row, column, part in ((top, left, (1 - a) * (1 - b)), (top, right, a * (1 - b)),
                              (low, left, (1 - a) * b), (low, right, a * b)):  # fmt: skip
        along += part * slopes[row, column, 0]
        up += part * slopes[row, column, 1]
    return along, up


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _four_texels(image, s, t):
    """The columns and rows of the texels round a place, and how far it lies between them."""
    height, width = image.shape[0], image.shape[1]
    x = min(max(s * width - 0.5, 0.0), width - 1.0)
    y = min(max((1 - t) * height - 0.5, 0.0), height - 1.0)
    left, top = int(x), int(y)
    return left, min(left + 1, width - 1), top, min(top + 1, height - 1), x - left, y - top


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def bent(normal, along, sign, slope):
    """A normal that leans by slopes along u and v; `along` is the direction of u, `sign` as in `Tangents`."""
    nx, ny, nz = _unit(normal[0], normal[1], normal[2])
    off = nx * along[0] + ny * along[1] + nz * along[2]
    tx, ty, tz = _unit(along[0] - off * nx, along[1] - off * ny, along[2] - off * nz)
    u, v = slope[0], sign * slope[1]
    return (
        nx + u * tx + v * (ny * tz - nz * ty),
        ny + u * ty + v * (nz * tx - nx * tz),
        nz + u * tz + v * (nx * ty - ny * tx),
    )


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def light(point, normal, color, sky, back, scene, shadow):
    """The light (red, green, blue) that leaves a point towards the camera.

    Diffuse light wraps around the form, the red most, as it does under skin. The inside of the surface turns its
    normal and is dark.
    """
    side = -1.0 if back else 1.0
    nx, ny, nz = _unit(side * normal[0], side * normal[1], side * normal[2])
    vx, vy, vz = _unit(scene[EYE] - point[0], scene[EYE + 1] - point[1], scene[EYE + 2] - point[2])
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
        if facing > 0:
            towards = max(2 + 2 * (lx * vx + ly * vy + lz * vz), 1e-24)  # squared length of light plus view
            grazing = min(4 * facing, 1.0)  # a highlight fades where the light sinks, or its end would be a line
            shine += strength * grazing * _highlight((facing + nx * vx + ny * vy + nz * vz) / np.sqrt(towards))
    shine *= scene[GLOSS]
    paint = INSIDE if back else 1.0
    return (
        _roll_off(paint * color[0] * red + shine),
        _roll_off(paint * color[1] * green + shine),
        _roll_off(paint * color[2] * blue + shine),
    )


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _highlight(half):
    """How much a surface shines whose normal meets the direction halfway between light and view with this cosine."""
    if half <= 0.6:
        return 0.0
    h2 = half * half
    h4 = h2 * h2
    h8 = h4 * h4
    h16 = h8 * h8
    return 0.6 * h8 * h4 * h2 + 0.4 * h16 * h16 * h16  # to the power of 14 and 48


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _unit(x, y, z):
    scale = 1 / np.sqrt(max(x * x + y * y + z * z, 1e-24))
    return x * scale, y * scale, z * scale


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
def _roll_off(value):
    """Bright light is compressed as film does it, so that highlights keep their form."""
    return min(1.12 * value / (1 + 0.2 * value), 1.0)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", forceinline=True)
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
