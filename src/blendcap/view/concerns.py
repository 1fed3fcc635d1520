"""What somebody who knows solves would point at in an answer, in plain sentences."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from blendcap.data import Binding, Rig, Solution
from blendcap.data.names import canonical, listed
from blendcap.numerics.stretches import stretches
from blendcap.solving.shares import full_weights, in_shares
from blendcap.view.parted_lips import parted_lips
from blendcap.view.plots import marker_errors
from blendcap.view.posing import weights_on

OPPOSITE = -0.75  # cosine of two shapes' motions below which they undo each other
ASTRAY = 4.0  # times the usual error, and at least FAR, for a marker to be called bad
FAR = 1.0  # mm
ELSEWHERE = 15.0, 5.0  # mm, and times the usual distance, of a neutral marker from its place: it belongs elsewhere
AROUND = 0.5  # seconds over which a marker's error is averaged before it is judged
MOST = 6  # bad markers to name; the table has them all
NAMED = 4  # shapes that nobody sees; the table has them all
BLINKS = ("eyeBlinkLeft", "eyeBlinkRight")
MISFIT = 3.0  # mm, of all markers and frames: more than another's face explains
APART = 0.3  # of a weight: patches and markers disagree
TOGETHER = 0.25  # of a full shape: two that undo each other and are on by more


def concerns(rig: Rig, solution: Solution, binding: Binding | None = None) -> list[str]:
    """Reasons to look twice, the gravest first; empty if there is none."""
    return [
        *_trouble_of_the_solve(solution, binding),
        *_misplaced(rig, binding),
        *_unseen(rig, solution),
        *_bad_markers(solution),
        *_conflicts(rig, solution),
        *_disagreement(solution),
        *_limits(rig, solution),
        *_lips(rig, solution, binding),
    ]


def _trouble_of_the_solve(solution: Solution, binding: Binding | None) -> list[str]:
    said = []
    if not solution.certificate.converged:
        said.append(
            f"The solve did not reach its optimum (largest optimality residual {solution.certificate.max_kkt:.1e}): "
            "do not use these weights."
        )
    if binding is not None and binding.automatic:
        said.append(
            "The places of the markers were found automatically. Check the picture of the markers on the face, "
            "or give correspondences."
        )
    if solution.rms_mm > MISFIT:
        said.append(
            f"The markers lie {solution.rms_mm:.1f} mm off the face (root mean square): the take may not begin "
            "neutral, or labels may be exchanged."
        )
    return said


def _lips(rig: Rig, solution: Solution, binding: Binding | None) -> list[str]:
    parted = None if binding is None else parted_lips(rig, solution, binding)
    if parted is None:
        return []
    apart, first, last = parted
    return [
        f"The lips are up to {apart:.1f} mm apart {_when(solution, first, last)}, while the markers above and below "
        "them are about as close as at rest. No marker sits where lips meet: compare with the recording, and close "
        "them by hand if they were shut."
    ]


def _misplaced(rig: Rig, binding: Binding | None) -> list[str]:
    """Markers that lie far from their places in the neutral pose, and which others lie there."""
    if binding is None or not len(binding.offsets):
        return []
    away = np.linalg.norm(binding.offsets, axis=1)
    usual, names = float(np.median(away)), binding.points.names
    bad = np.flatnonzero(away > max(ELSEWHERE[0], ELSEWHERE[1] * usual))
    places = binding.points.positions(rig.mesh)
    said = []
    for m in bad[np.argsort(-away[bad])][:MOST]:
        from_others = np.linalg.norm(places[bad] - places[m] - binding.offsets[m], axis=1)
        k = int(from_others.argmin())
        guess = f", near that of {names[bad[k]]}" if bad[k] != m and from_others[k] < away[m] / 3 else ""
        said.append(
            f"In the neutral pose {names[m]} lies {away[m]:.0f} mm from its place{guess}, half of the others within "
            f"{usual:.0f}: check its label and its correspondence."
        )
    return said


def _unseen(rig: Rig, solution: Solution) -> list[str]:
    """What the markers cannot tell: blinks first, as everybody sees them, then of the others those that move most."""
    blinks = [name for name in solution.unseen if canonical(name) in BLINKS]
    said = []
    if blinks:
        still = "are held at rest" if set(blinks) <= set(solution.held) else "are partly a guess"
        said.append(
            f"The markers cannot tell the blinks, which {still}: {_seen_so(solution, blinks)}. Put markers on the "
            "upper lids, or give makeup patches."
        )
    motion = np.linalg.norm(rig.deltas, axis=2).max(1, initial=0) * np.abs(rig.bounds).max(1, initial=0)
    others = sorted(set(solution.unseen) - set(blinks), key=lambda name: (-motion[rig.index(name)], name))
    for held, what in ((True, "are held at rest"), (False, "follow their partner or are a guess")):
        names = [name for name in others if (name in solution.held) == held]
        if names:
            order = "; those that move the face most come first" if len(names) > 1 else ""
            said.append(
                f"The markers cannot tell {len(names)} {'more ' if blinks else ''}of the shapes, which {what}{order}: "
                f"{_seen_so(solution, names)}."
            )
    return said


def _seen_so(solution: Solution, names: list[str]) -> str:
    return listed([f"{name} ({sight(solution.unseen[name])})" for name in names], NAMED)


def sight(error: float) -> str:
    """How well the markers tell a weight, in words."""
    return f"±{error:.2f}" if error < 1 else "not at all"


def _bad_markers(solution: Solution) -> list[str]:
    said = []
    rms, _ = marker_errors(solution)
    lost = np.isnan(solution.residuals).mean(0)
    usual = float(np.nanmedian(rms)) if np.isfinite(rms).any() else np.nan
    bad = [(_rms(solution, *span), *span) for span in _spans_astray(solution, usual)]
    for error, m, first, last in sorted(bad, reverse=True)[:MOST]:
        whole = first == 0 and last == len(solution.residuals) - 1
        cause = "check its label and place" if whole else "a motion that the rig lacks, or a wrong label"
        said.append(
            f"Marker {solution.marker_names[m]} is off by {error:.1f} mm {_when(solution, first, last)}, the others by "
            f"{usual:.1f}: {cause}."
        )
    gone = [f"{solution.marker_names[m]} ({lost[m]:.0%})" for m in np.argsort(-lost, kind="stable") if lost[m] > 0.3]
    return [*said, f"Often missing, in so many of the frames: {', '.join(gone)}."] if gone else said


def _spans_astray(solution: Solution, usual: float) -> list[tuple[int, int, int]]:
    """(marker, first frame, last frame) of the longest stretch in which each bad marker is far off."""
    animation = solution.animation
    width = max(1, round(AROUND * animation.rate))
    squared, seen = np.nan_to_num(solution.residuals) ** 2, np.isfinite(solution.residuals).astype(float)
    squared, seen = (uniform_filter1d(values, width, axis=0, mode="nearest") for values in (squared, seen))
    error = np.sqrt(np.maximum(squared, 0) / np.maximum(seen, 1 / width))
    off, spans = error > max(ASTRAY * usual, FAR), []
    for m in np.flatnonzero(off.any(0)):
        first, last = max(stretches(off[:, m]), key=lambda stretch: stretch[1] - stretch[0])
        if last - first + 1 > width:
            spans.append((int(m), first, last))
    return spans


def _rms(solution: Solution, m: int, first: int, last: int) -> float:
    return float(np.sqrt(np.nanmean(solution.residuals[first : last + 1, m] ** 2)))


def _when(solution: Solution, first: int, last: int) -> str:
    times = solution.animation.times
    if first == 0 and last == len(times) - 1:
        return "all the time"
    begin = "from the start" if first == 0 else f"from frame {first} ({times[first]:.1f} s)"
    end = "to the end" if last == len(times) - 1 else f"to frame {last} ({times[last]:.1f} s)"
    return f"{begin} {end}"


def _conflicts(rig: Rig, solution: Solution) -> list[str]:
    """Pairs of shapes that undo each other and are on together."""
    weights = weights_on(rig, solution.animation) / full_weights(rig)
    used = np.flatnonzero((weights > TOGETHER).any(0))
    motion = in_shares(rig).deltas.reshape(len(rig.names), -1)[used]
    length = np.sqrt(np.einsum("nv,nv->n", motion, motion, dtype=np.float64))
    cosine = (motion @ motion.T) / np.maximum(np.outer(length, length), 1e-12)
    said = []
    for i, j in np.argwhere(np.triu(cosine < OPPOSITE, 1)):
        share = float((np.minimum(weights[:, used[i]], weights[:, used[j]]) > TOGETHER).mean())
        if share > 0.02:
            one, two = rig.names[used[i]], rig.names[used[j]]
            said.append(f"{one} and {two} undo each other, but are on together in {share:.0%} of the frames.")
    return said


def _disagreement(solution: Solution) -> list[str]:
    """Shapes of which the makeup patches say something else than the answer."""
    if solution.conflict is None:
        return []
    share = (solution.conflict > APART).mean(0)
    names = [f"{solution.animation.names[n]} ({share[n]:.0%})" for n in np.argsort(-share) if share[n] > 0.05]
    if not names:
        return []
    return [f"Patches and markers disagree by more than {APART}, in so many of the frames: {', '.join(names)}."]


def _limits(rig: Rig, solution: Solution) -> list[str]:
    """Shapes that stay at their upper bound: the performer goes further than the rig."""
    bounds = rig.bounds[[rig.index(name) for name in solution.animation.names], 1]
    full = (solution.animation.weights >= bounds - 1e-6).mean(0)
    names = [f"{solution.animation.names[n]} ({full[n]:.0%})" for n in np.argsort(-full) if full[n] > 0.1]
    if not names:
        return []
    return [f"Often at the upper limit, as if the performer went further than the rig: {', '.join(names)}."]
