"""A shaded, antialiased picture of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from blendcap.data import Camera, InputError, Mesh
from blendcap.rendering.appearance import SKIN
from blendcap.rendering.camera import to_homogeneous
from blendcap.rendering.color import to_linear, to_pixels
from blendcap.rendering.light import box, light_camera, openness, shadow_map
from blendcap.rendering.normals import vertex_normals
from blendcap.rendering.parallel import each_band
from blendcap.rendering.rasterize import BAND, visibility
from blendcap.rendering.shading import COLOR, NORMAL, POSITION, SKY, WIDTH, Light, shade

SHADOW_PIXELS = 640
STUDIO = (np.array([0.70, 0.73, 0.77]), np.array([0.86, 0.88, 0.90]))  # sRGB at the border and in the middle


def render(
    mesh: Mesh,
    camera: Camera,
    size: tuple[int, int],
    *,
    color: np.ndarray | tuple[float, float, float] | None = None,
    light: Light | None = None,
    background: np.ndarray | tuple[float, float, float] | None = None,
) -> np.ndarray:
    """Picture (H, W, 3) uint8, sRGB, of a mesh.

    Parameters
    ----------
    size : (width, height)
        Pixels.
    color : (3,) or (V, 3), optional
        sRGB, 0 to 1; vertices with NaN, and faces that touch one, are not drawn. Without it the mesh's texture is
        taken, or the tone of skin if it has none.
    light : Light, optional
    background : (3,) or (H, W, 3), optional
        sRGB, 0 to 1; a soft grey studio if not given.
    """
    return prepare(mesh, color).picture(camera, size, light=light, background=background)


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh made ready to be seen: what does not depend on the camera is computed once for several pictures.

    Parameters
    ----------
    vertices : (V, 3)
        mm.
    faces : (F, 3)
        Those to draw.
    table : (V, WIDTH)
        What is interpolated over the triangles: position, normal, color, openness to the sky.
    texture : (image, uv, uv_faces)
        No faces: no texture.
    """

    vertices: np.ndarray
    faces: np.ndarray
    table: np.ndarray
    texture: tuple[np.ndarray, np.ndarray, np.ndarray]

    def picture(self, camera: Camera, size: tuple[int, int], *, light: Light | None = None, background=None):
        """Picture (H, W, 3) uint8, sRGB; see `render`."""
        light = light or Light()
        directions = light.directions(camera.pose[:3, :3])
        scene = (camera.position, directions, np.array(light.strengths), float(light.gloss))
        corners = to_homogeneous(self.vertices, _doubled(camera))
        seen = visibility(corners, self.faces, (2 * size[0], 2 * size[1]))
        shadow = _shadow(self.vertices, self.faces, directions[0])
        backdrop = _backdrop(background, size)
        linear = np.empty((size[1], size[0], 3))
        picture = np.empty(linear.shape, dtype=np.uint8)

        def paint(top: int, bottom: int) -> None:
            shade(corners, self.faces, *seen, self.table, self.texture, scene, shadow, backdrop, top, bottom, linear)
            picture[top:bottom] = to_pixels(linear[top:bottom])

        each_band(size[1], BAND // 2, paint)
        return picture


def prepare(mesh: Mesh, color: np.ndarray | tuple[float, float, float] | None = None) -> Surface:
    """The mesh with its normals, colors and ambient occlusion; see `render` for `color`."""
    faces, texture = _visible(mesh, color)
    return Surface(mesh.vertices, faces, _table(mesh, color, faces), texture)


def _visible(mesh: Mesh, color) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The faces to draw, and the texture, its coordinates and its faces (none: no texture)."""
    keep = slice(None)
    if color is not None and np.isnan(color).any():
        hidden = np.broadcast_to(np.isnan(color).any(-1), len(mesh.vertices))
        keep = ~hidden[mesh.faces].any(1)
    faces = np.ascontiguousarray(mesh.faces[keep])
    if color is not None or mesh.texture is None or mesh.uv is None or mesh.uv_faces is None:
        return faces, (np.zeros((1, 1, 3), dtype=np.uint8), np.zeros((1, 2)), np.zeros((0, 3), dtype=np.int64))
    image = mesh.texture if mesh.texture.shape[2] >= 3 else np.repeat(mesh.texture[:, :, :1], 3, axis=2)
    return faces, (image, mesh.uv, np.ascontiguousarray(mesh.uv_faces[keep]))


def _table(mesh: Mesh, color, faces: np.ndarray) -> np.ndarray:
    """What is interpolated over the triangles, (V, WIDTH)."""
    table = np.empty((len(mesh.vertices), WIDTH))
    normals = vertex_normals(mesh.vertices, faces)
    table[:, POSITION : POSITION + 3] = mesh.vertices
    table[:, NORMAL : NORMAL + 3] = normals
    table[:, COLOR : COLOR + 3] = to_linear(np.asarray(SKIN if color is None else color, dtype=np.float64))
    table[:, SKY] = openness(mesh.vertices, normals, faces)
    return table


def _doubled(camera: Camera) -> Camera:
    """The camera of a picture with four samples a pixel."""
    double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
    return Camera(double @ camera.intrinsics, camera.pose, camera.distortion)


def _shadow(vertices: np.ndarray, faces: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Projection into the key light's depth map, the map, and its focal length in texels."""
    camera = light_camera(box(vertices), direction, SHADOW_PIXELS)
    nearness = shadow_map(vertices, faces, camera, SHADOW_PIXELS)
    return camera.intrinsics @ camera.pose[:3], nearness, float(camera.intrinsics[0, 0])


def _backdrop(background, size: tuple[int, int]) -> np.ndarray:
    """Linear light (H, W, 3) behind the mesh."""
    if background is None:
        return _studio(*size)
    background = to_linear(np.asarray(background, dtype=np.float64))
    if background.ndim == 3 and background.shape[:2] != (size[1], size[0]):
        raise InputError(
            f"The background is {background.shape[1]} x {background.shape[0]} pixels, but the picture is "
            f"{size[0]} x {size[1]}; give a background of the picture's size."
        )
    return np.ascontiguousarray(np.broadcast_to(background, (size[1], size[0], 3)))


@lru_cache(maxsize=8)
def _studio(width: int, height: int) -> np.ndarray:
    """A wall with a soft light on it, a little above the middle."""
    x = np.linspace(-1, 1, width)[None, :]
    y = np.linspace(-0.8, 1.2, height)[:, None]
    glow = np.exp(-(x**2 + y**2) / 1.1)[..., None]
    return to_linear(STUDIO[0] + (STUDIO[1] - STUDIO[0]) * glow)
