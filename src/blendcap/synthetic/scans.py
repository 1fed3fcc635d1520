"""Raw scans of a performer: what a scanner would deliver, and the truth behind every vertex of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import InputError, Mesh, Rig
from blendcap.rendering import vertex_normals
from blendcap.synthetic.performer import Performer
from blendcap.synthetic.scans_clutter import make_clutter
from blendcap.synthetic.scans_stage import drawable, set_stage
from blendcap.synthetic.scans_surface import resurface
from blendcap.synthetic.scans_texture import photograph, textured

HOLE = (3.0, 9.0)  # mm, radius
RAGGED = 0.25  # of the radius
LANDMARKS = "landmarks68"


@dataclass(frozen=True, eq=False)
class Scan:
    """A raw scan and what is true of it.

    Parameters
    ----------
    mesh : Mesh
        The scan: vertices (V, 3), mm, triangles, uv and texture of its own.
    rig : Rig
        The true rig.
    weights : (N,) float64
        Of the true rig: the expression that was scanned.
    faces : (V,) int64
        The triangle of the true rig that each vertex lies on; -1 on clutter.
    barycentric : (V, 3) float64
        Where in that triangle; 0 on clutter.
    landmarks : (68, 3) float64
        The true landmarks under this expression, without noise, mm.
    holes : (H, 4) float64
        Centre and radius, mm, of balls in which the scan has no vertices.
    """

    mesh: Mesh
    rig: Rig
    weights: np.ndarray
    faces: np.ndarray
    barycentric: np.ndarray
    landmarks: np.ndarray
    holes: np.ndarray

    @property
    def clutter(self) -> np.ndarray:
        """(V,) bool: which vertices are hair or cloth."""
        return self.faces < 0

    @property
    def neutral(self) -> Mesh:
        """The person at rest, in the rig's topology: what a registration of the neutral scan should find."""
        return self.rig.mesh

    @property
    def expression(self) -> Mesh:
        """The person under `weights`, in the rig's topology: what a registration of this scan should find."""
        return self.rig.mesh.with_vertices(self.rig.pose(self.weights))

    def carried(self, values: np.ndarray) -> np.ndarray:
        """Values (W, ...) at the rig's vertices, carried to those of the scan (V, ...); NaN on clutter."""
        values = np.asarray(values, dtype=np.float64)
        corners = values[self.rig.mesh.faces[self.faces]]
        result = np.einsum("vk,vk...->v...", self.barycentric, corners)
        result[self.clutter] = np.nan
        return result


def make_scan(
    person: Performer | Rig,
    weights: np.ndarray | None = None,
    *,
    seed: int,
    spacing: float = 1.5,
    noise: float = 0.1,
    holes: int = 5,
    clutter: bool = True,
) -> Scan:
    """What a scanner delivers of a person: a mesh of another topology, from the cameras in front and at the sides.

    It has noise along the normals, holes, no back of the head, no inside of the mouth; hair that hides the scalp and
    parts of the forehead, and a collar; lips and lids that touch are one surface. Its texture are photographs from
    three sides with seams between them.

    Parameters
    ----------
    person : Performer or Rig
        With the points "landmarks68".
    weights : (N,) float, optional
        The expression, by the person's shapes; a performer's correctives follow from them. Neutral if not given.
    seed : int
    spacing : float
        Length of the scan's edges, mm.
    noise : float
        Standard deviation along the normal, mm.
    holes : int
        How many, 3 to 9 mm in radius, on the face.
    clutter : bool
        Whether there is hair and a collar.

    Raises
    ------
    InputError
        If the person has no 68 landmarks, the weights do not fit or the spacing is not positive.
    """
    rig, weights = _true(person, weights)
    if LANDMARKS not in rig.points:
        raise InputError(f"The rig {rig.name!r} has no points {LANDMARKS!r}; a scan places hair and holes by them.")
    if not 0.3 <= spacing <= 20:
        raise InputError(f"The spacing of a scan must lie between 0.3 and 20 mm, but is {spacing!r}.")
    rng = np.random.default_rng(seed)
    posed = rig.mesh.with_vertices(rig.pose(weights))
    landmarks = rig.points[LANDMARKS].positions(posed)
    skin, rows, color = drawable(rig, posed)
    extra = make_clutter(skin, landmarks, rng) if clutter else []
    stage, colors = set_stage(skin, color, extra, rng)
    found = resurface(stage.vertices, stage.faces, spacing, rng)
    normals = vertex_normals(found.vertices, found.faces)
    noisy = found.vertices + normals * rng.normal(scale=noise, size=(len(normals), 1))
    balls, keep = _holes(noisy, found.places < len(skin.faces), landmarks, holes, rng)
    used, faces = _kept(found.faces, keep)
    mesh = textured(noisy[used], faces, photograph(stage, colors, rng))
    places, barycentric = found.places[used], found.barycentric[used]
    on_skin = places < len(skin.faces)
    true_faces = np.where(on_skin, rows[np.minimum(places, len(rows) - 1)], -1)
    return Scan(mesh, rig, weights, true_faces, np.where(on_skin[:, None], barycentric, 0), landmarks, balls)


def _true(person: Performer | Rig, weights: np.ndarray | None) -> tuple[Rig, np.ndarray]:
    """The true rig and the weights of all its shapes."""
    rig = person if isinstance(person, Rig) else person.rig
    if weights is None:
        return rig, np.zeros(len(rig.names))
    weights = np.asarray(weights, dtype=np.float64)
    if weights.ndim != 1:
        raise InputError(f"A scan shows one expression: give weights (N,), not {weights.shape}.")
    weights = weights if isinstance(person, Rig) else person.expand(weights)
    if len(weights) != len(rig.names):
        raise InputError(f"The rig {rig.name!r} has {len(rig.names)} shapes, but there are {len(weights)} weights.")
    return rig, weights


def _holes(vertices, on_skin, landmarks, count: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Balls (H, 4) in which nothing remains, and which vertices (V,) do; the holes themselves are ragged."""
    reach = np.linalg.norm(landmarks[8] - landmarks[27])  # chin to the root of the nose
    near = np.linalg.norm(vertices - landmarks[30], axis=1) < reach
    candidates = np.flatnonzero(on_skin & near)
    if not 0 <= count <= len(candidates):
        raise InputError(f"A scan can have 0 to {len(candidates)} holes, but {count!r} were asked for.")
    balls, keep = np.empty((count, 4)), np.ones(len(vertices), dtype=bool)
    for ball in balls:
        ball[:3], ball[3] = vertices[rng.choice(candidates)], rng.uniform(*HOLE)
        arms = vertices - ball[:3]
        edge = ball[3] * (1 + RAGGED * (1 + np.sin(arms @ rng.normal(scale=0.7, size=3) + rng.uniform(0, 6.3))))
        keep &= np.linalg.norm(arms, axis=1) > edge
    return balls, keep


def _kept(faces: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that remain, and the faces between them, renumbered."""
    used, renumbered = np.unique(faces[keep[faces].all(1)], return_inverse=True)
    return used, renumbered.reshape(-1, 3)
