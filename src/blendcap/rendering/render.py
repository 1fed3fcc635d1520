"""A shaded, antialiased picture of a mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from blendcap.data import Camera, InputError, Mesh, Rig
from blendcap.data.anatomy import clear_vertices
from blendcap.numerics.surfaces import vertex_normals
from blendcap.rendering.appearance import SKIN, default_colors
from blendcap.rendering.camera import to_homogeneous
from blendcap.rendering.color import to_linear
from blendcap.rendering.light import box, light_camera, openness, shadow_map
from blendcap.rendering.parallel import each_band
from blendcap.rendering.rasterize import BAND, fill, line_up
from blendcap.rendering.relief import FLAT, Relief, relief_of
from blendcap.rendering.shading import COLOR, NORMAL, POSITION, SKY, WIDTH, Light, shade
from blendcap.rendering.slopes import blended_slopes
from blendcap.rendering.texture import NONE, Texture, texture_of

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
    texture : Texture
    relief : Relief
        What bends the normals.
    """

    vertices: np.ndarray
    faces: np.ndarray
    table: np.ndarray
    texture: Texture
    relief: Relief = FLAT

    @property
    def sky(self) -> np.ndarray:
        """How open to the sky each vertex is, (V,), 0 to 1."""
        return self.table[:, SKY]

    def posed(self, vertices: np.ndarray, sky: np.ndarray | None = None) -> Surface:
        """The same surface with other vertices (V, 3), mm; their openness to the sky (V,) is found if not given."""
        vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        table, relief = _formed(self.table, vertices, self.faces, sky), self.relief.posed(vertices, self.faces)
        return replace(self, vertices=vertices, table=table, relief=relief)

    def painted(self, color: np.ndarray) -> Surface:
        """The same surface in other colors, (3,) or (V, 3), sRGB 0 to 1, without its texture."""
        table = self.table.copy()
        table[:, COLOR : COLOR + 3] = to_linear(np.asarray(color, dtype=np.float64))
        return replace(self, table=table, texture=NONE)

    def picture(self, camera: Camera, size: tuple[int, int], *, light: Light | None = None, background=None):
        """Picture (H, W, 3) uint8, sRGB; see `render`."""
        light = light or Light()
        key = light.directions(camera.pose[:3, :3])[0]
        shadow_camera = light_camera(box(self.vertices), key, SHADOW_PIXELS)
        shadow = shadow_map(self.vertices, self.faces, shadow_camera, SHADOW_PIXELS)
        scene = light.scene(camera, shadow_camera)
        corners = to_homogeneous(self.vertices, _doubled(camera))
        queue = line_up(corners, self.faces, 2 * size[0], 2 * size[1])
        texture, relief = self.texture.at(corners, self.faces), self.relief.at(corners, self.faces)
        picture = _backdrop(background, size)

        def paint(top: int, bottom: int) -> None:
            band = (2 * (bottom - top), 2 * size[0])
            face, nearness = np.empty(band, dtype=np.int32), np.empty(band)
            fill(corners, self.faces, *queue, 2 * top, face, nearness)
            part = picture[top:bottom]
            shade(corners, self.faces, face, nearness, self.table, *texture, *relief, scene, shadow, top, part)

        each_band(size[1], BAND // 2, paint)
        return picture


def prepare(
    mesh: Mesh,
    color: np.ndarray | tuple[float, float, float] | None = None,
    *,
    slopes: np.ndarray | None = None,
    hidden: np.ndarray | None = None,
) -> Surface:
    """The mesh with its normals, colors and ambient occlusion; see `render` for `color`.

    `slopes` (H, W, 2) bend the normals in place of the mesh's normal map; faces that touch a `hidden` vertex (V,) are
    not drawn.
    """
    keep = slice(None)
    if color is not None and np.isnan(color).any():
        hidden = np.broadcast_to(np.isnan(color).any(-1), len(mesh.vertices))
    if hidden is not None and hidden.any():
        keep = ~hidden[mesh.faces].any(1)
    faces = np.ascontiguousarray(mesh.faces[keep])
    table = np.empty((len(mesh.vertices), WIDTH))
    table[:, COLOR : COLOR + 3] = to_linear(np.asarray(SKIN if color is None else color, dtype=np.float64))
    texture = NONE if color is not None else texture_of(mesh, keep)
    return Surface(mesh.vertices, faces, _formed(table, mesh.vertices, faces), texture, relief_of(mesh, keep, slopes))


def prepare_rig(rig: Rig) -> Surface:
    """The neutral of a rig, ready for `shaped`, in its texture or, if it has none, in `default_colors`."""
    slopes = blended_slopes(rig, np.zeros(len(rig.names)))
    return prepare(rig.mesh, default_colors(rig), slopes=slopes, hidden=clear_vertices(rig))


def shaped(neutral: Surface, rig: Rig, weights: np.ndarray, sky: np.ndarray | None = None) -> Surface:
    """The prepared neutral of a rig under weights (N,): its vertices moved, its normal maps blended.

    `sky` is as in `Surface.posed`.
    """
    slopes = blended_slopes(rig, weights)
    if slopes is not None:
        neutral = replace(neutral, relief=replace(neutral.relief, slopes=slopes))
    return neutral.posed(rig.pose(weights), sky)


def _formed(table: np.ndarray, vertices: np.ndarray, faces: np.ndarray, sky: np.ndarray | None = None) -> np.ndarray:
    """The table with the positions, normals and openness of these vertices."""
    formed = table.copy()
    formed[:, POSITION : POSITION + 3] = vertices
    formed[:, NORMAL : NORMAL + 3] = normals = vertex_normals(vertices, faces)
    formed[:, SKY] = openness(vertices, normals, faces) if sky is None else sky
    return formed


def _doubled(camera: Camera) -> Camera:
    """The camera of a picture with four samples a pixel."""
    double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
    return Camera(double @ camera.intrinsics, camera.pose, camera.distortion)


def _backdrop(background, size: tuple[int, int]) -> np.ndarray:
    """What is behind the mesh, as a new picture (H, W, 3) uint8, sRGB."""
    if background is None:
        return _studio(*size).copy()
    background = np.asarray(background, dtype=np.float64)
    if background.ndim == 3 and background.shape[:2] != (size[1], size[0]):
        raise InputError(
            f"The background is {background.shape[1]} x {background.shape[0]} pixels, but the picture is "
            f"{size[0]} x {size[1]}; give a background of the picture's size."
        )
    return np.broadcast_to(_bytes(background), (size[1], size[0], 3)).copy()


@lru_cache(maxsize=8)
def _studio(width: int, height: int) -> np.ndarray:
    """A wall with a soft light on it, a little above the middle."""
    x = np.linspace(-1, 1, width)[None, :]
    y = np.linspace(-0.8, 1.2, height)[:, None]
    glow = np.exp(-(x**2 + y**2) / 1.1)[..., None]
    return _bytes(STUDIO[0] + (STUDIO[1] - STUDIO[0]) * glow)


def _bytes(color: np.ndarray) -> np.ndarray:
    return (np.clip(color, 0, 1) * 255 + 0.5).astype(np.uint8)
