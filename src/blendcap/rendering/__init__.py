"""Pictures of meshes: a z-buffer rasterizer, lights and shading, with no GPU and no display."""

from blendcap.numerics.surfaces import vertex_normals
from blendcap.rendering.appearance import default_colors
from blendcap.rendering.camera import face_camera, look_at, project, sight_lines
from blendcap.rendering.rasterize import Fragments, rasterize
from blendcap.rendering.relief import Tangents, tangents_of
from blendcap.rendering.render import Surface, prepare, prepare_rig, render, shaped
from blendcap.rendering.shading import Light
from blendcap.rendering.slopes import blended_slopes, normal_map_of, slopes_of

__all__ = [
    "Fragments",
    "Light",
    "Surface",
    "Tangents",
    "blended_slopes",
    "default_colors",
    "face_camera",
    "look_at",
    "normal_map_of",
    "prepare",
    "prepare_rig",
    "project",
    "rasterize",
    "render",
    "shaped",
    "sight_lines",
    "slopes_of",
    "tangents_of",
    "vertex_normals",
]
