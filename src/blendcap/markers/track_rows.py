"""Tracks of the skin between the markers, laid against the rig that the markers are bound to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from blendcap.data import Binding, InputError, MarkerTake, PaintTracks, Rig, SurfacePoints
from blendcap.modeling.parts import pieces
from blendcap.numerics.geodesic import sewn_vertices

FAR = 5.0  # mm: tracks whose middle one lies farther from the rig's neutral were made with something else
SKIN = 0.2  # part of a shape's largest motion that its largest motion of skin must be, if tracks are to tell it
RATES = 0.01  # part by which the rates of tracks and take may differ


class TrackRows(NamedTuple):
    """Tracks in the rig's space."""

    deltas: np.ndarray  # (N, K, 3) what each shape does to each track, mm
    rest: np.ndarray  # (K, 3) mm
    positions: np.ndarray  # (T, K, 3) mm; NaN where lost
    axes: np.ndarray  # (K, 3, 3) the two directions that each tells, and zeros


def check_tracks(tracks: PaintTracks, rig: Rig, take: MarkerTake, binding: Binding, head: str) -> None:
    """Refuse tracks that do not go with a take.

    Raises
    ------
    InputError
        If the tracks have other frames than the take, lie on another rig or were all lost, or the head's motion is to
        be removed.
    """
    if head == "remove":
        raise InputError("Tracks come from cameras on the helmet, and so must the markers: keep the head's motion.")
    frames = len(take.positions)
    if len(tracks.positions) != frames or abs(tracks.rate - take.rate) > RATES * take.rate:
        raise InputError(
            f"The tracks have {len(tracks.positions)} frames at {tracks.rate:g} a second, but the take {frames} at "
            f"{take.rate:g}; follow the paint in the film of this take."
        )
    if not np.isfinite(tracks.positions).any():
        raise InputError("No track was found in any frame; look at the picture that facs track writes.")
    far = np.linalg.norm(binding.to_rig(tracks.rest) - tracks.points.positions(rig.mesh), axis=1)
    if np.median(far) > FAR:
        raise InputError(
            f"The tracks lie {np.median(far):.0f} mm from the rig {rig.name!r} as its markers are bound; follow the "
            "paint with this rig and these correspondences."
        )


def track_rows(tracks: PaintTracks, rig: Rig, binding: Binding) -> TrackRows:
    """The tracks as the solve takes them.

    A track's neutral place is where its line of sight met the neutral rig, so what it tells is motion alone: where the
    scan erred does not matter.
    """
    axes = np.zeros((len(tracks.points.names), 3, 3))
    axes[:, :2] = tracks.axes @ binding.rotation.T
    return TrackRows(
        track_deltas(rig, tracks.points), binding.to_rig(tracks.rest), binding.to_rig(tracks.positions), axes
    )


def track_deltas(rig: Rig, points: SurfacePoints) -> np.ndarray:
    """(N, K, 3) what each shape does to tracks at weight 1, mm, as far as these may tell it.

    Shapes that chiefly move what lies behind the skin, a tongue or eyeballs, they may not: such a weight would stir to
    explain the last tenth of a millimeter of a lip.
    """
    _, deltas = rig.sample(points)
    motion = np.linalg.norm(rig.deltas, axis=2)
    skin = pieces(sewn_vertices(rig.mesh.vertices, rig.deltas)[rig.mesh.faces], len(rig.mesh.vertices))[0]
    deltas[motion[:, skin].max(1, initial=0.0) < SKIN * motion.max(1, initial=0.0)] = 0
    return deltas
