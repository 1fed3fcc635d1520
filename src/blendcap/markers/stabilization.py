"""Rigid head motion found from markers that move with the skull, and taken out of the take."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from blendcap.data import InputError, MarkerTake
from blendcap.markers.cleaning import neutral_frame
from blendcap.numerics.similarity import align, align_robust, apply

log = logging.getLogger(__name__)

_FEWEST = 4  # stable markers that `find_stable` looks for
OUTVOTE = 6  # stable markers from which on a minority can be told from the rest
_FRAMES = 400  # frames that it looks at
_NEAR = 20.0  # mm: closer pairs say little about a rotation
_RIGID = 0.75  # of the stable markers' squared motion, for it to count as the head's


def find_stable(take: MarkerTake) -> tuple[str, ...]:
    """The markers that move most like one rigid body over the take: names, in the take's order.

    From all markers, the one whose distances to the others vary most, relative to their length, is dropped again and
    again. Kept is the set with the smallest mean variation over the root of its size, the expected error of a pose
    fitted to it. What is stable depends on the take: the cheeks while the brows play, the forehead while the jaw does.

    Raises
    ------
    InputError
        If fewer than four markers are seen together.
    """
    step = -(-len(take.positions) // _FRAMES)
    strain, together = _strain(take.positions[::step])
    keep = np.flatnonzero((together & ~np.eye(len(together), dtype=bool)).sum(1) >= _FEWEST - 1)
    best, best_error = None, np.inf
    while len(keep) >= _FEWEST:
        pairs = strain[np.ix_(keep, keep)]
        varies = np.sqrt((pairs**2).sum(1) / (len(keep) - 1))
        error = np.sqrt((varies**2).mean() / len(keep))
        if error < best_error:
            best, best_error = keep, error
        keep = np.delete(keep, varies.argmax())
    if best is None:
        raise InputError(
            "Fewer than four markers are seen together, too few to find the head's motion; name the stable ones."
        )
    return tuple(take.names[i] for i in best)


def stabilize(
    take: MarkerTake,
    stable: Sequence[str] | None = None,
    *,
    rest: np.ndarray | None = None,
    frame: int = 0,
    always: bool = False,
) -> tuple[np.ndarray, MarkerTake]:
    """Take the rigid motion of the head out of a take.

    Each frame's stable markers are fitted to the neutral ones, one frame at a time: nothing is smoothed. Six markers
    or more are fitted by `align_robust`; of fewer, two sides may outvote each other in turns, and the head would jump
    from one to the other, so they are fitted by least squares. Frames that see fewer than three of them take the pose
    between their neighbors. A take in which a rigid motion explains less than three quarters of what the stable markers
    do is left as it is: on a helmet that sits tight, the fit would follow the skin.

    Parameters
    ----------
    take : MarkerTake
    stable : sequence of str, optional
        Markers that move with the skull; found if not given.
    rest : (M, 3) float64, optional
        All markers with the head at rest, mm; the take's own neutral if not given.
    frame : int
        First frame of that neutral (see `neutral_frame`).
    always : bool
        Take out what the stable markers say even if they hardly move like one body.

    Returns
    -------
    head : (T, 4, 4) float64
        From the stabilized take to the given one, mm.
    stabilized : MarkerTake

    Raises
    ------
    InputError
        If a stable marker is not in the take, or no frame sees three of them.
    """
    part = take.select(stable if stable is not None else find_stable(take))
    if rest is None:
        rest = neutral_frame(part, frame)
    else:
        rest = np.asarray(rest)[[take.names.index(name) for name in part.names]]
    rotations, translations = _poses(part.positions, rest)
    head = np.tile(np.eye(4), (len(take.positions), 1, 1))
    back = np.swapaxes(rotations, 1, 2)
    positions = apply(take.positions - translations[:, None], back, np.zeros(3))
    if not always and _explained(part.positions - rest, apply(rest, rotations, translations) - part.positions) < _RIGID:
        log.info("The stable markers do not move like one body; the take is left as it is.")
        return head, take
    head[:, :3, :3], head[:, :3, 3] = rotations, translations
    return head, replace(take, positions=positions)


def stabilize_live(take: MarkerTake, stable: Sequence[str], rest: np.ndarray) -> tuple[np.ndarray, MarkerTake]:
    """Take the rigid motion of the head out of a take, every frame from itself and the past only.

    Each frame's stable markers are fitted to those at rest by least squares; a frame that sees fewer than three of
    them keeps the pose before it.

    Parameters
    ----------
    take : MarkerTake
    stable : sequence of str
        Markers that move with the skull.
    rest : (M, 3) float64
        All markers with the head at rest, mm.

    Returns
    -------
    head : (T, 4, 4) float64
        From the stabilized take to the given one, mm.
    stabilized : MarkerTake
    """
    seen = take.select(stable).positions
    rest = np.asarray(rest)[[take.names.index(name) for name in stable]]
    head = np.tile(np.eye(4), (len(seen), 1, 1))
    enough = np.flatnonzero(np.isfinite(seen[..., 0]).sum(1) >= 3)
    if len(enough):
        rotations, translations, _ = align(rest, seen[enough], scale=False)
        latest = np.searchsorted(enough, np.arange(len(seen)), side="right") - 1
        known = latest >= 0
        head[known, :3, :3], head[known, :3, 3] = rotations[latest[known]], translations[latest[known]]
    positions = apply(take.positions - head[:, None, :3, 3], np.swapaxes(head[:, :3, :3], 1, 2), np.zeros(3))
    return head, replace(take, positions=positions)


def _strain(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, M) standard deviation of each mutual distance over its mean, and whether the two were seen together."""
    arms = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=-1)
    seen = np.isfinite(arms)
    count = seen.sum(0)
    mean = np.where(seen, arms, 0.0).sum(0) / np.maximum(count, 1)
    variance = np.where(seen, (arms - mean) ** 2, 0.0).sum(0) / np.maximum(count, 1)
    return np.sqrt(variance) / np.maximum(mean, _NEAR), count > 1


