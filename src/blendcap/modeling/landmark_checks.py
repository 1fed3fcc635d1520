"""Landmarks on the wrong places are refused before the long work: sides swapped, two exchanged, most of them off."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from blendcap.data import InputError, Mesh
from blendcap.numerics.similarity import align, align_robust, apply
from blendcap.numerics.surfaces import face_normals

ODD = 0.4  # of the landmarks' spread: one that lies so far from where the others put it is likely another place
MIRRORED = 0.5  # landmarks that fit the mirrored template with less than this of their misfit have their sides swapped
MISFIT = 0.1  # of the spread: landmarks that fit this well are all alike to a robust fit
STRAIGHT = 0.2  # of the spread along a line: landmarks that spread less beside it lie on it
APART = 0.2  # of the spread: two exchanged ones lie farther than this from their places
AROUND = 0.3  # of the spread: how far around a landmark the surface tells outside from inside
TIP = 0.5  # of the spread: how far outside of each landmark the point lies that tells outside from inside
NEAR, MOST = 2.0, 0.8  # of the spread: how far around the landmarks, and which share of it, is to lie on the scan
SAMPLES = 500  # vertices of the template
WORST = 40  # landmarks at most that are tried for exchange

_log = logging.getLogger(__name__)


def check_landmarks(names: Sequence[str], here: np.ndarray, there: np.ndarray, template: Mesh, scan: Mesh) -> None:
    """Refuse landmarks that contradict each other; say single ones in a warning.

    Points alone do not tell sides where they lie in a plane, as eyes and the corners of a mouth do: half a turn lays
    them onto their mirror image. So each counts together with a point outside of it.

    Parameters
    ----------
    names : (L) sequence of str
    here, there : (L, 3) float64
        On the template and on the scan.
    template, scan : Mesh
        The surfaces that they lie on.

    Raises
    ------
    InputError
        If they fit the template's mirror image, two lie at each other's places, or most lie off.
    """
    spread = _spread(there)
    ours, scanned = _raised(here, template), _raised(there, scan)
    plain, mirror = (_untangled(side, scanned, spread) for side in (ours, ours * [-1.0, 1.0, 1.0]))
    if len(mirror[0]) < len(plain[0]) and mirror[1] < min(plain[1] / MIRRORED, ODD * spread):
        but = f", but for {_listed(names, mirror[0])}" if mirror[0] else ""
        raise InputError(
            f"The landmarks fit the mirror image of the template{but}: left and right are swapped (left is the "
            "subject's left), or the scan's triangles face inwards."
        )
    if plain[0] and plain[1] < ODD * spread:
        raise InputError(
            f"The landmarks {_listed(names, plain[0])} lie where each other should: exchange them; "
            "left is the subject's left."
        )
    if _mirrored_surface(here, there, template, scan):
        raise InputError(
            "With these landmarks only the mirror image of the template meets the scan: left and right are swapped; "
            "left is the subject's left."
        )
    along, beside, _ = np.linalg.svd(there - there.mean(0), compute_uv=False)
    if beside < STRAIGHT * along:
        _log.warning("The landmarks lie nearly on a line, which tells neither where up is nor how far a head nods; add "
                     "one beside it, as the tip of the nose.")  # fmt: skip
    _check_each(names, here, there, spread)


def _mirrored_surface(here: np.ndarray, there: np.ndarray, template: Mesh, scan: Mesh) -> bool:
    """Whether the surface around the landmarks lies off the scan, but its mirror image does not.

    Three landmarks fit their own mirror image, and where two of them face sideways their outsides do nearly so.
    """
    spread, away = _spread(here), KDTree(here).query(template.vertices)[0]
    around = template.vertices[away < NEAR * spread]
    around = around[:: max(1, len(around) // SAMPLES)]
    tree = KDTree(scan.vertices, balanced_tree=False, compact_nodes=False)
    plain, mirror = (
        float(np.quantile(tree.query(apply(around * side, *align(here * side, there)))[0], MOST))
        for side in (np.ones(3), np.array([-1.0, 1.0, 1.0]))
    )
    return mirror < MIRRORED * plain


def _listed(names: Sequence[str], pairs: list[tuple[int, int]]) -> str:
    more = f" ({len(pairs) - 3} more)" if len(pairs) > 3 else ""
    return ", ".join(f"{names[i]} and {names[j]}" for i, j in pairs[:3]) + more


def _check_each(names: Sequence[str], here: np.ndarray, there: np.ndarray, spread: float) -> None:
    """Refuse landmarks of which many lie off, warn of few."""
    off, odd = far_off(here, there)
    worst = ", ".join(f"{names[k]} ({off[k]:.0f} mm)" for k in np.argsort(off)[::-1][: min(odd.sum(), 3)])
    if _misfit(here[:, None], there[:, None]) > ODD * spread or odd.sum() > len(off) / 3:
        raise InputError(
            f"The landmarks do not fit the template: {odd.sum()} of {len(off)} lie far from where the others put them"
            f"{', as ' + worst if worst else ''}; check which point of the template each one names."
        )
    if odd.any():
        _log.warning("Landmarks that lie far from where the others put them: %s; check their places.", worst)


def far_off(here: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far landmarks (L, 3) of a scan lie from where the others put them (L,), and which lie too far (L,)."""
    spread = _spread(there)
    off = np.linalg.norm(apply(here, *align_robust(here, there, floor=MISFIT * spread)) - there, axis=1)
    return off, off > ODD * spread


