"""Files: one module per format; imports data only. The format of a file is its ending."""

from blendcap.io.atomic import write_whole
from blendcap.io.correspondences import read_correspondences, write_correspondences
from blendcap.io.describe import describe, read_any
from blendcap.io.formats import (
    read_animation,
    read_markers,
    read_mesh,
    read_rig,
    write_animation,
    write_markers,
    write_mesh,
    write_rig,
)
from blendcap.io.images import write_image
from blendcap.io.landmark_training import read_annotated, read_landmark_model, write_landmark_model
from blendcap.io.points_json import read_points, write_points
from blendcap.io.tracks_npz import read_tracks, write_tracks
from blendcap.io.video import Video, read_video
from blendcap.io.video_write import write_video

__all__ = [
    "Video",
    "describe",
    "read_animation",
    "read_annotated",
    "read_any",
    "read_correspondences",
    "read_landmark_model",
    "read_markers",
    "read_mesh",
    "read_points",
    "read_rig",
    "read_tracks",
    "read_video",
    "write_animation",
    "write_correspondences",
    "write_image",
    "write_landmark_model",
    "write_markers",
    "write_mesh",
    "write_points",
    "write_rig",
    "write_tracks",
    "write_video",
    "write_whole",
]
