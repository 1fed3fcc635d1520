"""Scans of ICT-FaceKit's random people, truth known: another net of triangles, noise, holes, no back of the head."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np

from blendcap.data import Mesh, SurfacePoints, triangulate
from blendcap.numerics.surfaces import vertex_normals

DATA = Path(os.environ.get("BLENDCAP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
SKIN, SCANNED, NARROW = 9409, 11248, 6706  # vertices: face; face, head and neck; the front of the face
TRIANGLES, NOISE, CLICK, HOLES = 140_000, 0.1, 0.5, 5  # mm


@dataclass(frozen=True, eq=False)
class Problem:
    """A template, a scan of somebody, and where each template vertex truly is; `hole` and `seen` (V,) tell where."""

    template: Mesh
    scan: Mesh
    landmarks: tuple[SurfacePoints, np.ndarray]
    truth: np.ndarray
    hole: np.ndarray
    seen: np.ndarray
    clean: Mesh


def problem(seed: int, fine: bool = False) -> Problem:
    """Somebody of 100 identity coefficients ~ N(0, 1). `fine`: the front of the face, each triangle cut into four."""
    pack, rng = np.load(DATA / "rigs" / "ict_facekit.npz", allow_pickle=False), np.random.default_rng(seed)
    person = 10 * (pack["neutral"] + np.tensordot(rng.normal(size=100), pack["identity_deltas"], 1)).astype(float)
    neutral, faces = 10 * pack["neutral"].astype(float), _faces(pack["faces"], SKIN)
    rows = pack["landmarks68_multipie"][17:].astype(int)
    clean = Mesh(person[:SCANNED], _faces(pack["faces"], SCANNED))
    centers = person[rng.choice(NARROW, HOLES, replace=False)]
    radii, behind = rng.uniform(7, 12, HOLES), np.percentile(clean.vertices[:, 2], 8)
    scan = _scanned(clean, centers, radii, behind, rng)
    template, truth = Mesh(neutral[:SKIN], faces), person[:SKIN]
    if fine:
        template, truth = _finer(template), _finer(Mesh(truth, faces)).vertices
        rows = rows[rows < NARROW]
    places = person[rows] + rng.normal(0, CLICK, (len(rows), 3))
    points = SurfacePoints.at_vertices([str(i) for i in range(len(rows))], rows, template)
    hole = (np.linalg.norm(truth[:, None] - centers, axis=2) < radii).any(1)
    return Problem(template, scan, (points, places), truth, hole, ~hole & (truth[:, 2] > behind), clean)


def _faces(polygons: np.ndarray, below: int) -> np.ndarray:
    return triangulate(polygons[polygons.max(1) < below])


def _finer(mesh: Mesh) -> Mesh:
    """The narrow front of the face with four triangles for each."""
    faces = mesh.faces[(mesh.faces < NARROW).all(1)]
    return Mesh(*igl.upsample(mesh.vertices[:NARROW], faces, 1))


def _scanned(clean: Mesh, centers, radii, behind: float, rng) -> Mesh:
    vertices, faces = igl.upsample(clean.vertices, clean.faces, 2)
    vertices, faces = igl.decimate(vertices, faces, TRIANGLES)[:2]
    keep = vertices[:, 2] > behind
    for center, radius in zip(centers, radii, strict=True):
        keep &= np.linalg.norm(vertices - center, axis=1) > radius
    vertices = vertices + vertex_normals(vertices, faces) * rng.normal(0, NOISE, (len(vertices), 1))
    faces = faces[keep[faces].all(1)]
    used, corners = np.unique(faces, return_inverse=True)
    order = rng.permutation(len(used))
    return Mesh(vertices[used][order], np.argsort(order)[corners.reshape(-1, 3)])
