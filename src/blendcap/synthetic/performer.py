"""A performer who is not the rig: the same shapes with a personal gain, motion that no shape of the rig has, and skin
that does not follow in proportion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blendcap.data import Animation, InputError, Rig, SurfacePoints
from blendcap.data.names import canonical

SHAPE_GAIN = 0.12  # standard deviation of the logarithm, at strength 1
FIELD_GAIN = 0.10
SIDES_ALIKE = 0.8  # correlation of the gains of a left and a right shape
CORRECTIVES = 12
HARD = ("eyes", "teeth")  # regions that move as one piece: no corrective bends them
CORRECTIVE_SIZE = (0.10, 0.25)  # of its smaller driver, at strength 1
RESISTANCE = (0.25, 0.15)  # mean and standard deviation over shapes, at resistance 1
MOST_RESISTANCE = 0.8  # below 1: more weight is more motion


@dataclass(frozen=True, eq=False)
class Performer:
    """Whom the markers are glued to.

    Parameters
    ----------
    rig : Rig
        The true rig: the caller's shapes in their order with personal deltas, then the correctives.
    drivers : (C, 2) int64
        The two shapes whose product drives each corrective; of jawOpen, what mouthClose does not undo.
    resistance : (N,) float64
        How far each shape is from linear: at weight w the skin is where `w + resistance w (1 - w)` would put it, so
        that it comes fast and then resists. 0 is linear; within -1 and 1 more weight is always more motion.
    """

    rig: Rig
    drivers: np.ndarray
    resistance: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """The shapes that an animation may use: all but the correctives."""
        return self.rig.names[: len(self.rig.names) - len(self.drivers)]

    def expand(self, weights: np.ndarray) -> np.ndarray:
        """Weights (..., N + C) of the true rig, which is linear, for weights (..., N) that the performer means.

        The skin's resistance bends them, and each corrective is the product of its two drivers.
        """
        weights = np.asarray(weights, dtype=np.float64)
        if weights.shape[-1] != len(self.names):
            raise InputError(f"The performer has {len(self.names)} shapes, but the weights are {weights.shape}.")
        inside = np.clip(weights, 0, 1)
        felt = weights + self.resistance * inside * (1 - inside)
        driving = felt.copy()
        for jaw, close in _jaw_and_close(self.names):
            driving[..., jaw] = np.clip(felt[..., jaw] - felt[..., close], 0, None)
        return np.concatenate([felt, driving[..., self.drivers].prod(-1)], axis=-1)

    def act(self, animation: Animation) -> Animation:
        """The animation on the true rig, as `expand` does it: its shapes by name (0 if absent) and the correctives."""
        meant = self.meant(animation)
        return Animation(self.expand(meant.weights), self.rig.names, meant.rate, meant.head, times=meant.times)

    def meant(self, animation: Animation) -> Animation:
        """The animation by the performer's own shapes: those that it lacks stay 0."""
        place = {name: i for i, name in enumerate(self.names)}
        unknown = [n for n in animation.names if n not in place]
        if unknown:
            raise InputError(f"The performer has no shape {unknown[0]!r}; map the animation to the rig's names first.")
        weights = np.zeros((len(animation.weights), len(self.names)))
        weights[:, [place[n] for n in animation.names]] = animation.weights
        return Animation(weights, self.names, animation.rate, animation.head, times=animation.times)

    def pose(self, weights: np.ndarray) -> np.ndarray:
        """Vertices under weights (N,) or (T, N), correctives included: (V, 3) or (T, V, 3), mm."""
        return self.rig.pose(self.expand(weights))

    def sample(self, points: SurfacePoints, weights: np.ndarray) -> np.ndarray:
        """Points on the skin under weights (T, N), correctives included: (T, M, 3), mm."""
        rest, deltas = self.rig.sample(points)
        return rest + np.tensordot(self.expand(weights), deltas, axes=1)


