"""A small stage for the marker solve: a mannequin with nineteen shapes, forty markers, performers and takes."""

from dataclasses import dataclass
from functools import cache

import numpy as np

import blendcap
from blendcap import Animation, Binding, MarkerTake, Rig, Solution, SolveSettings, SurfacePoints
from blendcap.synthetic.mannequin import mannequin
from blendcap.synthetic.performances import range_of_motion, speech
from blendcap.synthetic.performer import Performer, make_performer
from blendcap.synthetic.takes import Truth, choose_points, make_take

SHAPES = (
    "browDownLeft", "browDownRight", "browInnerUp", "browOuterUpLeft", "browOuterUpRight", "cheekPuff", "eyeBlinkLeft",
    "eyeBlinkRight", "jawOpen", "mouthFunnel", "mouthLowerDownLeft", "mouthLowerDownRight", "mouthPucker",
    "mouthSmileLeft", "mouthSmileRight", "mouthUpperUpLeft", "mouthUpperUpRight", "noseSneerLeft", "noseSneerRight",
)  # fmt: skip
RATE = 24.0
CLEAN = {"noise": 0.0, "misplacement": 0.0, "slip": (0.0, 0.0), "occlusion": 0.0}


@dataclass(frozen=True, eq=False)
class Scene:
    """A take, what is true of it, and a binding of its markers."""

    rig: Rig
    take: MarkerTake
    truth: Truth
    binding: Binding

    def solve(self, take: MarkerTake | None = None, **settings) -> Solution:
        return blendcap.solve(self.rig, take or self.take, self.binding, settings=SolveSettings(**settings))

    def error(self, solution: Solution) -> float:
        """Root mean squared distance over the moving face, averaged over frames, mm."""
        performer = self.truth.performer
        both = np.hstack([solution.animation.weights, -performer.expand(self.truth.animation.weights)])
        return float(np.sqrt(np.einsum("ti,ij,tj->t", both, _gram(performer), both).clip(0)).mean())

    def off(self, solution: Solution) -> np.ndarray:
        """(T, N) weights minus the true ones."""
        return solution.animation.weights - self.truth.animation.weights


def oracle(scene: Scene) -> Solution:
    """Eq. 3 with the beta and the ridge whose answer is closest to the truth."""
    answers = [scene.solve(method="paper", beta=b, gamma=g) for b in (0.0, 0.1, 0.3, 1.0, 3.0) for g in (0.001, 0.4)]
    return min(answers, key=scene.error)


def roughness(solution: Solution) -> float:
    return float((np.diff(solution.animation.weights, 2, axis=0) ** 2).mean())


@cache
def full_rig() -> Rig:
    return mannequin(shapes=52)


@cache
def small_rig() -> Rig:
    return full_rig().select(SHAPES)


@cache
def markers() -> SurfacePoints:
    return choose_points(small_rig(), 40, seed=0)


@cache
def performer(strength: float) -> Performer:
    return make_performer(small_rig(), seed=1, strength=strength)


@cache
def _gram(performer: Performer) -> np.ndarray:
    face = small_rig().moving_vertices()
    flat = np.concatenate([small_rig().deltas[:, face], performer.rig.deltas[:, face]]).reshape(-1, 3 * len(face))
    return (flat @ flat.T).astype(np.float64) / len(face)


@cache
def motion() -> Animation:
    return range_of_motion(small_rig(), rate=RATE)


@cache
def talk(rate: float = 30.0, seconds: float = 7.0) -> Animation:
    return speech(small_rig(), rate=rate, seconds=seconds, seed=3)


def scene(
    animation: Animation, *, points: SurfacePoints | None = None, strength: float = 0.0, seed: int = 0, **flaws
) -> Scene:
    """The animation played by someone who differs from the rig by `strength`; bound where the markers really sit."""
    rig = small_rig()
    take, truth = make_take(performer(strength), animation, points or markers(), seed=seed, **{**CLEAN, **flaws})
    return Scene(rig, take, truth, blendcap.bind(rig, take, truth.points, method="given"))


def posed(rate: float = 30.0, seconds: float = 4.0, **peaks: float) -> Animation:
    """A performance in which the named shapes rise and fall again twice, everything else at rest."""
    time = np.arange(round(seconds * rate)) / rate
    rise = np.sin(2 * np.pi * time / seconds) ** 2
    weights = np.zeros((len(time), len(SHAPES)))
    for name, peak in peaks.items():
        weights[:, SHAPES.index(name)] = peak * rise
    return Animation(weights, SHAPES, rate)
