"""Contact kept: what transferred shapes need so that the pairs that meet in the template meet in the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from blendcap.modeling.contacts import CLOSES, MEETS
from blendcap.modeling.differences import GAUGE
from blendcap.numerics.leastsq import factorize

PATCH = 10.0  # mm around the pairs that a correction may reach, at the template's size
YIELD = 1e-4  # of the usual compliance: pairs that only a tear could close are left


@dataclass(frozen=True, eq=False)
class Patch:
    """The skin around the contact pairs, and how it yields to a pull at each vertex of a pair.

    Parameters
    ----------
    pairs : (P, 2) int64
        Places of each pair's two vertices in `pulled`.
    pulled : (C,) int64
        Vertices that belong to a pair.
    near : (K,) int64
        Vertices of the patch.
    compliance : (K, C) float64
        Displacement of the patch under a unit pull at each pulled vertex: a membrane with a fixed border.
    residual : float
        Relative residual of the solve for it.
    """

    pairs: np.ndarray
    pulled: np.ndarray
    near: np.ndarray
    compliance: np.ndarray
    residual: float


def make_patch(rest: np.ndarray, pairs: np.ndarray, stiffness, reach: float) -> Patch:
    """The patch of all vertices within `reach` of a pulled one.

    `stiffness` (V, V) is the cotangent Laplacian of the surface: the metric of transfer itself, so that a correction
    changes the gradients of the shape as little as it can.
    """
    pulled, places = np.unique(pairs, return_inverse=True)
    distance, _ = KDTree(rest[pulled]).query(rest, distance_upper_bound=reach)
    near = np.flatnonzero(np.isfinite(distance) & (stiffness.diagonal() > 0))
    inner = sparse.csc_matrix(stiffness[near][:, near])
    factor = factorize(inner + sparse.diags(GAUGE * inner.diagonal()))
    pull = np.zeros((len(near), len(pulled)))
    pull[np.searchsorted(near, pulled), np.arange(len(pulled))] = 1
    compliance = factor.solve(pull)
    return Patch(places.reshape(-1, 2), pulled, near, compliance, factor.residual)


def close(
    patch: Patch, deltas: np.ndarray, wanted: np.ndarray, active: np.ndarray, motion: np.ndarray
) -> tuple[np.ndarray, float]:
    """The displacements (V, 3) of one shape, corrected so that the active pairs move apart or together as wanted.

    With them comes the relative residual of the solve for the pulls.

    Parameters
    ----------
    deltas : (V, 3) float64
    wanted : (P, 3) float64
        How the difference of each pair's displacements shall be.
    active : (P,) bool
    motion : (V,) float64
        How much the template's shape moves each vertex; where it moves nothing, nothing is corrected, and of a pair
        the vertex that moves more takes more.
    """
    largest = motion[patch.pulled].max(initial=0.0)
    if largest <= 0:
        return deltas, 0.0
    yields = np.minimum(motion / largest, 1.0)
    active = active & (yields[patch.pulled][patch.pairs].max(1) > 1e-3)
    if not active.any():
        return deltas, 0.0
    one, two = patch.pairs[active].T
    at = patch.pulled
    share = yields[at]
    columns = patch.compliance[:, one] * share[one] - patch.compliance[:, two] * share[two]
    columns *= yields[patch.near, None]
    rows = np.searchsorted(patch.near, at)
    system = columns[rows[one]] - columns[rows[two]]
    system[np.diag_indices_from(system)] += YIELD * np.median(np.diag(system))
    missing = wanted[active] - (deltas[at[one]] - deltas[at[two]])
    corrected = deltas.copy()
    pulls = np.linalg.solve(system, missing)
    corrected[patch.near] += columns @ pulls
    size = np.abs(system).sum(1).max() * np.abs(pulls).max() + np.abs(missing).max()
    return corrected, float(np.abs(system @ pulls - missing).max() / max(size, 1e-300))


def wanted_gaps(
    template_base: np.ndarray, template_change: np.ndarray, base: np.ndarray, unit: float
) -> tuple[np.ndarray, np.ndarray]:
    """What each pair shall do in a shape, (P, 3), and which pairs (P,) meet there.

    A pair that the template's shape closes shall be left with the template's own gap; one that was closed and stays so
    shall change as little as the template's.

    Parameters
    ----------
    template_base, template_change, base : (P, 3) float64
        The template's gap before the shape and what the shape adds, and the gap of the result before it: at rest, or
        with the shapes that drive this one.
    unit : float
        Size of the face against the template's.
    """
    left = template_base + template_change
    before, after = np.linalg.norm(template_base, axis=1), np.linalg.norm(left, axis=1)
    meets = after <= MEETS * unit
    closes = meets & (after < CLOSES * before)
    return np.where(closes[:, None], left - base, template_change), meets