def _poses(positions: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (T, 3, 3) and translations (T, 3) that take the neutral to each frame."""
    enough = (np.isfinite(positions) & np.isfinite(rest)).all(-1).sum(1) >= 3
    if not enough.any():
        raise InputError("No frame sees three stable markers, so the head's motion is unknown; name other ones.")
    seen = positions[enough]
    first = align(rest, seen, scale=False)
    if positions.shape[1] < OUTVOTE:
        rotations, translations, _ = first
    else:
        rotations, translations = _outvoted(rest, seen, first)
    if enough.all():
        return rotations, translations
    log.warning("In %d frames the head's pose is interpolated: too few stable markers are seen.", (~enough).sum())
    return _interpolated(enough, rotations, translations, np.nanmean(rest, axis=0))


def _outvoted(rest: np.ndarray, seen: np.ndarray, first) -> tuple[np.ndarray, np.ndarray]:
    """Poses that a minority of the markers cannot pull away, from those of least squares."""
    # One width for the whole take: a width that followed each frame's own residuals would add noise to the poses.
    typical = float(np.nanmedian(np.linalg.norm(apply(rest, *first) - seen, axis=-1)))
    rotations, translations, _ = align_robust(rest, seen, scale=False, floor=max(3.0 * typical, 0.05))
    return rotations, translations


def _interpolated(known: np.ndarray, rotations, translations, center) -> tuple[np.ndarray, np.ndarray]:
    """Poses of all frames: turned evenly about `center` between known ones, held outside them."""
    from scipy.spatial.transform import Rotation, Slerp

    frames = np.flatnonzero(known)
    wanted = np.clip(np.arange(len(known)), frames[0], frames[-1])
    places = apply(np.broadcast_to(center, (len(frames), 1, 3)), rotations, translations)[:, 0]
    between = np.stack([np.interp(wanted, frames, places[:, k]) for k in range(3)], axis=1)
    if len(frames) > 1:
        rotations = Slerp(frames, Rotation.from_matrix(rotations))(wanted).as_matrix()
    else:
        rotations = np.repeat(rotations, len(known), axis=0)
    return rotations, between - rotations @ center


def _explained(before: np.ndarray, after: np.ndarray) -> float:
    """The share of the stable markers' motion that the poses take away."""
    return 1.0 - float(np.nansum(after**2) / max(np.nansum(before**2), 1e-300))
