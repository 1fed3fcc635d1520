"""A solve as one self-contained page: can it be trusted, where is it wrong, what was asked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from blendcap.data import Animation, Binding, Rig, Solution
from blendcap.io.atomic import write_whole
from blendcap.view import page, plots
from blendcap.view.comparison import comparison
from blendcap.view.concerns import concerns, sight
from blendcap.view.heatmap import heatmap, marker_heat
from blendcap.view.posing import weights_on
from blendcap.view.still import still
from blendcap.view.style import inline_svg

LARGEST_FILM = 8_000_000  # bytes; a larger one stays beside the page
FILMS = {".mp4": "video/mp4", ".gif": "image/gif"}
PICTURE = (1200, 640)
TOGETHER = (
    "How all markers moved together, found with the face and no part of its weights: the slip of a helmet, or what the "
    "stable markers did not tell of the head."
)


def write_report(
    path: str | Path,
    rig: Rig,
    solution: Solution,
    *,
    binding: Binding | None = None,
    alone: Solution | None = None,
    patches: Animation | None = None,
    video: str | Path | None = None,
    next_steps: Sequence[str] = (),
) -> None:
    """Write a solve as one HTML page that asks nothing from outside.

    Parameters
    ----------
    path : path
        `.html`.
    binding : Binding, optional
        For its history and the heat map of the error.
    alone : Solution, optional
        Of the same take without the paint, to be shown beside this one.
    patches : Animation, optional
        The curves of the patches, to be drawn between the two.
    video : path, optional
        A preview (.mp4, .gif) to put into the page, if it has less than 8 MB.
    next_steps : sequence of str
        What the reader should open next.
    """
    animation = solution.animation
    seconds = animation.times[-1] - animation.times[0] + 1 / animation.rate
    lead = (
        f"{len(animation.weights)} frames at {animation.rate:g} a second ({seconds:.1f} s), "
        f"{len(solution.marker_names)} markers, {len(animation.names)} shapes"
    )
    sections = [
        ("Summary", _summary(solution)),
        ("Look twice", page.sentences(concerns(rig, solution, binding), "concerns")),
        ("Preview", _film(video)),
        ("What the paint changed", "" if alone is None else comparison(rig, alone, solution, patches)),
        ("Where the error sits", _pictures(rig, solution, binding)),
        ("Over time", _curves(solution, binding)),
        ("Shapes", page.figure(inline_svg(plots.plot_shapes(animation))) + _shapes_table(solution, alone)),
        ("Markers", page.figure(inline_svg(plots.plot_marker_errors(solution))) + _markers_table(solution)),
        ("What was asked, and what it took", _settings(solution)),
        ("What to open next", page.sentences(next_steps)),
    ]
    html = page.page(f"Solve on {rig.name}", lead, sections)
    with write_whole(path) as temporary:
        temporary.write_text(html, encoding="utf-8")


def _summary(solution: Solution) -> str:
    proof = solution.certificate
    residuals = solution.residuals[np.isfinite(solution.residuals)]
    per_marker, _ = plots.marker_errors(solution)
    known = np.isfinite(per_marker)
    worst = solution.marker_names[int(np.nanargmax(per_marker))] if known.any() else "none"
    return page.cards(
        [
            ("marker RMS over all frames", _mm(solution.rms_mm), ""),
            (
                "95 % of the markers are closer than",
                _mm(np.percentile(residuals, 95) if len(residuals) else np.nan),
                "",
            ),
            (f"worst marker: {worst}", _mm(per_marker[known].max() if known.any() else np.nan), ""),
            ("of the markers were missing", f"{np.isnan(solution.residuals).mean():.1%}", ""),
            (
                "from the exact optimum, at most: " + ("proved for every frame" if proof.converged else "not reached"),
                f"{proof.max_kkt:.1e}",
                "good" if proof.converged else "bad",
            ),
            *_tracks_card(solution),
            ("to solve", f"{sum(solution.seconds.values()):.2f} s", ""),
        ]
    )


def _tracks_card(solution: Solution) -> list[tuple[str, str, str]]:
    """How well the tracks are met, if there are any."""
    return [] if solution.track_rms is None else [("RMS of the tracks, a coordinate", _mm(solution.track_rms_mm), "")]


def _film(video: str | Path | None) -> str:
    if video is None:
        return ""
    path = Path(video)
    kind = FILMS.get(path.suffix.lower())
    if kind is None or not path.is_file() or path.stat().st_size > LARGEST_FILM:
        return page.sentences([f"The film lies beside this page: {path.name}."])
    return page.figure(page.film(path.read_bytes(), kind), path.name)


def _pictures(rig: Rig, solution: Solution, binding: Binding | None) -> str:
    html = ""
    if binding is not None:
        rms, _ = plots.marker_errors(solution)
        points = binding.points.select(solution.marker_names)
        picture = heatmap(rig, *marker_heat(rig, points, rms), size=PICTURE)
        html += page.figure(page.image(picture, "heat map"), "RMS of the markers, spread along the surface.")
    if solution.targets is not None and solution.fitted is not None and np.isfinite(solution.rms).any():
        frame = int(np.nanargmax(solution.rms))
        weights = weights_on(rig, solution.animation)[frame]
        picture = still(rig, weights, size=PICTURE, targets=solution.targets[frame], fitted=solution.fitted[frame])
        caption = f"The frame with the largest error, {frame}: markers red, their places on the face blue."
        html += page.figure(page.image(picture, "worst frame"), caption)
        html += page.figure(inline_svg(plots.plot_markers(rig, solution, frame)))
    return html


def _curves(solution: Solution, binding: Binding | None) -> str:
    figures = [(plots.plot_rms(solution), ""), (plots.plot_weight_sum(solution.animation), "")]
    if solution.helmet is not None:
        figures.append((plots.plot_helmet(solution), TOGETHER))
    if solution.animation.head is not None:
        figures.append((plots.plot_head(solution.animation), "Removed before the solve; .glb and .npz keep it."))
    if binding is not None and len(binding.errors):
        figures.append((plots.plot_convergence(binding), ""))
    return "".join(page.figure(inline_svg(figure), words) for figure, words in figures)


def _shapes_table(solution: Solution, alone: Solution | None) -> str:
    weights = np.nan_to_num(solution.animation.weights)
    rows = []
    for n in np.argsort(-weights.max(0), kind="stable"):
        name, curve = solution.animation.names[n], weights[:, n]
        rows.append(
            [
                name,
                f"{curve.max():.2f}",
                f"{curve.mean():.3f}",
                f"{(curve > 0.02).mean():.0%}",
                _seen(solution, alone, name),
            ]
        )
    return _folded("All shapes", page.table(["shape", "largest", "mean", "frames on", "by the markers"], rows))


def _seen(solution: Solution, alone: Solution | None, name: str) -> str:
    if name not in solution.unseen:
        return "seen" if alone is None or name not in alone.unseen else "unseen, told by the paint"
    return f"{'held, ' if name in solution.held else ''}unseen ({sight(solution.unseen[name])})"


def _markers_table(solution: Solution) -> str:
    rms, p95 = plots.marker_errors(solution)
    missing = np.isnan(solution.residuals).mean(0)
    largest = np.nan_to_num(solution.residuals, nan=-np.inf).max(0)
    rows = [
        [
            name := solution.marker_names[m],
            _mm(rms[m]),
            _mm(p95[m]),
            _mm(largest[m]),
            f"{missing[m]:.1%}",
            f"{solution.trusted.get(name, 1.0):.0%}",
        ]
        for m in np.argsort(-np.nan_to_num(rms), kind="stable")
    ]
    return _folded("All markers", page.table(["marker", "RMS", "95 %", "largest", "missing", "trusted"], rows))


def _settings(solution: Solution) -> str:
    rows = [[str(key), str(value)] for key, value in solution.settings.items()]
    rows += [[f"{step}, time", f"{seconds:.3f} s"] for step, seconds in solution.seconds.items()]
    rows += [[f"{term}, mean cost", f"{np.nanmean(cost):.4g} mm²"] for term, cost in solution.energies.items()]
    return page.table(["setting", "value"], rows) if rows else ""


def _folded(name: str, html: str) -> str:
    return f"<details><summary>{name}</summary>{html}</details>"


def _mm(value) -> str:
    return f"{value:.2f} mm" if np.isfinite(value) else "–"
