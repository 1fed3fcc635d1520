"""How strongly an action unit is performed, told from its own frames alone: clusters along its largest variation.

Section 7.2.3 of Reading Between the Dots (2016), section 4.1.11 of the thesis: K-means with 4 clusters on the first
mode of variation of a region's pictures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEVELS = 4  # 0 is at rest
TOP = 95  # percentile of the distance from neutral that counts as full intensity


@dataclass(frozen=True, eq=False)
class Intensity:
    """The scale of one action unit in one region.

    Parameters
    ----------
    direction : (D,)
        The first mode of variation, pointing from neutral to the unit.
    neutral : float
        The neutral picture's place along it.
    full : float
        Distance from neutral to full intensity.
    centers : (LEVELS,)
        Of the clusters, 0 neutral to 1 full, rising.
    """

    direction: np.ndarray
    neutral: float
    full: float
    centers: np.ndarray

    def amount(self, pictures: np.ndarray) -> np.ndarray:
        """Intensity (T,), 0 to 1, of pictures (T, D)."""
        return np.clip((pictures @ self.direction - self.neutral) / self.full, 0, 1)

    def level(self, pictures: np.ndarray) -> np.ndarray:
        """Nearest cluster (T,) int, 0 (at rest) to 3, of pictures (T, D)."""
        return np.abs(self.amount(pictures)[:, None] - self.centers).argmin(1)


def measure_intensity(pictures: np.ndarray, neutral: np.ndarray, seed: int = 0) -> Intensity:
    """The scale of a unit from frames in which it is performed.

    Parameters
    ----------
    pictures : (T, D) float
        The region's pictures while the unit rises and falls.
    neutral : (D,)
        The picture at rest: it says which end of the mode is which.
    """
    from sklearn.cluster import KMeans

    mean = pictures.mean(0)
    _, _, modes = np.linalg.svd(pictures - mean, full_matrices=False)
    scores = (pictures - neutral) @ modes[0]
    sign = 1.0 if np.median(scores) + scores.mean() >= 0 else -1.0
    full = max(float(np.percentile(sign * scores, TOP)), 1e-9)
    amount = np.clip(sign * scores / full, 0, 1)
    clusters = KMeans(LEVELS, n_init="auto", random_state=seed).fit(amount[:, None])
    direction = sign * modes[0]
    return Intensity(direction, float(neutral @ direction), full, np.sort(clusters.cluster_centers_.ravel()))


def recognized(amounts: np.ndarray) -> np.ndarray:
    """(T,) the unit that is strongest, -1 where none reaches a sixth of full intensity (half the way to level 1)."""
    best = amounts.argmax(1)
    return np.where(amounts[np.arange(len(amounts)), best] >= 0.5 / (LEVELS - 1), best, -1)


def is_clear(amounts: np.ndarray) -> np.ndarray:
    """(T,) bool: plainly at rest or plainly not; in between even a person could not say."""
    strongest = amounts.max(1)
    return (strongest < 0.12) | (strongest > 0.3)
