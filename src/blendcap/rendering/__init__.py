"""Pictures of meshes: a z-buffer rasterizer, lights and shading, with no GPU and no display."""

from blendcap.rendering.appearance import default_colors
from blendcap.rendering.camera import face_camera, look_at, project
from blendcap.rendering.normals import vertex_normals
from blendcap.rendering.rasterize import Fragments, rasterize
from blendcap.rendering.render import Surface, prepare, render
from blendcap.rendering.shading import Light

__all__ = [
    "Fragments",
    "Light",
    "Surface",
    "default_colors",
    "face_camera",
    "look_at",
    "prepare",
    "project",
    "rasterize",
    "render",
    "vertex_normals",
]
