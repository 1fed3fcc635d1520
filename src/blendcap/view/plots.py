"""The plots of a solve: those of the thesis (its figures 58 to 62) and what else shows whether to trust it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from blendcap.data import Animation, Binding, InputError, Rig, Solution
from blendcap.numerics.geodesic import sewn_vertices
from blendcap.numerics.surfaces import parts
from blendcap.view.posing import weights_on
from blendcap.view.style import BLUE, GREEN, GRID, INK, RED, SIX, new_figure, plain, styled, thinned

ACTIVE = 0.01  # a weight that varies by less does not move
MOST_SHAPES, MOST_MARKERS = 48, 60  # that a figure has room for
HELMET, LEFT_OVER = "The helmet against the head", "What is left of the head's motion after it was taken out"
SHIFTS = ("x, to the subject's left", "y, up", "z, forward")
TURNS = ("about x, nods down", "about y, looks left", "about z, tilts right")
ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1, 1), "borderpad": 0.2}  # a legend off the curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@styled
def plot_rms(solution: Solution) -> Figure:
    """Root mean square distance of markers and surface, mm, over time (figure 58 of the thesis)."""
    figure = new_figure(8, 2.6)
    axes = figure.subplots()
    times = solution.animation.times
    axes.fill_between(*thinned(times, solution.rms), color=BLUE, alpha=0.12, linewidth=0)
    axes.plot(*thinned(times, solution.rms), color=BLUE)
    mean = float(np.nanmean(solution.rms)) if np.isfinite(solution.rms).any() else 0.0
    axes.axhline(mean, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
    _over_time(axes, times, "mm", f"Distance of markers and surface, RMS: {mean:.2f} mm on average")
    axes.set_ylim(0)
    return figure


@styled
def plot_weight_sum(animation: Animation) -> Figure:
    """Sum of all weights over time: smooth if the animation is (figure 60, top)."""
    figure = new_figure(8, 2.2)
    axes = figure.subplots()
    axes.plot(*thinned(animation.times, np.nansum(animation.weights, axis=1)), color=GREEN)
    _over_time(axes, animation.times, "sum", "Sum of all weights")
    axes.set_ylim(0)
    return figure


@styled
def plot_shapes(animation: Animation) -> Figure:
    """The weight of each shape that moves over time, the most active first (figure 60, bottom)."""
    low, high = np.nan_to_num(animation.weights).min(0), np.nan_to_num(animation.weights).max(0)
    order = np.argsort(low - high, kind="stable")
    order = order[: max(min(MOST_SHAPES, int((high - low > ACTIVE).sum())), 1)]
    columns = min(4, len(order))
    rows = -(-len(order) // columns)
    figure = new_figure(8.4, 0.45 + 0.78 * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, shape in zip(grid.flat, order, strict=False):
        times, values = thinned(animation.times, animation.weights[:, shape], 300)
        axes.fill_between(times, values, color=BLUE, alpha=0.15, linewidth=0)
        axes.plot(times, values, color=BLUE, linewidth=0.9)
        axes.set_title(plain(animation.names[shape]), fontsize=7, pad=2)
        axes.tick_params(labelsize=6)
    for axes in grid.flat[len(order) :]:
        axes.set_visible(False)
    axes = grid[0, 0]
    axes.set_ylim(min(0.0, float(low.min())) - 0.03, max(1.0, float(high.max())) + 0.05)
    axes.set_yticks([0, 1])
    axes.set_xlim(*_span(animation.times))
    figure.supxlabel("seconds", fontsize=8)
    return figure


@styled
def plot_markers(rig: Rig, solution: Solution, frame: int | None = None) -> Figure:
    """Markers (red) and their places on the face (blue), front and side, in one frame (figure 59).

    Parameters
    ----------
    frame : int, optional
        The one with the largest error if not given.

    Raises
    ------
    InputError
        If the solution has no targets and fitted places, or no such frame.
    """
    if solution.targets is None or solution.fitted is None:
        raise InputError("The solution does not hold its markers (targets, fitted); solve it again to plot them.")
    count = len(solution.animation.weights)
    frame = int(np.nanargmax(np.nan_to_num(solution.rms))) if frame is None else frame
    if not 0 <= frame < count:
        raise InputError(f"There is no frame {frame} in the solution; it has {count} (0 to {count - 1}).")
    target, fitted = solution.targets[frame], solution.fitted[frame]
    face = rig.pose(weights_on(rig, solution.animation)[frame])[_skin(rig)]
    sides = (("front", np.array([1, 1, 0]), 0), ("side", np.array([1, 1, -1]), 2))  # from the side it looks to the left
    spans = [_around(fitted[:, axis], room) for axis, room in ((0, 0.0), (2, 45.0), (1, 0.0))]
    ratios = [high - low for low, high in spans]
    figure = new_figure(1 + 5 * sum(ratios[:2]) / ratios[2], 5.6)
    for axes, (title, sign, axis), span in zip(
        figure.subplots(1, 2, sharey=True, width_ratios=ratios[:2]), sides, spans, strict=False
    ):
        _compare(axes, face * sign, target * sign, fitted * sign, axis)
        axes.set_xlim(*(span if axis == 0 else (-span[1], -span[0])))
        axes.set_ylim(*spans[2])
        axes.set_aspect("equal")
        axes.set_title(title)
        axes.set_xlabel("mm")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), ncols=2, loc="outside lower right")
    figure.suptitle(
        f"Frame {frame}, {solution.animation.times[frame]:.2f} s: RMS {solution.rms[frame]:.2f} mm", x=0.01, ha="left"
    )
    return figure


@styled
def plot_helmet(solution: Solution) -> Figure:
    """Six curves of how all markers moved together beside what the face did (figures 61 and 62).

    That is the helmet's motion against the head, or, of a take whose head motion was removed, what is left of that.
    """
    if solution.helmet is None:
        raise InputError("The solution has no helmet motion; solve with a helmet to plot it.")
    stage = solution.animation.head is not None
    return _six(solution.animation.times, solution.helmet, LEFT_OVER if stage else HELMET)


@styled
def plot_head(animation: Animation) -> Figure:
    """Six curves of how the head moved."""
    from scipy.spatial.transform import Rotation

    if animation.head is None:
        raise InputError("The animation has no head motion to plot.")
    turn = Rotation.from_matrix(animation.head[:, :3, :3]).as_rotvec()
    shift = animation.head[:, :3, 3] - animation.head[0, :3, 3]
    return _six(animation.times, np.hstack([shift, turn]), "The head against its first frame")


@styled
def plot_marker_errors(solution: Solution) -> Figure:
    """Root mean square and 95th percentile of each marker's error, mm, the worst first."""
    rms, p95 = marker_errors(solution)
    order = np.argsort(-np.nan_to_num(rms), kind="stable")[:MOST_MARKERS]
    figure = new_figure(8, 2.8)
    axes = figure.subplots()
    place = np.arange(len(order))
    axes.bar(place, rms[order], color=BLUE, width=0.72, label="RMS")
    axes.plot(place, p95[order], "_", color=INK, markersize=6, label="95 % of frames are below")
    axes.set_xticks(place, [plain(solution.marker_names[m]) for m in order], rotation=90, fontsize=6.5)
    axes.set_xlim(-0.7, len(order) - 0.3)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel("mm")
    axes.set_title("Error of each marker")
    axes.legend(ncols=2, **ABOVE)
    return figure


