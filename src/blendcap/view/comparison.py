"""The markers alone beside the hybrid solve: where the paint made a difference, and whether it is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from blendcap.data import Animation, InputError, Rig, Solution
from blendcap.data.anatomy import is_skin
from blendcap.io.video_write import write_video
from blendcap.metrics import evaluate
from blendcap.view import page
from blendcap.view.film import Film, pictures, reporting
from blendcap.view.posing import weights_on
from blendcap.view.still import still
from blendcap.view.style import BLUE, GREEN, INK, RED, inline_svg, new_figure, plain, styled, thinned

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HALF = Film((640, 720), (0.0,))  # how each of two faces is shown
MOST_CURVES = 12
CHANGED = 0.01  # a weight that changes by less is as it was
PICTURE = (600, 600)
PICTURES, APART = 3, 1.0  # frames that are shown, and seconds between them at least
SAID: dict[str, Any] = {"color": GREEN, "linewidth": 0.8, "linestyle": (0, (3, 2))}
TRUSTED: dict[str, Any] = {"color": GREEN, "alpha": 0.13, "linewidth": 0}
CONFLICT = 0.1  # of a weight: less is no disagreement that is worth a name
HALVES = ("upper", "lower")  # of the face: they hold all other regions


def comparison(rig: Rig, alone: Solution, hybrid: Solution, patches: Animation | None = None) -> str:
    """The two solves of a take as a part of a page: regions, curves, and the frames in which they differ most.

    Parameters
    ----------
    alone, hybrid : Solution
        Of the markers alone, and with curves of the patches or tracks.
    patches : Animation, optional
        The curves.
    """
    _check(alone.animation, hybrid.animation)
    html = page.table(["region", "apart on average"], _regions(rig, alone, hybrid))
    html += page.figure(inline_svg(plot_comparison(alone, hybrid, patches)), "Shapes that the paint changed most.")
    if hybrid.conflict is not None:
        html += page.figure(inline_svg(plot_conflict(hybrid)), "Where the answer is not what the patches say.")
    for frame in _frames_apart(rig, alone, hybrid):
        pair = [still(rig, weights_on(rig, s.animation)[frame], size=PICTURE, yaws=(0.0,)) for s in (alone, hybrid)]
        caption = f"Frame {frame}, {alone.animation.times[frame]:.2f} s: the markers alone, and with the paint."
        html += page.figure(page.image(np.hstack(pair), "side by side"), caption)
    return html


@styled
def plot_comparison(alone: Solution, hybrid: Solution, patches: Animation | None = None) -> Figure:
    """Weights over time of the shapes that the paint changed most: markers alone, hybrid, and what patches say."""
    ours, theirs = hybrid.animation, alone.animation
    change = np.sqrt(((ours.weights - theirs.select(ours.names).weights) ** 2).mean(0))
    order = np.argsort(-change, kind="stable")[: max(1, min(MOST_CURVES, int((change > CHANGED).sum())))]
    columns = min(2, len(order))
    rows = -(-len(order) // columns)
    figure = new_figure(8.4, 0.7 + 1.15 * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, n in zip(grid.flat, order, strict=False):
        name = ours.names[n]
        axes.plot(*thinned(theirs.times, theirs.weights[:, theirs.names.index(name)]), color=INK, linewidth=0.8)
        axes.plot(*thinned(ours.times, ours.weights[:, n]), color=BLUE)
        if patches is not None and name in patches.names:
            column = patches.names.index(name)
            axes.plot(*thinned(patches.times, patches.weights[:, column]), **SAID)
            if patches.confidence is not None:
                axes.fill_between(*thinned(patches.times, patches.confidence[:, column]), **TRUSTED)
        axes.set_title(plain(name), fontsize=8, pad=2)
    for axes in grid.flat[len(order) :]:
        axes.set_visible(False)
    grid[0, 0].set_ylim(-0.03, 1.05)
    figure.supxlabel("seconds", fontsize=8)
    axes = grid[0, 0]
    keys = {"markers alone": axes.plot([], color=INK)[0], "hybrid": axes.plot([], color=BLUE)[0]}
    if patches is not None:
        keys["what the patches say"] = axes.plot([], **SAID)[0]
        keys["how far that is trusted"] = axes.fill_between([], [], **TRUSTED)
    figure.legend(list(keys.values()), list(keys), ncols=len(keys), loc="outside upper right")
    return figure


@styled
def plot_conflict(hybrid: Solution) -> Figure:
    """How far the answer is from what the patches say, by their trust: in each frame of the shape that is farthest."""
    assert hybrid.conflict is not None
    animation, worst = hybrid.animation, hybrid.conflict.max(1)
    figure = new_figure(8.4, 2.0)
    axes = figure.subplots()
    axes.fill_between(*thinned(animation.times, worst), color=RED, alpha=0.12, linewidth=0)
    axes.plot(*thinned(animation.times, worst), color=RED, linewidth=0.9)
    for frame in _highest(worst, animation.rate):
        name = animation.names[int(hybrid.conflict[frame].argmax())]
        axes.plot(animation.times[frame], worst[frame], "o", color=RED, markersize=3)
        axes.annotate(
            f"{plain(name)}, frame {frame}", (animation.times[frame], worst[frame]), (0, 3), textcoords="offset points",
            fontsize=7, ha="center",
        )  # fmt: skip
    axes.set_ylim(0, max(1.15 * float(worst.max()), 0.1))
    axes.set_xlabel("seconds")
    axes.set_ylabel("weight × trust")
    return figure


def _highest(worst: np.ndarray, rate: float) -> list[int]:
    """The summits, `APART` seconds from each other, at which patches and answer are farthest apart."""
    from scipy.signal import find_peaks

    padded = np.pad(worst, 1, constant_values=-1)  # the first and the last frame may be summits, too
    peaks = find_peaks(padded, height=CONFLICT, distance=max(round(APART * rate), 1))[0] - 1
    return sorted(peaks[np.argsort(-worst[peaks], kind="stable")][:PICTURES].tolist())


def write_comparison(
    path: str | Path,
    rig: Rig,
    alone: Animation,
    hybrid: Animation,
    film: Film = HALF,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write a film: the face of the markers alone to the left, of the hybrid solve to the right.

    Parameters
    ----------
    film : Film
        How each of the two is shown; what it is stands behind the title.
    """
    _check(alone, hybrid)
    films = [
        pictures(rig, animation, replace(film, title=f"{film.title} {what}".strip()))
        for animation, what in ((alone, "markers alone"), (hybrid, "with the paint"))
    ]
    pairs = (np.hstack(pair) for pair in zip(*films, strict=True))
    size = (2 * film.size[0], film.size[1])
    return write_video(path, reporting(pairs, film.count(hybrid), progress), film.rate(hybrid), size)


