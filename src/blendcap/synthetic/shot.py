"""What one camera sees of a performance, and the truth about it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from blendcap.data import Animation, Camera, LandmarkTake, SurfacePoints, landmarks68
from blendcap.rendering.camera import project, to_homogeneous
from blendcap.rendering.rasterize import visibility
from blendcap.synthetic.paint import drawn_faces
from blendcap.synthetic.performer import Performer

SLACK = 2.0  # mm; a point that lies so far behind what is seen still counts as seen: it is on the skin, not under it


@dataclass(frozen=True, eq=False)
class Seen:
    """Points on the skin as one camera sees them.

    Parameters
    ----------
    names : (M,) str
    positions : (T, M, 3) float64
        mm, in the space of the camera's `pose`.
    pixels : (T, M, 2) float64
        The first picture element's centre is at (0, 0).
    visible : (T, M) bool
        In the picture, and nothing before it.
    """

    names: tuple[str, ...]
    positions: np.ndarray
    pixels: np.ndarray
    visible: np.ndarray


@dataclass(frozen=True, eq=False)
class Shot:
    """Pictures of a performer through one camera. They are made when asked for, so that memory does not grow.

    Parameters
    ----------
    name : str
    size : (width, height)
        Pixels.
    camera : Camera
        At rest in its space: a room, or a helmet.
    performer : Performer
    animation : Animation
        The performer's weights (T, N), without correctives, and the rate.
    placement : (T, 4, 4) float64
        From the rig's space to the camera's: the motion of the head in a room, or in its helmet.
    exposure : float
        Time for which the shutter is open, s; the truth is that of its middle.
    lights : dict
        What lit the face; see the function that made the shot.
    develop : callable
        From vertices (V, 3) in the camera's space, their motion during the exposure (V, 3) and the number of the frame
        to a picture, uint8.
    dots : SurfacePoints, optional
        Where markers sit.
    """

    name: str
    size: tuple[int, int]
    camera: Camera
    performer: Performer
    animation: Animation
    placement: np.ndarray
    exposure: float
    lights: dict[str, np.ndarray]
    develop: Callable[[np.ndarray, np.ndarray, int], np.ndarray]
    dots: SurfacePoints | None = None

    @property
    def count(self) -> int:
        """Frames."""
        return len(self.animation.weights)

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self.animation.rate

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[np.ndarray]:
        """The pictures (H, W) grey or (H, W, 3) sRGB, uint8, one after the other; the same ones at every call."""
        vertices = lru_cache(maxsize=3)(self.vertices)
        for frame in range(self.count)[start:stop]:
            before, after = max(frame - 1, 0), min(frame + 1, self.count - 1)
            speed = (vertices(after) - vertices(before)) * (self.rate / max(after - before, 1))
            yield self.develop(vertices(frame), speed * self.exposure, frame)

    def vertices(self, frame: int) -> np.ndarray:
        """The face (V, 3) in the middle of an exposure, in the camera's space, mm."""
        place = self.placement[frame]
        return self.performer.pose(self.animation.weights[frame]) @ place[:3, :3].T + place[:3, 3]

    @cached_property
    def landmarks(self) -> Seen:
        """The 68 landmarks. They are places on the skin: those of the jaw do not slide to the edge that is seen."""
        return self.look_at(landmarks68(self.performer.rig))

    @cached_property
    def markers(self) -> Seen | None:
        """The true middles of the dots; None if there are none."""
        return None if self.dots is None else self.look_at(self.dots)

    def landmark_take(self) -> LandmarkTake:
        """The landmarks' true pixels, NaN where they are hidden."""
        seen = self.landmarks
        points = np.where(seen.visible[..., None], seen.pixels, np.nan)
        return LandmarkTake(points, seen.names, self.rate, seen.visible.astype(np.float64), self.size)

    def look_at(self, points: SurfacePoints) -> Seen:
        """Where the camera sees points on the performer's skin."""
        matrix, rig = points.matrix(self.performer.rig.mesh), self.performer.rig
        faces = np.ascontiguousarray(rig.mesh.faces[drawn_faces(rig)])
        positions = np.empty((self.count, len(points.names), 3))
        visible = np.empty(positions.shape[:2], dtype=bool)
        for frame in range(self.count):
            vertices = self.vertices(frame)
            positions[frame] = matrix @ vertices
            visible[frame] = _visible(positions[frame], vertices, faces, self.camera, self.size)
        return Seen(points.names, positions, project(positions, self.camera)[0], visible)


def _visible(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, camera: Camera, size) -> np.ndarray:
    """(M,) bool: which points are in the picture and not behind the surface."""
    pixels, depth = project(points, camera)
    width, height = size
    nearness = visibility(to_homogeneous(vertices, camera), faces, size)[1]
    with np.errstate(invalid="ignore"):
        inside = (depth > 0) & (pixels > -0.5).all(1) & (pixels < [width - 0.5, height - 0.5]).all(1)
    column, row = np.round(np.where(inside[:, None], pixels, 0)).astype(int).T
    steps = [(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    around = [(row + y).clip(0, height - 1) * width + (column + x).clip(0, width - 1) for x, y in steps]
    least = nearness.ravel()[np.array(around)].min(0)  # the farthest of nine pixels
    return inside & (least * (depth - SLACK) < 1)
