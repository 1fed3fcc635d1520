"""What a scanner sees beside the face: hair with locks over the forehead, and a collar around the neck."""

from __future__ import annotations

import igl
import numpy as np

from blendcap.data import Mesh
from blendcap.numerics.closest import Closest
from blendcap.rendering import vertex_normals

BROWS, CHIN, EARS = slice(17, 27), 8, (0, 16)  # of the 68 landmarks
HAIRLINE = ((-0.75, -0.32), (-0.5, 0.16), (-0.1, 0.22), (0.2, 0.12), (0.5, 0.28), (0.8, 0.50), (1.1, 0.56))
"""How far in front of the ears (brows: 1), and how far above them hair begins there (brows to chin: 1)."""
EAR_DEPTH = 0.62  # of the ears behind the brows, where brows to chin is 1
HAIR, BUMPS = (5.0, 9.0), 1.1  # mm: how thick, least and most; how deep the strands
LOCKS, LOCK_LENGTH, LOCK_WIDTH = 7, (25.0, 55.0), (3.0, 7.0)  # count, mm, mm
COLLAR = ((4.0, -6.0), (4.5, 14.0), (6.5, 22.0), (9.0, 21.0), (12.0, 8.0), (26.0, -14.0))
"""Out from the neck and up from where the collar sits, mm."""
FOLDS = 96  # vertices around the collar


def make_clutter(skin: Mesh, landmarks: np.ndarray, rng: np.random.Generator) -> list[tuple[str, Mesh]]:
    """Hair and collar for a head: ("hair" or "cloth", mesh), as many as the head has a place for.

    Parameters
    ----------
    skin : Mesh
        The head as it is scanned, mm.
    landmarks : (68, 3) float64
        In iBUG's order, mm.
    rng : numpy.random.Generator
    """
    hair = _hair(skin, landmarks, rng)
    locks = [] if hair is None else _locks(skin, landmarks, rng)
    collar = _collar(skin, landmarks, rng)
    pieces = [("hair", hair), *(("hair", lock) for lock in locks), ("cloth", collar)]
    return [(kind, mesh) for kind, mesh in pieces if mesh is not None]


def _hair(skin: Mesh, landmarks: np.ndarray, rng: np.random.Generator) -> Mesh | None:
    """A shell above the scalp with strands as bumps; None if the mesh has no scalp."""
    covered = _under_hair(skin.vertices, landmarks)
    faces = skin.faces[(covered[skin.faces] > 0).any(1)]
    if len(faces) < 50:
        return None
    used, faces = np.unique(faces, return_inverse=True)
    normals = vertex_normals(skin.vertices, skin.faces)[used]
    finer, faces = igl.upsample(np.hstack([skin.vertices[used], normals]), faces.reshape(-1, 3), 2)
    places, normals = np.split(np.asarray(finer), 2, axis=1)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    above = np.clip(_under_hair(places, landmarks), -1, 1)  # the shell dives under the skin at the hairline
    swell = 0.5 + 0.5 * _waves(places, 60.0, rng)
    strands = _waves(places * [1.0, 0.12, 0.35], 7.0, rng) + _waves(places * [1.0, 0.2, 0.3], 3.5, rng)
    height = HAIR[0] + (HAIR[1] - HAIR[0]) * swell + BUMPS * strands
    height = np.where(above > 0, height * np.sqrt(np.maximum(above, 0)), 4 * above)
    return Mesh(places + height[:, None] * normals, np.ascontiguousarray(faces, dtype=np.int64))