def _check(alone: Animation, hybrid: Animation) -> None:
    if len(alone.weights) != len(hybrid.weights):
        raise InputError(
            f"The solves have {len(alone.weights)} and {len(hybrid.weights)} frames; compare two of the same take."
        )


def _regions(rig: Rig, alone: Solution, hybrid: Solution) -> list[list[str]]:
    apart = evaluate(hybrid.animation, alone.animation, rig).by_region_mm
    shown = {name: error for name, error in apart.items() if is_skin(name) and name not in HALVES}
    return [[name, f"{shown[name]:.2f} mm"] for name in sorted(shown, key=lambda name: -shown[name])]


def _frames_apart(rig: Rig, alone: Solution, hybrid: Solution) -> list[int]:
    """Frames in which the two faces differ most, well apart in time."""
    change = weights_on(rig, hybrid.animation) - weights_on(rig, alone.animation)
    flat = rig.deltas[:, rig.moving_vertices()].reshape(len(rig.names), -1).astype(np.float64)
    apart = np.einsum("ti,ij,tj->t", change, flat @ flat.T, change, optimize=True)
    gap, frames = APART * hybrid.animation.rate, []
    for frame in np.argsort(-apart, kind="stable"):
        if all(abs(frame - other) >= gap for other in frames):
            frames.append(int(frame))
        if len(frames) == PICTURES:
            break
    return frames