def make_performer(
    rig: Rig, *, seed: int, strength: float = 1.0, resistance: float = 0.0, identity: np.ndarray | None = None
) -> Performer:
    """Someone whose face moves much like the rig, but not exactly.

    Every delta is multiplied by a gain of the shape and by a smooth gain field over the face (together about 16 %
    standard deviation at strength 1). Left and right shapes of a person have similar gains; a shape that closes the
    eyes closes them on every face, and mouthClose the lips over an open jaw. Up to twelve pairs of shapes that move the
    same skin get a corrective that the rig lacks, 10 to 25 % of the smaller driver.

    Parameters
    ----------
    rig : Rig
        The rig that the solver will be given.
    seed : int
    strength : float
        0 is the rig itself; 1 is the mismatch that the accuracy figures state.
    resistance : float
        How far the skin is from linear. At 1 a shape is 6 % ahead of its weight half-way on average, some more than
        others, left and right much alike; at 0, which the accuracy figures state, the skin is linear.
    identity : (V, 3) float64, optional
        Added to the neutral, mm.
    """
    rng = np.random.default_rng(seed)
    neutral = rig.mesh.vertices if identity is None else rig.mesh.vertices + np.asarray(identity, dtype=np.float64)
    field = _SmoothField(neutral[rig.moving_vertices()], rng)
    personal = rig.deltas * _gains(rig, neutral, field, strength, rng)
    soft = np.ones(len(neutral), dtype=bool)
    for region in HARD:
        soft[rig.regions.get(region, [])] = False
    soft_deltas = rig.deltas * soft[:, None]
    pairs = _co_active_pairs(rig, soft_deltas, rng)
    size = rng.uniform(*CORRECTIVE_SIZE, len(pairs)) * strength
    extra = [_corrective(soft_deltas[list(p)], neutral, field, s, rng) for p, s in zip(pairs, size, strict=True)]
    drivers = [(rig.names[i], rig.names[j]) for i, j in pairs]
    names = ["*".join(d) for d in drivers]
    true = replace(
        rig,
        mesh=rig.mesh.with_vertices(neutral),
        deltas=np.concatenate([personal, np.reshape(extra, (-1, *neutral.shape))]).astype(np.float32),
        names=(*rig.names, *names),
        bounds=np.concatenate([rig.bounds, np.tile([0.0, 1.0], (len(pairs), 1))]),
        mirror=np.concatenate([rig.mirror, len(rig.names) + np.arange(len(pairs))]),
        combinations={**rig.combinations, **dict(zip(names, drivers, strict=True))},
        name=f"performer {seed}",
    )
    bent = _resistances(rig, resistance, np.random.default_rng([seed, 1]))
    return Performer(true, np.reshape(pairs, (-1, 2)).astype(np.int64), bent)


def _resistances(rig: Rig, size: float, rng: np.random.Generator) -> np.ndarray:
    """(N,): how far each shape is from linear; 0 for a shape whose weight does not go from 0 to 1."""
    if not np.isfinite(size) or size < 0:
        raise InputError(f"A performer's resistance must be 0 or more, but is {size!r}.")
    mean, deviation = RESISTANCE
    bent = size * (mean + deviation * _paired(rig, rng))
    bent = np.clip(bent[_alike(rig)], -MOST_RESISTANCE, MOST_RESISTANCE)
    return np.where((rig.bounds == [0, 1]).all(1), bent, 0)