def _untangled(ours: np.ndarray, scanned: np.ndarray, spread: float) -> tuple[list[tuple[int, int]], float]:
    """Pairs of landmarks, each of which lies where the other should, and the misfit that is left once exchanged.

    From landmarks (L, 2, 3) with their outsides; the exchange that helps most comes first.
    """
    order, found = np.arange(len(ours)), []
    for _ in range(len(ours) // 2):
        away = _away(ours[order], scanned)
        worst = np.argsort(away.max(1))[::-1][:WORST]
        first, second = (worst[k] for k in np.triu_indices(len(worst), 1))
        tried = np.tile(order, (len(first), 1))
        rows = np.arange(len(first))
        tried[rows, first], tried[rows, second] = order[second], order[first]
        squares = (_away(ours[tried], scanned) ** 2).sum((1, 2))
        best = int(np.argmin(squares))
        if squares[best] > (away**2).sum() - 4 * (APART * spread) ** 2:
            break
        order = tried[best]
        found.append(tuple(sorted((int(first[best]), int(second[best])))))
    placed = apply(ours[:, 0], *_fit(ours[order], scanned))
    gap = np.linalg.norm(placed[:, None] - scanned[None, :, 0], axis=2)  # from each place of the template to each found
    sure, order = [], np.arange(len(ours))
    for i, j in sorted(found):
        if max(gap[i, j], gap[j, i]) < MIRRORED * min(gap[i, i], gap[j, j]):
            sure.append((i, j))
            order[[i, j]] = j, i
    return sure, _misfit(ours[order], scanned)


def _spread(points: np.ndarray) -> float:
    return float(np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean()))


def _raised(points: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(L, 2, 3): each point, and one outside of it.

    Outside is where the surface faces that lies within AROUND: folds, as of lids, that lead in and out again cancel.
    """
    spread, normals = _spread(points), face_normals(mesh.vertices, mesh.faces)
    centers = KDTree(mesh.vertices[mesh.faces].mean(1), balanced_tree=False, compact_nodes=False)
    near = centers.query_ball_point(points, AROUND * spread)
    outside = np.array([normals[rows].sum(0) for rows in near])
    outside /= np.maximum(np.linalg.norm(outside, axis=1, keepdims=True), 1e-300)
    return np.stack([points, points + TIP * spread * outside], axis=1)


def _fit(ours: np.ndarray, scanned: np.ndarray):
    flat = (*ours.shape[:-3], -1, 3)
    return align(ours.reshape(flat), scanned.reshape(-1, 3))


def _away(ours: np.ndarray, scanned: np.ndarray) -> np.ndarray:
    """Distances (..., L, K) that are left between landmarks (..., L, K, 3) when they are aligned."""
    placed = apply(ours.reshape(*ours.shape[:-3], -1, 3), *_fit(ours, scanned))
    return np.linalg.norm(placed.reshape(ours.shape) - scanned, axis=-1)


def _misfit(ours: np.ndarray, scanned: np.ndarray) -> float:
    return float(np.sqrt((_away(ours, scanned) ** 2).mean()))
