"""Records: frozen dataclasses over NumPy arrays. They know no file and no algorithm."""

from blendcap.data.animation import Animation
from blendcap.data.binding import Binding
from blendcap.data.camera import Camera
from blendcap.data.errors import InputError
from blendcap.data.landmark_model import LandmarkModel
from blendcap.data.mesh import Mesh, triangulate
from blendcap.data.rig import Rig, landmarks68
from blendcap.data.solution import Certificate, Solution
from blendcap.data.surface import SurfacePoints
from blendcap.data.takes import LandmarkTake, MarkerTake
from blendcap.data.tracks import PaintTracks

__all__ = [
    "Animation",
    "Binding",
    "Camera",
    "Certificate",
    "InputError",
    "LandmarkModel",
    "LandmarkTake",
    "MarkerTake",
    "Mesh",
    "PaintTracks",
    "Rig",
    "Solution",
    "SurfacePoints",
    "landmarks68",
    "triangulate",
]
