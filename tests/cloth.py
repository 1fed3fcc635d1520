"""A cloth before one camera, painted with blobs or strokes: where each place of it goes is known exactly."""

from dataclasses import dataclass, replace

import numpy as np

import blendcap
from blendcap import Binding, Camera, MarkerTake, Mesh, PaintTracks, Rig, Solution, SolveSettings, SurfacePoints
from blendcap.makeup.tracking import track_paint
from blendcap.rendering import project
from blendcap.rendering.camera import look_at

SIZE, FOCAL, AWAY, RATE = 320, 800.0, 200.0, 24.0  # pixels, pixels, mm (so 4 pixels a millimetre), 1/s
FINE = FOCAL / AWAY
HALF, STEP = 30.0, 1.5  # mm
MIDDLE = (SIZE - 1) / 2
SLIDE, SHEAR = 8.0, 0.8  # mm, mm a millimetre: what the shapes do along x
CAMERA = Camera(
    np.array([[FOCAL, 0, MIDDLE], [0, FOCAL, MIDDLE], [0, 0, 1]]), look_at(np.array([0, 0, AWAY]), np.zeros(3))
)


def cloth_rig(tilt: float = 0.0, torn: bool = False) -> Rig:
    """A square in the plane z = 0 whose right half is bent back by `tilt`, rad.

    The shapes slide it and shear it; those of a torn one pull its upper and its lower half apart.
    """
    line = np.arange(-HALF + STEP / 2, HALF, STEP)
    count = len(line)
    x, y = (part.ravel() for part in np.meshgrid(line, line))
    number = np.arange(count * count).reshape(count, count)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    bent = np.maximum(x, 0)
    vertices = np.stack([np.where(x > 0, np.cos(tilt) * x, x), y, -np.sin(tilt) * bent], axis=1)
    deltas = np.zeros((2, len(x), 3))
    if torn:
        deltas[0, y > 0, 1], deltas[1, y < 0, 1] = SLIDE, -SLIDE
    else:
        deltas[0, :, 0], deltas[1, :, 0] = SLIDE, SHEAR * y
    return Rig(Mesh(vertices, faces), deltas, ("up", "down") if torn else ("slide", "shear"), name="cloth")


def blobs(x: np.ndarray, y: np.ndarray, size: float = 2.0, apart: int = 40, contrast: float = 160.0) -> np.ndarray:
    """Grey values at pixels: faint skin, and round blobs of paint on a jittered grid."""
    light, rng = skin(x, y), np.random.default_rng(0)
    for down in range(apart, SIZE - apart, apart):
        for along in range(apart, SIZE - apart, apart):
            u, v = np.array([along, down]) + rng.uniform(-3, 3, size=2)
            light += contrast * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * size**2))
    return light


def strokes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Grey values at pixels: faint skin, and upright strokes of paint."""
    return skin(x, y) + 160 * sum(np.exp(-((x - u) ** 2) / 8) for u in range(60, SIZE - 40, 50))


def skin(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    waves = ((0.31, 0.12, 0.3), (-0.17, 0.42, 1.1), (0.23, 0.27, 2.0), (0.05, -0.36, 0.7))
    return 70 + sum(np.sin(a * x + b * y + c) for a, b, c in waves)


def moved(pixels: np.ndarray, slide: float, shear: float, drift: float) -> np.ndarray:
    """Where places of the neutral picture (..., 2) went: by shares of both shapes, and by pixels."""
    x, y = pixels[..., 0], pixels[..., 1]
    return np.stack([x + FINE * SLIDE * slide - SHEAR * shear * (y - MIDDLE) + drift, y], axis=-1)


def picture(paint=blobs, slide: float = 0.0, shear: float = 0.0, drift: float = 0.0) -> np.ndarray:
    """(H, W) uint8 of the flat cloth, moved so."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(np.float64)
    x = x - FINE * SLIDE * slide + SHEAR * shear * (y - MIDDLE) - drift
    return np.round(paint(x, y)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class ClothFilm:
    """What was done to the cloth (T,), and what a solve of its markers, which drift nowhere, foretells."""

    slide: np.ndarray
    shear: np.ndarray
    drift: np.ndarray
    rig: Rig
    take: MarkerTake
    binding: Binding
    solution: Solution

    def follow(self, paint=blobs, dark: tuple[int, ...] = (), noise: float = 0.0) -> PaintTracks:
        """The tracks; frames `dark` are black, and grey values noisy."""
        steps, rng = zip(self.slide, self.shear, self.drift, strict=True), np.random.default_rng(1)
        frames = [picture(paint, *step) * (f not in dark) for f, step in enumerate(steps)]
        if noise:
            frames = [np.clip(p + rng.normal(scale=noise, size=p.shape), 0, 255).astype(np.uint8) for p in frames]
        return track_paint([frames], self.rig, self.take, self.binding, [CAMERA], self.solution)

    def off(self, tracks: PaintTracks) -> np.ndarray:
        """(T, K) how far tracks are from the truth, pixels; NaN where lost."""
        neutral, found = project(tracks.rest, CAMERA)[0], project(tracks.positions, CAMERA)[0]
        true = [moved(neutral, *step) for step in zip(self.slide, self.shear, self.drift, strict=True)]
        return np.linalg.norm(found - np.array(true), axis=2)


def filmed(slide=(0, 0), shear=(0, 0), drift=(0, 0)) -> ClothFilm:
    """A film of a cloth that is slid and sheared by shares (T,) of its shapes, and drifts by pixels (T,).

    The solution is exact: what a solve makes of motion as wild as this, and cleans away, is not what is asked here.
    """
    count = max(map(len, (slide, shear, drift)))
    slide, shear, drift = (np.pad(np.array(p, dtype=float), (0, count - len(p))) for p in (slide, shear, drift))
    rig = cloth_rig()
    weights = np.stack([slide, shear], axis=1)
    spots = np.random.default_rng(0).choice(len(rig.mesh.vertices), 12, replace=False)
    names = tuple(f"m{k}" for k in range(len(spots)))
    still = rig.mesh.vertices[spots]
    take = MarkerTake(still + np.tensordot(weights, rig.deltas[:, spots], axes=1), names, RATE)
    points = SurfacePoints.at_vertices(names, spots, rig.mesh)
    binding = Binding(points, np.eye(3), np.zeros(3), 1.0, np.zeros((len(spots), 3)), np.empty(0))
    settings = SolveSettings(method="paper", head="keep", helmet="none")
    solution = blendcap.solve(rig, take, binding, settings=settings)
    exact = replace(solution, animation=replace(solution.animation, weights=weights), fitted=take.positions)
    return ClothFilm(slide, shear, drift, rig, take, binding, exact)
