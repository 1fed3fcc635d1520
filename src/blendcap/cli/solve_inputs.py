"""What `blendcap solve` read is tried before the work: what could not serve is refused, what looks odd is said."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import blendcap

if TYPE_CHECKING:
    from blendcap import SolveSettings
    from blendcap.data import MarkerTake, Rig

FIRST = 10  # frames that are looked at
FACE_MM = 40.0, 500.0  # the widest side of the box around markers of a face, those on a helmet too

log = logging.getLogger(__name__)


def check_inputs(
    path: Path, take: MarkerTake, rig: Rig, places: Mapping[str, Any] | None, settings: SolveSettings
) -> None:
    """Check a take that was read from `path`, and what it is to be solved with.

    Raises
    ------
    InputError
        If a place is a landmark and the rig has none, or a stable marker could not be used.
    """
    from blendcap.data import landmarks68

    if any(str(place).startswith("landmarks68/") for place in (places or {}).values()):
        landmarks68(rig)  # says how to give it some
    if settings.stable:
        known = [name for name in take.names if places is None or name in places]
        _check_stable(settings, take.names, known)
    _check_size(path, take)


def _check_stable(settings: SolveSettings, names: tuple[str, ...], bound: list[str]) -> None:
    from blendcap.data.names import listed

    if settings.head == "keep":
        raise blendcap.InputError("--stable says how to remove the head's motion, and --head keep not to; choose one.")
    for name in settings.stable:
        if name not in bound:
            lacks = "has no correspondence" if name in names else "the take does not have"
            close = get_close_matches(name, bound, 1)
            hint = f"do you mean {close[0]!r}?" if close else f"there are {listed(bound, 12)}."
            raise blendcap.InputError(f"--stable names the marker {name!r}, which {lacks}; {hint}")
    if len(settings.stable) < 3:
        raise blendcap.InputError(
            f"--stable names only {len(settings.stable)}; to find the head takes at least three markers."
        )


def _check_size(path: Path, take: MarkerTake) -> None:
    """Warn of markers in a box that no face fills, as in a wrong unit."""
    import numpy as np

    first = take.positions[:FIRST]
    seen = first[np.isfinite(first).all(2)]
    if len(seen) and not FACE_MM[0] <= (widest := float(np.ptp(seen, axis=0).max())) <= FACE_MM[1]:
        log.warning("The markers of %s span %.0f mm, which is no face: if its unit is wrong, say --unit.", path, widest)
