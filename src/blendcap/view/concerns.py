"""What somebody who knows solves would point at in an answer, in plain sentences."""

from __future__ import annotations

import numpy as np

from blendcap.data import Binding, Rig, Solution
from blendcap.view.plots import marker_errors
from blendcap.view.posing import weights_on

OPPOSITE = -0.75  # cosine of two shapes' motions below which they undo each other
TOGETHER = 0.25  # weight above which a shape counts in that


def concerns(rig: Rig, solution: Solution, binding: Binding | None = None) -> list[str]:
    """Reasons to look twice, the gravest first; empty if there is none."""
    return [
        *_trouble_of_the_solve(solution, binding),
        *_unseen(solution),
        *_bad_markers(solution),
        *_conflicts(rig, solution),
        *_limits(rig, solution),
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
    return said


def _unseen(solution: Solution) -> list[str]:
    if not solution.unseen:
        return []
    names = ", ".join(
        f"{name} (±{error:.2f})" if error < 1 else f"{name} (not at all)" for name, error in solution.unseen.items()
    )
    return [f"These markers cannot see {len(solution.unseen)} of the shapes; their weights are a guess: {names}."]


def _bad_markers(solution: Solution) -> list[str]:
    said = []
    rms, _ = marker_errors(solution)
    lost = np.isnan(solution.residuals).mean(0)
    usual = float(np.nanmedian(rms)) if np.isfinite(rms).any() else np.nan
    for m, name in enumerate(solution.marker_names):
        if rms[m] > 3 * usual and rms[m] > 1:
            said.append(
                f"Marker {name} is off by {rms[m]:.1f} mm, the others by {usual:.1f}: check its label and place."
            )
    gone = [f"{solution.marker_names[m]} ({lost[m]:.0%})" for m in np.argsort(-lost, kind="stable") if lost[m] > 0.3]
    return [*said, f"Often missing, in so many of the frames: {', '.join(gone)}."] if gone else said


def _conflicts(rig: Rig, solution: Solution) -> list[str]:
    """Pairs of shapes that undo each other and are on together."""
    weights = weights_on(rig, solution.animation)
    used = np.flatnonzero((weights > TOGETHER).any(0))
    motion = rig.deltas.reshape(len(rig.names), -1)[used]
    length = np.sqrt(np.einsum("nv,nv->n", motion, motion, dtype=np.float64))
    cosine = (motion @ motion.T) / np.maximum(np.outer(length, length), 1e-12)
    said = []
    for i, j in np.argwhere(np.triu(cosine < OPPOSITE, 1)):
        share = float((np.minimum(weights[:, used[i]], weights[:, used[j]]) > TOGETHER).mean())
        if share > 0.02:
            one, two = rig.names[used[i]], rig.names[used[j]]
            said.append(f"{one} and {two} undo each other, but are on together in {share:.0%} of the frames.")
    return said


def _limits(rig: Rig, solution: Solution) -> list[str]:
    """Shapes that stay at their upper bound: the performer goes further than the rig."""
    bounds = rig.bounds[[rig.index(name) for name in solution.animation.names], 1]
    full = (solution.animation.weights >= bounds - 1e-6).mean(0)
    names = [f"{solution.animation.names[n]} ({full[n]:.0%})" for n in np.argsort(-full) if full[n] > 0.1]
    if not names:
        return []
    return [f"Often at the upper limit, as if the performer went further than the rig: {', '.join(names)}."]