@styled
def plot_convergence(binding: Binding) -> Figure:
    """Mean marker error after each pass of the binding over the range of motion, mm."""
    if not len(binding.errors):
        raise InputError("The binding has no history of errors: no range of motion was given.")
    figure = new_figure(4.6, 2.4)
    axes = figure.subplots()
    passes = np.arange(1, len(binding.errors) + 1)
    axes.plot(passes, binding.errors, "o-", color=BLUE, markersize=4)
    axes.set_xticks(passes)
    axes.set_xlabel("pass")
    axes.set_ylabel("mean error, mm")
    axes.set_title("Binding over the range of motion")
    axes.set_ylim(0, 1.15 * max(float(binding.errors.max()), 1e-6))
    return figure


def marker_errors(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square (M,) and 95th percentile (M,) of each marker's residual, mm; NaN where it was never seen."""
    rms = solution.marker_rms
    p95 = rms.copy()
    seen = np.isfinite(solution.residuals).any(0)
    p95[seen] = np.nanpercentile(solution.residuals[:, seen], 95, axis=0)
    return rms, p95


def _six(times: np.ndarray, motion: np.ndarray, title: str) -> Figure:
    figure = new_figure(8, 3.4)
    upper, lower = figure.subplots(2, 1, sharex=True)
    parts = ((upper, motion[:, :3], "shift, mm", SHIFTS), (lower, np.degrees(motion[:, 3:]), "turn, degrees", TURNS))
    for axes, columns, unit, names in parts:
        for column, name, color in zip(columns.T, names, SIX, strict=False):
            axes.plot(*thinned(times, column), color=color, label=name)
        axes.set_ylabel(unit)
        axes.legend(ncols=3, **ABOVE)
    upper.set_title(title)
    lower.set_xlabel("seconds")
    lower.set_xlim(*_span(times))
    return figure


def _over_time(axes: Axes, times: np.ndarray, label: str, title: str) -> None:
    axes.set_xlim(*_span(times))
    axes.set_xlabel("seconds")
    axes.set_ylabel(label)
    axes.set_title(title)


def _span(times: np.ndarray) -> tuple[float, float]:
    """The stretch of time to show; not empty for a single frame."""
    return float(times[0]), float(max(times[-1], times[0] + 1e-3))


def _skin(rig: Rig) -> np.ndarray:
    """The vertices of the largest piece of a rig: not its eyes and teeth."""
    sewn = sewn_vertices(rig.mesh.vertices, rig.deltas)
    piece = parts(sewn[rig.mesh.faces], len(sewn))[sewn]
    return np.flatnonzero(piece == np.bincount(piece).argmax())


def _compare(axes: Axes, face: np.ndarray, target: np.ndarray, fitted: np.ndarray, axis: int) -> None:
    """Red and blue crosses with lines between, before the dots of the face."""
    gap = np.full(len(target), np.nan)
    lines = [np.stack([target[:, d], fitted[:, d], gap], 1).ravel() for d in (axis, 1)]
    axes.plot(face[:, axis], face[:, 1], ",", color=GRID, rasterized=True, zorder=0)
    axes.plot(*lines, color=INK, linewidth=0.8)
    axes.plot(fitted[:, axis], fitted[:, 1], "x", color=BLUE, markersize=5, label="on the face")
    axes.plot(target[:, axis], target[:, 1], "x", color=RED, markersize=5, label="marker")


def _around(values: np.ndarray, behind: float) -> tuple[float, float]:
    """The stretch to show: the markers with some room, not the whole head; more room `behind`, mm."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = 0.16 * max(high - low, 40.0)
    return low - room - behind, high + room