def _under_hair(places: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """How far above the hairline places (P, 3) are, in centimetres; negative where nothing grows."""
    brows, high = landmarks[BROWS].mean(0), landmarks[BROWS, 1].mean() - landmarks[CHIN, 1]
    ahead = 1 + (places[:, 2] - brows[2]) / (EAR_DEPTH * high)
    above = (places[:, 1] - landmarks[list(EARS), 1].mean()) / high
    return (above - np.interp(ahead, *np.transpose(HAIRLINE))) * high / 10


def _locks(skin: Mesh, landmarks: np.ndarray, rng: np.random.Generator) -> list[Mesh]:
    """Ribbons that hang from the hairline over the forehead and the temples."""
    above = _under_hair(skin.vertices, landmarks)
    front = (np.abs(above) < 0.8) & (skin.vertices[:, 2] > landmarks[BROWS, 2].min() - 45)
    roots = np.flatnonzero(front & (skin.vertices[:, 1] > landmarks[BROWS, 1].max()))
    if not len(roots):
        return []
    closest = Closest(skin.vertices, skin.faces)
    return [_lock(closest, skin.vertices[rng.choice(roots)], rng) for _ in range(LOCKS)]


def _lock(closest: Closest, root: np.ndarray, rng: np.random.Generator) -> Mesh:
    """One ribbon, bent over its length and across, that starts above `root` (3,)."""
    length, width = rng.uniform(*LOCK_LENGTH), rng.uniform(*LOCK_WIDTH)
    along = np.linspace(0, 1, 24)
    aside = rng.normal(scale=0.25) + rng.normal(scale=0.4) * np.sin(np.pi * along * rng.uniform(0.8, 1.6))
    spine = root + length * np.stack([aside * along, 0.12 - along, 0 * along], axis=1)
    across = np.linspace(-1, 1, 7)
    flat = spine[:, None] + (across[:, None] * [1, 0, 0]) * (width / 2 * (1 - 0.8 * along**2))[:, None, None]
    flat = flat.reshape(-1, 3)
    before = flat + np.array([0, 0, 15.0])
    on_skin = closest(before)[2]
    lift = 1.5 + 3.5 * np.sin(np.pi * np.clip(0.35 + 0.65 * along, 0, 1))[:, None] - 1.2 * across**2
    out = before - on_skin
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    return _sheet((on_skin + lift.reshape(-1, 1) * out).reshape(len(along), len(across), 3))


def _collar(skin: Mesh, landmarks: np.ndarray, rng: np.random.Generator) -> Mesh | None:
    """A folded ring of cloth around the neck; None if the mesh ends above it."""
    low = skin.vertices[:, 1].min()
    sits = max(low + 14.0, landmarks[CHIN, 1] - 50.0)
    ring = skin.vertices[np.abs(skin.vertices[:, 1] - sits) < 8.0]
    if landmarks[CHIN, 1] - low < 40.0 or len(ring) < 12:
        return None
    middle = (ring.min(0) + ring.max(0)) / 2
    angle = np.linspace(0, 2 * np.pi, FOLDS, endpoint=False)
    around = np.arctan2(ring[:, 0] - middle[0], ring[:, 2] - middle[2])
    size = np.hypot(ring[:, 0] - middle[0], ring[:, 2] - middle[2])
    radius = np.where(np.cos(angle[:, None] - around) > 0.94, size, 0).max(1)  # of the neck in each direction
    radius = np.convolve(np.concatenate([radius[-4:], radius, radius[:4]]), np.full(9, 1 / 9), "valid")
    rows = np.linspace(0, len(COLLAR) - 1, 4 * len(COLLAR))
    out, up = (np.interp(rows, np.arange(len(COLLAR)), column) for column in np.transpose(COLLAR))
    folds = _waves(np.stack([np.sin(angle), np.cos(angle)], axis=1) * 60.0, 28.0, rng)
    reach = radius + out[:, None] + 1.6 * folds * np.linspace(0, 1, len(rows))[:, None]
    height = sits + up[:, None] - 8.0 * np.cos(angle) + 1.5 * np.roll(folds, 11)  # lower in front
    rim = np.stack([middle[0] + reach * np.sin(angle), height, middle[2] + reach * np.cos(angle)], axis=2)
    return _sheet(np.concatenate([rim, rim[:, :1]], axis=1))


def _sheet(grid: np.ndarray) -> Mesh:
    """The mesh of a grid of points (R, C, 3)."""
    rows, columns = grid.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    return Mesh(grid.reshape(-1, 3), np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)]))


def _waves(places: np.ndarray, length: float, rng: np.random.Generator) -> np.ndarray:
    """A random smooth function of place (P,) with waves of about `length` mm; variance one half."""
    frequencies = rng.normal(size=(places.shape[1], 16)) * (2 * np.pi / length)
    return np.cos(places @ frequencies + rng.uniform(0, 2 * np.pi, 16)).mean(1) * 4 / np.sqrt(2) / np.sqrt(2)
