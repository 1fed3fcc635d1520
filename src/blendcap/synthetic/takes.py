"""Marker takes of a performer with everything that goes wrong on a set, and the truth behind them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.sparse.csgraph import dijkstra

from blendcap.data import Animation, InputError, MarkerTake, Rig, SurfacePoints
from blendcap.numerics.easing import least_jerk
from blendcap.numerics.geodesic import face_neighbors, surface_graph, walk, weld
from blendcap.numerics.surfaces import parts
from blendcap.rendering import vertex_normals
from blendcap.rendering.light import openness
from blendcap.synthetic.motion import motion_matrices
from blendcap.synthetic.performer import Performer

SKIN = ("forehead", "brows", "glabella", "lids", "nose", "cheeks", "lips", "jaw")
OCCLUSION_SPAN = 40  # mean, frames
OPEN = 0.5  # skin sees at least this much of the sky above it
EASE = 0.25  # seconds from neutral into the first pose


@dataclass(frozen=True, eq=False)
class Truth:
    """What really happened in a synthetic take.

    Parameters
    ----------
    animation : Animation
        The performer's weights (T, N) as meant, without correctives; `head` holds the head motion.
    points : SurfacePoints
        Where the markers really sit on `performer.rig`.
    slip : (T, 6) float64
        Motion of the helmet against the head: translation, mm, and rotation vector about `pivot`, rad.
    pivot : (3,) float64
        mm, in the rig's space.
    positions : (T, M, 3) float64
        The markers without noise and without gaps, slip and head motion included, mm.
    missing : (T, M) bool
    performer : Performer
    """

    animation: Animation
    points: SurfacePoints
    slip: np.ndarray
    pivot: np.ndarray
    positions: np.ndarray
    missing: np.ndarray
    performer: Performer

    def vertices(self, frame: int) -> np.ndarray:
        """The performer's face (V, 3) in one frame, in the rig's space, mm."""
        return self.performer.pose(self.animation.weights[frame])


def choose_points(rig: Rig, count: int, *, seed: int = 0) -> SurfacePoints:
    """Spread markers m00, m01, ... over the moving skin: each next one is farthest, along the surface, from all before.

    Skin is what lies open to the sky (not nostrils and the inside of the mouth), belongs to the largest connected
    piece (eyeballs move too, but nobody glues markers on them) and to the regions of the face if the rig has them.
    """
    faces = weld(rig.mesh.faces, rig.mesh.vertices, rig.deltas)
    candidates = _skin(rig, faces)
    if not 0 < count <= len(candidates):
        raise InputError(f"The rig has {len(candidates)} moving vertices on the skin; ask for 1 to as many markers.")
    graph = surface_graph(rig.mesh.vertices, faces)
    distance = np.full(len(candidates), np.inf)
    chosen = [int(np.random.default_rng(seed).choice(candidates))]
    while len(chosen) < count:
        reach = np.asarray(dijkstra(graph, directed=False, indices=chosen[-1]))
        distance = np.minimum(distance, reach[candidates])
        chosen.append(int(candidates[distance.argmax()]))
    digits = max(2, len(str(count - 1)))
    return SurfacePoints.at_vertices([f"m{i:0{digits}}" for i in range(count)], np.array(chosen), rig.mesh)


def misplace(points: SurfacePoints, rig: Rig, distance: float, rng: np.random.Generator) -> SurfacePoints:
    """The points after a straight walk on the surface in a random direction; `distance` is the root mean square, mm."""
    vertices, faces = rig.mesh.vertices, weld(rig.mesh.faces, rig.mesh.vertices, rig.deltas)
    neighbors = face_neighbors(faces)
    steps = rng.normal(size=(len(points.names), 2)) * (distance / np.sqrt(2))
    ends = []
    for face, barycentric, (x, y) in zip(points.faces, points.barycentric, steps, strict=True):
        corners = vertices[faces[face]]
        frame = np.linalg.svd(corners - corners.mean(0))[2]  # two directions in the plane, then the normal
        step = x * frame[0] + y * frame[1]
        ends.append(walk(vertices, faces, neighbors, face=int(face), barycentric=barycentric, step=step))
    return SurfacePoints(points.names, np.array([f for f, _ in ends]), np.array([b for _, b in ends]))


def make_take(
    performer: Performer,
    animation: Animation,
    points: SurfacePoints,
    *,
    seed: int,
    noise: float = 0.2,
    misplacement: float = 1.5,
    slip: tuple[float, float] = (2.0, 2.0),
    occlusion: float = 0.05,
    head: tuple[float, float] | None = None,
    neutral_frames: int = 15,
) -> tuple[MarkerTake, Truth]:
    """What a helmet camera records of a performer.

    Parameters
    ----------
    performer : Performer
    animation : Animation
        By shape name; a shape that it lacks stays 0.
    points : SurfacePoints
        Where the markers were meant to be.
    seed : int
    noise : float
        Standard deviation of each coordinate, mm.
    misplacement : float
        Root mean square distance along the surface between where a marker was meant to be and where it sits, mm. It
        carries the motion of the place where it sits.
    slip : (float, float)
        Root mean square length of the helmet's translation, mm, and rotation, degrees: a slow drift with bumps.
    occlusion : float
        Part of the samples that are missing, in spans of 40 frames on average.
    head : (float, float), optional
        Root mean square head translation, mm, and rotation, degrees. The animation's own head motion if not given.
    neutral_frames : int
        This many frames of the neutral face come first, seen by all and without slip, then a quarter of a second
        that eases into the first pose; 0 adds neither. The truth holds these frames too.
    """
    rng = np.random.default_rng(seed)
    meant = performer.meant(_with_neutral(animation, neutral_frames))
    count = len(meant.weights)
    drift = partial(_drift, count, meant.rate, still=neutral_frames)
    if head is not None:
        pivot = performer.rig.mesh.vertices.mean(0)
        meant = replace(meant, head=motion_matrices(drift(rng, head, period=4.0, bumps=0.0), pivot))
    true_points = misplace(points, performer.rig, misplacement, rng)
    rest, deltas = performer.rig.sample(true_points)
    positions = rest + np.tensordot(performer.expand(meant.weights), deltas, axes=1)
    pivot = rest.mean(0)
    helmet = drift(rng, slip, period=20.0, bumps=count / meant.rate / 12)
    positions = _apply(motion_matrices(helmet, pivot), positions)
    if meant.head is not None:
        positions = _apply(meant.head, positions)
    missing = _gaps(count, len(points.names), occlusion, neutral_frames, rng)
    seen = positions + rng.normal(scale=noise, size=positions.shape)
    seen[missing] = np.nan
    truth = Truth(meant, true_points, helmet, pivot, positions, missing, performer)
    return MarkerTake(seen, points.names, meant.rate), truth


def _skin(rig: Rig, faces: np.ndarray) -> np.ndarray:
    """Vertices (K,) where one would glue a marker, of those that the welded faces use."""
    vertices = rig.mesh.vertices
    skin = np.intersect1d(rig.moving_vertices(), faces)
    skin = skin[openness(vertices, vertex_normals(vertices, faces), faces)[skin] > OPEN]
    regions = [rig.regions[name] for name in SKIN if name in rig.regions]
    if regions:
        skin = np.intersect1d(skin, np.concatenate(regions))
    piece = parts(faces, len(vertices))
    return skin[piece[skin] == np.bincount(piece[skin]).argmax()] if len(skin) else skin


def _with_neutral(animation: Animation, frames: int) -> Animation:
    """The animation with neutral frames and an ease-in before it; the head waits in its first pose."""
    if frames <= 0:
        return animation
    ease = max(1, round(EASE * animation.rate))
    ramp = least_jerk(np.arange(1, ease + 1) / (ease + 1))[:, None]
    weights = [np.zeros((frames, len(animation.names))), ramp * animation.weights[0], animation.weights]
    head = animation.head
    if head is not None:
        head = np.concatenate([np.repeat(head[:1], frames + ease, axis=0), head])
    lead = (frames + ease) / animation.rate
    before = np.arange(frames + ease) / animation.rate
    times = np.concatenate([before, animation.times - animation.times[0] + lead])
    return Animation(np.concatenate(weights), animation.names, animation.rate, head, times=times)


def _drift(count: int, rate: float, rng, size: tuple[float, float], *, period: float, bumps: float, still: int):
    """(T, 6) smooth random rigid motion, mm and rad: slower than `period` seconds, with some sudden bumps that stay."""
    width = max(1.0, period * rate / 6)
    path = gaussian_filter1d(rng.normal(size=(count, 6)), width, axis=0, mode="reflect")
    path /= path.std(0) + 1e-12
    times = np.arange(count)[:, None]
    for _ in range(rng.poisson(bumps)):
        start, speed = rng.uniform(still, count), 0.05 * rate
        path += rng.normal(size=6) / (1 + np.exp(np.clip(-(times - start) / speed, -50, 50)))
    path -= path[min(still, count - 1)]
    path[:still] = 0
    for part, target in ((slice(0, 3), size[0]), (slice(3, 6), np.deg2rad(size[1]))):
        path[:, part] *= target / (np.sqrt((path[:, part] ** 2).sum(1).mean()) + 1e-12)
    return path


def _apply(matrices: np.ndarray, positions: np.ndarray) -> np.ndarray:
    return positions @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]


def _gaps(count: int, markers: int, part: float, still: int, rng: np.random.Generator) -> np.ndarray:
    """(T, M) bool: alternating seen and missing spans of random length; all are seen in the first `still` frames."""
    missing = np.zeros((count, markers), dtype=bool)
    if part <= 0:
        return missing
    seen_span = OCCLUSION_SPAN * (1 - part) / part
    for marker in range(markers):
        hidden = rng.random() < part
        frame = still
        while frame < count:
            span = int(rng.geometric(1 / (OCCLUSION_SPAN if hidden else max(seen_span, 1))))
            missing[frame : frame + span, marker] = hidden
            frame, hidden = frame + span, not hidden
    return missing
