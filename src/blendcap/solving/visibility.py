"""Which shapes the markers tell apart, and which are held at rest because they do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import Rig
from blendcap.data.names import canonical, opposite_map
from blendcap.solving.prior import HELMET_RIDGE, START_DEVIATION, SYMMETRY
from blendcap.solving.rows import MarkerRows

UNSEEN = START_DEVIATION  # a weight of which the markers tell less than a guess would is not seen
EXCLUSION = 0.9  # how sure it is that a shape and the one that excludes it are not on together
NEUTRAL = 0.5  # part of the noise of a frame that is left in the mean of a few, as the neutral is


@dataclass(frozen=True, eq=False)
class Kinship:
    """How the shapes of a rig belong together.

    Parameters
    ----------
    mirror : (N,) int
        Left and right partners; itself if it has none. Eyes look the same way: one in goes with the other out.
    opposite : (N,) int
        The shape that excludes each shape (lid up and lid down); itself if none does.
    lids, eyeballs : (N,) bool
        Shapes of the lids, and those that turn or change the eyeball, on which no marker sits.
    quick : (N,) bool
        Shapes that move within a few frames and else are calm, as blinks.
    symmetry : float
        Correlation of partners before the take is seen; at 0 nobody has one.
    """

    mirror: np.ndarray
    opposite: np.ndarray
    lids: np.ndarray
    eyeballs: np.ndarray
    quick: np.ndarray
    symmetry: float = SYMMETRY

    @classmethod
    def of_pairs(cls, mirror: np.ndarray, symmetry: float = SYMMETRY) -> Kinship:
        """Partners and nothing else."""
        none = np.zeros(len(mirror), dtype=bool)
        return cls(mirror, np.arange(len(mirror)), none, none, none, symmetry)

    @classmethod
    def of_rig(cls, rig: Rig, symmetry: float = SYMMETRY) -> Kinship:
        """What the rig's mirror map and the names of its shapes say."""
        opposite = opposite_map(rig.names)
        names = [canonical(name) for name in rig.names]
        eyeballs = np.array([name.startswith(("eyeLook", "pupil")) for name in names], dtype=bool)
        lids = np.array([name.startswith("eye") for name in names], dtype=bool) & ~eyeballs
        quick = np.array([name.startswith("eyeBlink") for name in names], dtype=bool)
        sideways = np.array([name.startswith(("eyeLookIn", "eyeLookOut")) for name in names], dtype=bool)
        sides = rig.mirror != np.arange(len(names))
        crossed = sideways & sides & (opposite[rig.mirror] == rig.mirror[opposite])  # a rig may lack one of the four
        return cls(np.where(crossed, opposite[rig.mirror], rig.mirror), opposite, lids, eyeballs, quick, symmetry)

    @property
    def partner(self) -> np.ndarray:
        """(N,) int: the shape that goes with each; the jaw to the left does not go with the jaw to the right."""
        alone = (self.opposite == self.mirror) | (self.symmetry == 0)
        return np.where(alone, np.arange(len(self.mirror)), self.mirror)

    def covariance(self) -> np.ndarray:
        """(N, N) of the weights before any marker is seen."""
        own, partner = np.arange(len(self.mirror)), self.partner
        together, apart = np.eye(len(own)), np.eye(len(own))
        together[own, partner] += self.symmetry * (partner != own)
        apart[own, self.opposite] -= EXCLUSION * (self.opposite != own)
        product = together @ apart
        return START_DEVIATION**2 * (product + product.T) / 2


