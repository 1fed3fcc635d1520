"""Where exactly each marker sits on the rig, within reach of where it was said to sit.

Two ways. `algorithm_4` is the papers': the triangle whose point moves with the least error over the range of motion.
`surface_places` and `motion_places` weigh what is known instead. A technician's click is good to a few millimeters.
The neutral marker, laid on the skin, is as good as the rig's neutral fits the performer's. Motion tells little on its
own, because a performer's gains differ from the rig's by more than a millimeter of place does, but it helps where the
rig is generic.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from blendcap.data import MarkerTake, Rig, SurfacePoints
from blendcap.markers.cleaning import NEUTRAL_FRAMES
from blendcap.markers.helmet import rigid_columns
from blendcap.markers.neighbors import project_on
from blendcap.numerics.similarity import align
from blendcap.solving.learned import solve_learned
from blendcap.solving.noise import MODEL_ERROR, marker_noise
from blendcap.solving.paper import BETA, GAMMA, solve_paper
from blendcap.solving.rows import MarkerRows, marker_rows
from blendcap.solving.visibility import Kinship

log = logging.getLogger(__name__)

CLICK = 1.5  # mm: standard deviation of a given place, each way along the surface
FOUND = 5.0  # mm: likewise of a place that was found without correspondences
SLIDE = 3.0  # how much farther than off the skin a neutral marker of another face lies along it
POSES = 10  # independent poses that a range of motion is worth
MOTION_PASSES = 2
RESTING = 0.25  # mm: a marker that the face moves by less is at rest
LASTING = 0.04  # mm: standard deviation of what of that motion does not average out
RESTS = 0.3  # part of the range of motion: a marker that rests less often tells nothing of its rest
MEDIAN = np.pi / 2  # variance of a median of noise over that of its mean
SETTLED = 0.1  # mm: the papers' threshold on the change of the mean marker error
MOST_PASSES = 10


@dataclass(frozen=True, eq=False)
class Alignment:
    """A similarity from the take to the rig: `scale * rotation @ p + translation`, mm."""

    rotation: np.ndarray
    translation: np.ndarray
    scale: float

    def __call__(self, positions: np.ndarray) -> np.ndarray:
        """Positions (..., 3) of the take in the rig's space."""
        return self.scale * positions @ self.rotation.T + self.translation

    @classmethod
    def fit(cls, source: np.ndarray, target: np.ndarray) -> Alignment:
        """The least-squares similarity of points (M, 3)."""
        rotation, translation, scale = align(source, target)
        return cls(rotation, translation, float(scale))


