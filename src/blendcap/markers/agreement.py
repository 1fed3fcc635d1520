"""Do tracks move as the markers do? Those of another take, or of a film that begins elsewhere, do not."""

from __future__ import annotations

import logging

import numpy as np

from blendcap.solving.paper import solve_paper
from blendcap.solving.rows import MarkerRows

log = logging.getLogger(__name__)

RIDGE = 1.0  # mm²: a rough solve of the markers is enough
MOVING = 0.1  # mm: root mean square motion from which on a track and what the markers say of it can be compared
FEWEST = 20  # such tracks
LEAST = 0.2  # of a track's motion that the markers explain: 0.99 of a face full of markers, 0.4 where half is bare
REACH = 0.25  # seconds by which the film may be early or late


def check_agreement(rows: MarkerRows, rate: float) -> None:
    """Warn of tracks that do not move as the markers do, and of a film that is early or late.

    Parameters
    ----------
    rows : MarkerRows
        Of markers and tracks.
    rate : float
        Frames a second.
    """
    unknowns, _, _ = solve_paper(rows.markers, 0.0, RIDGE)
    reach = min(round(REACH * rate), len(rows.targets) // 4)
    shares = {delay: _explained(rows, unknowns, delay) for delay in range(-reach, reach + 1)}
    best = max(shares, key=lambda delay: shares[delay])
    if np.isnan(shares[best]):
        return  # they tell of what no marker sees, or nothing moves
    if shares[best] < LEAST:
        log.warning(
            "The tracks hardly move as the markers do, which foretell %.0f %% of it: if they are of another take, the "
            "answer is wrong. Follow the paint in the film of this take.", 100 * max(shares[best], 0.0),
        )  # fmt: skip
        return
    if best:
        log.warning(
            "The film seems to begin %s%d frame%s %s the markers, and tracks gain much less so: cut both alike.",
            "at least " * (abs(best) == reach), abs(best), "s" * (abs(best) > 1), "before" if best > 0 else "after",
        )  # fmt: skip


def _explained(rows: MarkerRows, unknowns: np.ndarray, delay: int) -> float:
    """Part of the tracks' motion (the median of those that can be compared) that the markers foretell; NaN if few can.

    `delay` is by how many frames the tracks are late.
    """
    frames, tracks = len(rows.targets), rows.tracks
    later, earlier = (slice(max(d, 0), frames + min(d, 0)) for d in (delay, -delay))
    seen = ~rows.missing[later][:, tracks]
    moved, foretold = rows.targets[later][:, tracks], rows.predict(unknowns)[earlier][:, tracks]
    left, motion, meant = (
        (seen[..., None] * part**2).sum((0, 2)) for part in (moved - foretold, moved, foretold)
    )  # fmt: skip
    least = MOVING**2 * seen.sum(0)
    compared = (motion > least) & (meant > least) & seen.any(0)
    if np.count_nonzero(compared) < FEWEST:
        return np.nan
    return float(np.median(1 - left[compared] / motion[compared]))
