"""Neutral scans with shut eyes: a rig needs them open, so the lids are the template's, in the actor's size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from blendcap.data import Rig, SurfacePoints
from blendcap.modeling.landmark_names import ON_A_LINE, line_names
from blendcap.numerics.similarity import align

SHUT = 0.35  # of the template's opening: an eye that opens less is shut
MARGIN = 1.0  # of the template's opening: how far from the lids' edges the scan is not believed

Pairs = tuple[SurfacePoints, np.ndarray]


class OpenEyes(NamedTuple):
    """Landmarks without the lines of shut lids, the template's vertices (K,) around these lids, and a sentence."""

    pairs: Pairs | None
    free: np.ndarray
    notes: list[str]


def keep_eyes_open(template: Rig, pairs: Pairs | None) -> OpenEyes:
    """What of the landmarks, and of the template, is not to follow the scan because its eyes are shut.

    Parameters
    ----------
    template : Rig
    pairs : (SurfacePoints (L), (L, 3) float64) or None
        Points on the template and where they are on the scan, in any unit.
    """
    if pairs is None or len(pairs[1]) < 3:
        return OpenEyes(pairs, np.zeros(0, np.int64), [])
    points, places = pairs
    there, row = points.positions(template.mesh), {name: k for k, name in enumerate(points.names)}
    scale = float(align(there, places)[2])
    dropped: list[int] = []
    free: list[np.ndarray] = []
    for side in ("left", "right"):
        upper, lower = (line_names(f"lids_{edge}_{side}") for edge in ("upper", "lower"))
        if not all(name in row for name in (*upper, *lower)):
            continue
        inner = slice(ON_A_LINE // 4, -(ON_A_LINE // 4))
        above, below = ([row[name] for name in line] for line in (upper, lower))
        opening, own = (np.linalg.norm(at[above] - at[below], axis=1)[inner].mean() for at in (there, places / scale))
        if own < SHUT * opening:
            dropped += above + below
            free.append(_around(template.mesh.vertices, there[above + below], MARGIN * opening))
    if not dropped:
        return OpenEyes(pairs, np.zeros(0, np.int64), [])
    kept = [k for k in range(len(places)) if k not in dropped]
    left = points.select([points.names[k] for k in kept]), places[kept]
    eyes = "eyes are" if len(free) == 2 else "eye is"
    said = f"The scan's {eyes} shut: the lids follow the skin around them, open as in the template, as a neutral's are."
    return OpenEyes(left, np.unique(np.concatenate(free)), [said])


def _around(vertices: np.ndarray, edge: np.ndarray, reach: float) -> np.ndarray:
    """Vertices nearer than `reach` to the points of an edge."""
    return np.flatnonzero((np.linalg.norm(vertices[:, None] - edge, axis=2) < reach).any(1))