def _paired(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """A normal number for each shape (N,); those of a left and a right shape are alike."""
    own = rng.normal(size=len(rig.names))
    shared = np.sqrt(SIDES_ALIKE) * own[np.minimum(np.arange(len(own)), rig.mirror)]
    sided = shared + np.sqrt(1 - SIDES_ALIKE) * rng.normal(size=len(own))
    return np.where(rig.mirror == np.arange(len(own)), own, sided)


class _SmoothField:
    """Random smooth functions of place, waves about as long as the face is high; zero mean, unit variance."""

    WAVES = 12

    def __init__(self, face: np.ndarray, rng: np.random.Generator):
        extent = np.ptp(face, axis=0).max() if len(face) else 1.0
        self.frequencies = rng.normal(size=(3, self.WAVES)) * (2.0 / max(extent, 1e-9))

    def __call__(self, places: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        phases = rng.uniform(0, 2 * np.pi, self.WAVES)
        waves = np.cos(places @ self.frequencies + phases) * np.sqrt(2 / self.WAVES)
        return rng.normal(size=(count, self.WAVES)) @ waves.T


def _gains(rig: Rig, neutral, field: _SmoothField, strength: float, rng: np.random.Generator) -> np.ndarray:
    """(N, V, 1) float32: the gain of each shape at each vertex, always positive."""
    own = _paired(rig, rng)
    common, local = field(neutral, 1, rng), field(neutral, len(own), rng)
    log_gain = SHAPE_GAIN * own[:, None] + FIELD_GAIN * (common + local) / np.sqrt(2)
    energy = np.einsum("nvk,nvk->nv", rig.deltas, rig.deltas)
    log_gain -= (log_gain * energy).sum() / max(float(energy.sum()), 1e-12)  # a face that only does more is no mismatch
    log_gain[_closing(rig)] = 0
    log_gain = log_gain[_alike(rig)]
    return np.exp(strength * log_gain).astype(np.float32)[..., None]


def _closing(rig: Rig) -> list[int]:
    """Shapes that close a gap, as a blink does: they do so on every face, whatever its gain."""
    found = set()
    for pairs in rig.contacts.values():
        rest = rig.mesh.vertices[pairs[:, 0]] - rig.mesh.vertices[pairs[:, 1]]
        gaps = np.linalg.norm(rest + rig.deltas[:, pairs[:, 0]] - rig.deltas[:, pairs[:, 1]], axis=2).mean(1)
        open_gap = np.linalg.norm(rest, axis=1).mean()
        found.update(np.flatnonzero((open_gap > 1.0) & (gaps < 0.25 * open_gap)).tolist())
    return sorted(found)


def _alike(rig: Rig) -> np.ndarray:
    """(N,): whose personality each shape has; mouthClose undoes what jawOpen does to the lips, so it has that one's."""
    whose = np.arange(len(rig.names))
    for jaw, close in _jaw_and_close(rig.names):
        whose[close] = jaw
    return whose


def _jaw_and_close(names: Sequence[str]) -> list[tuple[int, int]]:
    """Where jawOpen and mouthClose are, if a rig has both."""
    place = {canonical(name): i for i, name in enumerate(names)}
    return [(place["jawOpen"], place["mouthClose"])] if {"jawOpen", "mouthClose"} <= set(place) else []


def _co_active_pairs(rig: Rig, deltas: np.ndarray, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Up to twelve pairs of shapes that move the same skin in different ways, drawn more often the more they share.

    mouthClose is in no pair: what would come with it is a mouth that does not close.
    """
    size = np.linalg.norm(deltas, axis=2).astype(np.float64)
    energy = np.sqrt((size**2).sum(1)) + 1e-12
    shared = (size @ size.T) / np.outer(energy, energy)
    flat = deltas.reshape(len(size), -1)
    alike = np.abs(flat @ flat.T) / np.outer(energy, energy)
    score = shared * (1 - alike) * np.sqrt(np.outer(energy, energy))
    first, second = np.triu_indices(len(size), 1)
    fits = (shared[first, second] > 0.25) & (alike[first, second] < 0.9) & (rig.mirror[first] != second)
    first, second = first[fits], second[fits]
    if not len(first):
        return []
    chance = score[first, second] / score[first, second].sum()
    drawn = rng.choice(len(first), min(CORRECTIVES, np.count_nonzero(chance)), replace=False, p=chance)
    closing = {close for _, close in _jaw_and_close(rig.names)}
    pairs = [(int(first[k]), int(second[k])) for k in sorted(drawn)]
    return [pair for pair in pairs if closing.isdisjoint(pair)]


def _corrective(pair: np.ndarray, neutral, field: _SmoothField, size: float, rng: np.random.Generator) -> np.ndarray:
    """(V, 3): a smooth motion where both shapes move skin; its largest is `size` times that of the smaller driver."""
    lengths = np.linalg.norm(pair, axis=2)
    window = lengths[0] * lengths[1] / (lengths[0] + lengths[1] + 1e-9)
    motion = field(neutral, 3, rng).T * window[:, None]
    largest = np.linalg.norm(motion, axis=1).max()
    return motion * (size * lengths.max(1).min() / largest) if largest > 0 else motion
