"""blendcap: captured facial performances to blendshape animation.

Public names in the order of the work. They load when first used, so that `import blendcap` stays fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.12.2"

_HOMES = {
    # records
    "Mesh": "data",
    "SurfacePoints": "data",
    "Rig": "data",
    "MarkerTake": "data",
    "LandmarkTake": "data",
    "PaintTracks": "data",
    "Animation": "data",
    "Camera": "data",
    "Binding": "data",
    "Solution": "data",
    "Certificate": "data",
    "InputError": "data",
    # files
    "read_mesh": "io",
    "read_rig": "io",
    "read_markers": "io",
    "read_animation": "io",
    "read_video": "io",
    "write_mesh": "io",
    "write_rig": "io",
    "write_markers": "io",
    "write_animation": "io",
    # the stage
    "mannequin": "synthetic.mannequin",
    # modeling
    "find_landmarks": "modeling.landmarks",
    "train_landmarks": "modeling.landmark_training",
    "bake_normals": "modeling.detail",
    "register": "modeling.registration",
    "transfer_rig": "modeling.transfer",
    "refine_rig": "modeling.examples",
    # solving
    "bind": "markers.binding",
    "solve": "markers.solve",
    "refine_from_take": "markers.personal",
    "SolveSettings": "solving.settings",
    "solve_box": "numerics.boxls",
    "train_classifier": "makeup.training",
    "classify": "makeup.curves",
    "track_paint": "makeup.tracking",
    # judging
    "evaluate": "metrics",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from blendcap.data import Animation as Animation
    from blendcap.data import Binding as Binding
    from blendcap.data import Camera as Camera
    from blendcap.data import Certificate as Certificate
    from blendcap.data import InputError as InputError
    from blendcap.data import LandmarkTake as LandmarkTake
    from blendcap.data import MarkerTake as MarkerTake
    from blendcap.data import Mesh as Mesh
    from blendcap.data import PaintTracks as PaintTracks
    from blendcap.data import Rig as Rig
    from blendcap.data import Solution as Solution
    from blendcap.data import SurfacePoints as SurfacePoints
    from blendcap.io import read_animation as read_animation
    from blendcap.io import read_markers as read_markers
    from blendcap.io import read_mesh as read_mesh
    from blendcap.io import read_rig as read_rig
    from blendcap.io import read_video as read_video
    from blendcap.io import write_animation as write_animation
    from blendcap.io import write_markers as write_markers
    from blendcap.io import write_mesh as write_mesh
    from blendcap.io import write_rig as write_rig
    from blendcap.makeup.curves import classify as classify
    from blendcap.makeup.tracking import track_paint as track_paint
    from blendcap.makeup.training import train_classifier as train_classifier
    from blendcap.markers.binding import bind as bind
    from blendcap.markers.personal import refine_from_take as refine_from_take
    from blendcap.markers.solve import solve as solve
    from blendcap.metrics import evaluate as evaluate
    from blendcap.modeling.detail import bake_normals as bake_normals
    from blendcap.modeling.examples import refine_rig as refine_rig
    from blendcap.modeling.landmark_training import train_landmarks as train_landmarks
    from blendcap.modeling.landmarks import find_landmarks as find_landmarks
    from blendcap.modeling.registration import register as register
    from blendcap.modeling.transfer import transfer_rig as transfer_rig
    from blendcap.numerics.boxls import solve_box as solve_box
    from blendcap.solving.settings import SolveSettings as SolveSettings
    from blendcap.synthetic.mannequin import mannequin as mannequin


def __getattr__(name: str):
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'blendcap' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"blendcap.{home}"), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted({*globals(), *_HOMES})
