"""Landmarks on a scan: twelve features and the lines of lips and lids, as points on its surface."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import cv2
import numpy as np

from blendcap.data import InputError, LandmarkModel, Mesh, SurfacePoints
from blendcap.modeling.detection import detect, detect_paper
from blendcap.modeling.detectors import Detectors, shipped
from blendcap.modeling.face_search import search_face
from blendcap.modeling.frontal import GAP, Frontal, frontal, lift, out_of_gaps
from blendcap.modeling.landmark_training import as_picture
from blendcap.modeling.lines import line_points, trace_learned, trace_paper, without_lost
from blendcap.numerics.barycentric import barycentric
from blendcap.numerics.closest import Closest
from blendcap.numerics.similarity import align_robust
from blendcap.numerics.surfaces import face_normals, parts
from blendcap.rendering.texels import texels_of, uv_pixels

ROUNDS = 8  # of detecting and turning the face to the front
SLACK = (10.0, 6.0, 3.0)  # deviation of the prior beyond what was learned, pixels, in the first rounds and then on
SETTLED = 0.5  # mm, RMS, that the features move by at most at the end
NEEDED = 8  # features, of which half look right, without which there is no face
FAR = 15.0  # mm, median distance from the average face beyond which there is none
BESIDE = 4.0  # mm: a point on an eyeball that near to the skin belongs to the lid
SMALL = 0.1  # of the largest part's area: less is no skin
UV_SIZE, UV_STEP = 1024, 4  # the thesis' size of a texture, and the grid that its filters are moved on, pixels

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Finding:
    """Landmarks and how they were found.

    Parameters
    ----------
    points : SurfacePoints
    image : (H, W, C) float32
        The picture that was searched.
    pixels : (M, 2)
        Where the points lie in it.
    odds : (M,)
        How sure each feature is, log-odds; NaN for the points of lines.
    place : (4, 4)
        The similarity from the scan to the average face, mm; the identity in uv.
    rounds : int
        How often the face was turned to the front and looked at again.
    converged : bool
        Whether the last round moved the features by less than half a millimetre (RMS).
    """

    points: SurfacePoints
    image: np.ndarray
    pixels: np.ndarray
    odds: np.ndarray
    place: np.ndarray
    rounds: int
    converged: bool


def find_landmarks(mesh: Mesh, *, method: str = "frontal", detectors: Detectors | None = None) -> SurfacePoints:
    """Find the features of a face and the lines of its lips and lids on a scan.

    Parameters
    ----------
    mesh : Mesh
        Any unit, any position. Standing with +z out of the face and +y up it is found soonest.
    method : "frontal" or "uv"
        Look at the face from straight in front, its form and its texture if it has one; or, the thesis' way, at the
        texture itself, which needs the layout that the detector was trained on.
    detectors : Detectors, optional
        Trained on pictures of your own; those that come with blendcap if not given.

    Returns
    -------
    SurfacePoints
        The 12 features (`nose_tip`, `between_eyes`, `eye_outer_right` ...) that were found and, named
        `lips_upper_1` and so on from the subject's right, 9 points on each of six lines.

    Raises
    ------
    InputError
        If no face is found, or the texture or its coordinates are missing where they are needed.
    """
    return search_landmarks(mesh, method=method, detectors=detectors).points


def search_landmarks(mesh: Mesh, *, method: str = "frontal", detectors: Detectors | None = None) -> Finding:
    """`find_landmarks` with all that it knows about its answer."""
    if method == "uv":
        return _search_uv(mesh, detectors or shipped("uv"))
    if method != "frontal":
        raise InputError(f"There is no way of finding landmarks called {method!r}; choose frontal or uv.")
    textured = mesh.texture is not None and mesh.uv is not None
    return _search_frontal(mesh, detectors or shipped("front" if textured else "form"))


def _search_frontal(mesh: Mesh, detectors: Detectors) -> Finding:
    """Find the whole face; then look for its features, turn it to the front by them, and look again."""
    model = detectors.points
    if detectors.face is None or model.places is None:
        raise InputError("These detectors know no whole faces or no places; train them on pictures from the front.")
    place, before, converged, rounds = search_face(mesh, detectors.face).place, None, False, 0
    for rounds in range(1, ROUNDS + 1):
        slack = SLACK[min(rounds, len(SLACK)) - 1]
        view = frontal(mesh, place, int(model.size[0]), textured=model.channels > 1)
        pixels, odds = detect(view.image, model, slack=slack)
        places = _lifted(mesh, view, model, pixels)
        after = places @ place[:3, :3].T + place[:3, 3]
        if before is not None and rounds > len(SLACK) and _step(after, before) < SETTLED:
            converged = True
            break
        turned = _to_average(places, place, model)
        before, place = places @ turned[:3, :3].T + turned[:3, 3], turned
    if not converged:
        _log.warning("The landmarks still moved by more than %g mm (RMS) after %d rounds; look at their picture.",
                     SETTLED, rounds)  # fmt: skip
    corners = view.pixels[mesh.faces]
    found = dict(zip(model.names, pixels, strict=True))
    lines = trace_learned(view.image, found, detectors.lines) if detectors.lines else {}
    lines = without_lost(lines, view.fragments.depth, GAP)
    names, spots, sure = _together(found, odds, lines)
    spots = out_of_gaps(view.fragments.depth, spots)
    points = lift(view.fragments, corners, names, spots)
    points = onto_skin(mesh, points, BESIDE / float(np.cbrt(np.linalg.det(place[:3, :3]))))
    return Finding(points, view.image, spots, sure, place, rounds, converged)


def onto_skin(mesh: Mesh, points: SurfacePoints, reach: float) -> SurfacePoints:
    """The points with those that lie on small loose parts, as eyeballs are, moved to the skin if it is within reach."""
    part = parts(mesh.faces, len(mesh.vertices))[mesh.faces[:, 0]]
    area = np.bincount(part, np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1))
    loose = np.flatnonzero(area[part[points.faces]] < SMALL * area.max())
    if not len(loose):
        return points
    skin = np.flatnonzero(area[part] >= SMALL * area.max())
    squared, face, places = Closest(mesh.vertices, mesh.faces[skin])(points.positions(mesh)[loose])
    near = squared < reach**2
    faces, weights = np.array(points.faces), np.array(points.barycentric)
    faces[loose[near]] = skin[face[near]]
    weights[loose[near]] = barycentric(places[near], mesh.vertices[mesh.faces[skin[face[near]]]])
    return SurfacePoints(points.names, faces, weights)


def _search_uv(mesh: Mesh, detectors: Detectors) -> Finding:
    if mesh.uv is None or mesh.texture is None:
        lacks = "texture coordinates" if mesh.uv is None else "texture"
        raise InputError(f"The scan has no {lacks}, in which landmarks could be found; use the method frontal, "
                         "or give the landmarks in a file.")  # fmt: skip
    image = cv2.resize(as_picture(mesh.texture), (UV_SIZE, UV_SIZE), interpolation=cv2.INTER_AREA)[..., None]
    pixels, odds = detect_paper(image, detectors.points, UV_STEP)
    _demand_face(int(np.isfinite(pixels).all(1).sum()))
    found = dict(zip(detectors.points.names, pixels, strict=True))
    names, spots, sure = _together(found, odds, trace_paper(image[..., 0], found))
    size = (UV_SIZE, UV_SIZE)
    corners = uv_pixels(mesh, size)[mesh.uv_faces]
    points = lift(texels_of(mesh, size), corners, names, spots)
    return Finding(points, image, spots, sure, np.eye(4), 1, True)


def _step(after: np.ndarray, before: np.ndarray) -> float:
    """RMS distance, mm, between features (L, 3) that both have."""
    return float(np.sqrt(np.nanmean(((after - before) ** 2).sum(1))))


def _lifted(mesh: Mesh, view: Frontal, model: LandmarkModel, pixels: np.ndarray) -> np.ndarray:
    """Where the features that were found lie on the scan, (L, 3); NaN for the others."""
    known = np.isfinite(pixels).all(1)
    _demand_face(int(known.sum()))
    places = np.full((len(pixels), 3), np.nan)
    names = [model.names[k] for k in np.flatnonzero(known)]
    places[known] = lift(view.fragments, view.pixels[mesh.faces], names, pixels[known]).positions(mesh)
    return places


def _to_average(places: np.ndarray, place: np.ndarray, model: LandmarkModel) -> np.ndarray:
    """The similarity (4, 4) that carries features (L, 3) of the scan onto those of the average face."""
    average = np.asarray(model.places)
    size = np.cbrt(np.linalg.det(place[:3, :3]))  # so that a millimetre is one, whatever the scan's unit
    rotation, translation, scale = align_robust(size * places, average, floor=3.0)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = size * scale * rotation, translation
    off = np.linalg.norm(places @ turned[:3, :3].T + turned[:3, 3] - average, axis=1)
    if np.nanmedian(off) > FAR:
        _demand_face(0)
    return turned


def _together(found: dict, odds: np.ndarray, lines: dict) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, pixels and log-odds of the features that were found and the points of the lines."""
    names = [name for name, pixel in found.items() if np.isfinite(pixel).all()]
    sure = [value for value, pixel in zip(odds, found.values(), strict=True) if np.isfinite(pixel).all()]
    spots = [found[name] for name in names]
    for line, pixels in lines.items():
        own, places = line_points(line, pixels)
        names += own
        spots += list(places)
        sure += [np.nan] * len(own)
    return names, np.array(spots), np.array(sure)


def _demand_face(features: int) -> None:
    if features < NEEDED:
        raise InputError(
            "No face was found on the scan; give its landmarks in a file (--landmarks), "
            "or turn it so that the face looks along +z with +y up."
        )