@dataclass(frozen=True, eq=False)
class Places:
    """Candidate triangles of each marker on its own side of the slits.

    Parameters
    ----------
    rig : Rig
    names : (M,) str
    faces : (M, Q) int
        -1 where there are fewer.
    """

    rig: Rig
    names: tuple[str, ...]
    faces: np.ndarray

    def project(self, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The closest point to each target (M, 3) on each candidate.

        Returns barycentric (M, Q, 3), positions (M, Q, 3) and squared distances (M, Q); infinite where there is none.
        """
        corners = self.rig.mesh.vertices[self.rig.mesh.faces[self.faces]]
        barycentric = project_on(corners, targets[:, None])
        reached = np.einsum("mqc,mqck->mqk", barycentric, corners)
        squared = ((reached - targets[:, None]) ** 2).sum(2)
        return barycentric, reached, np.where(self.faces < 0, np.inf, squared)

    def take(self, barycentric: np.ndarray, choice: np.ndarray) -> SurfacePoints:
        """The points on the chosen candidate (M,) of each marker."""
        rows = np.arange(len(choice))
        return SurfacePoints(self.names, self.faces[rows, choice], barycentric[rows, choice])

    def closest(self, targets: np.ndarray) -> SurfacePoints:
        """The points of the candidates that are closest to targets (M, 3), mm."""
        barycentric, _, squared = self.project(targets)
        return self.take(barycentric, squared.argmin(1))


def surface_places(
    places: Places, given: SurfacePoints, rest: np.ndarray, click: float
) -> tuple[SurfacePoints, Alignment, float]:
    """Lay the neutral markers on the skin, as far as the rig's neutral can be trusted, and align.

    How far the aligned markers lie off the skin tells how far they may lie along it; place and click are averaged by
    their variances.

    Parameters
    ----------
    places : Places
    given : SurfacePoints
    rest : (M, 3)
        Neutral markers in the take's space, mm.
    click : float
        Standard deviation of the given places, mm.

    Returns
    -------
    points, alignment, deviation
        The standard deviation (mm) of the points that remains.
    """
    mesh = places.rig.mesh
    clicked = given.positions(mesh)
    points = given
    for _ in range(MOST_PASSES):
        alignment = Alignment.fit(rest, points.positions(mesh))
        skin = places.closest(alignment(rest)).positions(mesh)
        off_skin = np.sqrt(np.median(((alignment(rest) - skin) ** 2).sum(1)) / 0.455)  # median of chi² with 1 degree
        along_skin = max(SLIDE * off_skin, 1e-3)
        trust = click**2 / (click**2 + along_skin**2)
        points = places.closest(trust * skin + (1 - trust) * clicked)
    log.info("markers lie %.2f mm off the skin; the skin counts %.0f %%", off_skin, 100 * trust)
    return points, alignment, float(np.sqrt(trust) * along_skin)


def motion_places(
    places: Places, points: SurfacePoints, alignment: Alignment, take: MarkerTake, rest: np.ndarray, deviation: float
) -> tuple[SurfacePoints, np.ndarray, np.ndarray]:
    """Move each marker to where its motion over the range of motion fits better, paid for by the way.

    Minimises `3 POSES log(error) / 2 + |p - p0|² / (2 deviation²)`: the marker's motion is worth POSES independent
    poses of unknown accuracy. Returns the points, what is to be added to the aligned rest (`rest_shift`), and the mean
    marker error after every pass, mm.
    """
    start, errors = points.positions(places.rig.mesh), []
    kinship = Kinship.of_pairs(places.rig.mirror)
    barycentric, reached, squared = places.project(start)
    penalty = ((reached - start[:, None]) ** 2).sum(2) / (2 * deviation**2)
    for _ in range(MOTION_PASSES + 1):
        rows = rest_rows(places.rig, points, alignment, take, rest)
        noise = marker_noise(alignment(take.positions))
        unknowns = solve_learned(rows, kinship, take.rate, float(np.hypot(noise, MODEL_ERROR))).unknowns
        errors.append(float(np.nanmean(rows.errors(unknowns))))
        if len(errors) > MOTION_PASSES:
            break
        misfit = _motion_misfit(places, barycentric, rows, unknowns)
        score = 1.5 * POSES * np.log(misfit + 1e-6) + np.where(np.isinf(squared), np.inf, penalty)
        points = places.take(barycentric, score.argmin(1))
    return points, rest_shift(rows, unknowns, noise), np.array(errors)


def rest_shift(rows: MarkerRows, unknowns: np.ndarray, noise: float) -> np.ndarray:
    """How far off the rest of each marker is (M, 3), mm, by all frames of a range of motion in which it rests.

    The rest is the median of a few noisy frames, and what it errs every frame of the take takes for motion: a tenth of
    a millimeter opens the eyes wide. While other parts of the face play, a marker is back at rest in hundreds of
    frames, and their mean has no noise left. It is believed as far as the rest may err.

    Parameters
    ----------
    rows : MarkerRows
        Of the range of motion, measured from the rest.
    unknowns : (T, N + K)
        Their solution.
    noise : float
        Of a coordinate, mm.
    """
    face, helmet = unknowns.copy(), unknowns.copy()
    face[:, rows.shapes :] = helmet[:, : rows.shapes] = 0
    rests = (np.linalg.norm(rows.predict(face), axis=2) < RESTING) & ~rows.missing
    count = rests.sum(0)
    away = np.where(rests[..., None], rows.targets - rows.predict(helmet), 0.0)
    mean = away.sum(0) / np.maximum(count, 1)[:, None]
    may_err = MEDIAN * noise**2 / NEUTRAL_FRAMES
    trust = may_err / (may_err + noise**2 / np.maximum(count, 1) + LASTING**2)
    return np.where(count > RESTS * len(rests), trust, 0.0)[:, None] * mean


def algorithm_4(
    places: Places, given: SurfacePoints, take: MarkerTake, rest: np.ndarray
) -> tuple[SurfacePoints, Alignment, np.ndarray]:
    """The papers' barycentric optimization (2016, section 6; thesis, Algorithm 4).

    Two things that the papers leave open: the alignment is fitted anew to the places of each pass, and the passes end
    when the mean of the marker errors has settled.

    Returns the points, the alignment and the mean marker error after every pass, mm.
    """
    rig, errors = places.rig, []
    alignment = Alignment.fit(rest, given.positions(rig.mesh))  # Procrustes of the given places
    barycentric, _, squared = places.project(alignment(rest))  # steps 1, 2: nearest triangle, barycentric projection
    points = places.take(barycentric, squared.argmin(1))
    for _ in range(MOST_PASSES):
        rows = surface_rows(rig, points, alignment, take)
        unknowns, _, _ = solve_paper(rows, BETA, GAMMA)  # step 3: Eq. 3 over the range of motion
        error = _absolute_error(places, barycentric, rows, unknowns, points)
        points = places.take(barycentric, error.argmin(1))  # step 5: lowest total error over all frames
        errors.append(float(error.min(1).mean()))
        if len(errors) > 1 and abs(errors[-2] - errors[-1]) < SETTLED:
            break
        alignment = Alignment.fit(rest, points.positions(rig.mesh))
        barycentric, _, _ = places.project(alignment(rest))  # step 4: projections on the nearest Q triangles
    return points, alignment, np.array(errors)


def rest_rows(rig: Rig, points: SurfacePoints, alignment: Alignment, take: MarkerTake, rest: np.ndarray) -> MarkerRows:
    """Rows of a take in which the rest offset of each marker is taken out."""
    return _rows(rig, points, alignment(take.positions) - alignment(rest))


def surface_rows(rig: Rig, points: SurfacePoints, alignment: Alignment, take: MarkerTake) -> MarkerRows:
    """Rows of a take measured from the surface itself, rest offsets included."""
    return _rows(rig, points, alignment(take.positions) - points.positions(rig.mesh))


def _rows(rig: Rig, points: SurfacePoints, displacements: np.ndarray) -> MarkerRows:
    surface, deltas = rig.sample(points)
    return marker_rows(deltas, rigid_columns(surface), displacements, rig.bounds, -1.0)


def _candidate_deltas(places: Places, barycentric: np.ndarray, marker: int) -> np.ndarray:
    """(Q, N, 3): how the candidate points of a marker move with each shape, mm."""
    vertices = places.rig.mesh.faces[places.faces[marker]]
    return np.einsum("qc,nqck->qnk", barycentric[marker], places.rig.deltas[:, vertices], optimize=True)


def _motion_misfit(places: Places, barycentric: np.ndarray, rows: MarkerRows, unknowns: np.ndarray) -> np.ndarray:
    """(M, Q) mean squared error of each candidate's motion, mm²."""
    weights, helmet = unknowns[:, : rows.shapes], unknowns[:, rows.shapes :]
    result = np.empty(places.faces.shape)
    for marker in range(len(result)):
        seen = ~rows.missing[:, marker]
        motion = rows.targets[seen, marker] - helmet[seen] @ rows.rows[marker, :, rows.shapes :].T
        deltas = _candidate_deltas(places, barycentric, marker)
        cross, moment = weights[seen].T @ motion, weights[seen].T @ weights[seen]
        explained = np.einsum("qnk,nk->q", deltas, cross)
        size = np.einsum("qnk,nm,qmk->q", deltas, moment, deltas, optimize=True)
        result[marker] = ((motion**2).sum() - 2 * explained + size) / max(int(seen.sum()), 1)
    return np.maximum(result, 0.0)


def _absolute_error(
    places: Places, barycentric: np.ndarray, rows: MarkerRows, unknowns: np.ndarray, points: SurfacePoints
) -> np.ndarray:
    """(M, Q) mean distance over all frames between a marker and each candidate, rest offset included, mm."""
    mesh = places.rig.mesh
    surface = points.positions(mesh)
    result = np.full(places.faces.shape, np.inf)
    for marker in range(len(result)):
        seen = ~rows.missing[:, marker]
        helmet = unknowns[seen, rows.shapes :] @ rows.rows[marker, :, rows.shapes :].T
        target = rows.targets[seen, marker] + surface[marker] - helmet
        corners = mesh.vertices[mesh.faces[places.faces[marker]]]
        neutral = np.einsum("qc,qck->qk", barycentric[marker], corners)
        deltas = _candidate_deltas(places, barycentric, marker)
        for q in np.flatnonzero(places.faces[marker] >= 0):
            away = target - neutral[q] - unknowns[seen, : rows.shapes] @ deltas[q]
            result[marker, q] = np.linalg.norm(away, axis=1).mean()
    return result