def held_shapes(rows: MarkerRows, noise: float, kinship: Kinship, told: np.ndarray | float = 0.0) -> np.ndarray:
    """(N,) bool: shapes that the markers cannot tell apart from others or from nothing.

    A shape counts as seen if the markers, with all other shapes free to explain them too, know its weight better than
    UNSEEN, together with its partner on the other side, since the two go together. The worst is held at rest with its
    partner, and the rest judged anew, until all that is left is seen. Where lids and gaze explain the same motion of a
    lid, the gaze is held, and so it is where markers tell neither a lid that goes down nor one that goes up: markers
    sit on lids and not on eyeballs.

    Parameters
    ----------
    rows : MarkerRows
    noise : float
        What does not average out in time, of one coordinate, mm.
    kinship : Kinship
    told : (N,), optional
        Precision, one over variance, of what is known of each weight from elsewhere.
    """
    mirror = kinship.partner
    precision = np.broadcast_to(told, mirror.shape)
    alone = weight_errors(rows, noise, precision)
    free = together(alone, mirror) < UNSEEN
    swings = kinship.lids & (kinship.opposite != np.arange(len(mirror)))
    if swings.any() and not (free | free[kinship.opposite])[swings].any():
        free &= ~kinship.eyeballs
    while free.any():
        errors = joint_errors(rows, noise, kinship, precision, free)
        errors = np.where(free, np.minimum(errors, errors[mirror]), 0.0)
        worst = int(errors.argmax())
        if errors[worst] < UNSEEN:
            break
        gaze = free & kinship.eyeballs
        if gaze.any() and (kinship.lids | kinship.eyeballs)[worst]:
            free = free & ~gaze
        else:
            free[[worst, mirror[worst]]] = False
    return ~free


def together(errors: np.ndarray, partner: np.ndarray) -> np.ndarray:
    """(N,) standard error of what a shape and its partner do alike, from that of each (N,), may be infinite."""
    precision = errors**-2.0
    total = precision + precision[partner] * (partner != np.arange(len(partner)))
    return np.divide(1.0, np.sqrt(total), out=np.full(len(total), np.inf), where=total > 0)


def lasting_noise(noise: float, least: float) -> float:
    """What does not average out in time, mm: what the rig cannot explain, and the noise left in the neutral's mean.

    Parameters
    ----------
    noise : float
        Of one coordinate, with all that the rig leaves unexplained, mm.
    least : float
        The part of it that is new in every frame, mm.
    """
    return float(np.sqrt(max(noise**2 - least**2, 0.0) + (NEUTRAL * least) ** 2))


def weight_errors(rows: MarkerRows, noise: float, told: np.ndarray | float = 0.0) -> np.ndarray:
    """Standard error of each shape's weight if it alone moved, (N,); infinite if no marker moves with it.

    What a rigid motion of the helmet would explain just as well does not count as seen, and a marker counts as often
    as it was seen.

    Parameters
    ----------
    rows : MarkerRows
    noise : float
        Of one coordinate, mm.
    told : (N,), optional
        Precision, one over variance, of what is known of each weight from elsewhere.
    """
    scaled = rows.rows * np.sqrt(1 - rows.missing.mean(0))[:, None, None]
    columns = scaled.reshape(-1, scaled.shape[2])
    shapes, helmet = columns[:, : rows.shapes], columns[:, rows.shapes :]
    if helmet.shape[1]:
        basis, *_ = np.linalg.svd(helmet, full_matrices=False)
        shapes = shapes - basis @ (basis.T @ shapes)
    energy = np.linalg.norm(shapes, axis=0)
    precision = np.where(energy > 1e-9, (energy / max(noise, 1e-12)) ** 2, 0.0) + told
    return np.divide(1.0, np.sqrt(precision), out=np.full(rows.shapes, np.inf), where=precision > 0)


def joint_errors(rows: MarkerRows, noise: float, kinship: Kinship, told: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N,) standard error of each weight with all the free shapes at play; infinite for those that are not free.

    It is what the markers add: posterior variance v under a prior of variance c is that of a measurement whose
    variance e² is `1 / e² = 1 / v - 1 / c`.
    """
    chosen = np.flatnonzero(free)
    kept = np.r_[chosen, np.arange(rows.shapes, len(rows.lower))]
    variance = max(noise, 1e-6) ** 2
    prior = np.linalg.inv(kinship.covariance()[np.ix_(chosen, chosen)]) + np.diag(told[chosen])
    precision = rows.mean_gram[np.ix_(kept, kept)] / variance
    precision[: len(chosen), : len(chosen)] += prior
    helmet = np.arange(len(chosen), len(kept))
    precision[helmet, helmet] += HELMET_RIDGE / variance
    gained = 1 / np.diag(np.linalg.inv(precision))[: len(chosen)] - 1 / START_DEVIATION**2
    errors = np.full(rows.shapes, np.inf)
    errors[chosen] = np.divide(1.0, np.sqrt(np.maximum(gained, 0)), out=np.full(len(chosen), np.inf), where=gained > 0)
    return errors
