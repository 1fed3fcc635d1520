"""One look for all plots, and how a figure becomes a file or a part of a page."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from blendcap.data import InputError
from blendcap.io.atomic import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, GRID, PAPER = "#2b2f37", "#d4d8de", "#fdfdfe"
BLUE, RED, GREEN = "#2f6fb7", "#cf3f3c", "#3f9a5a"
SIX = ("#cf3f3c", "#3f9a5a", "#2f6fb7", "#e58a6a", "#8fc27a", "#7fb2df")  # x y z and again: strong, then light

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.titlepad": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.edgecolor": GRID,
    "axes.facecolor": "none",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "figure.facecolor": PAPER,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "svg.fonttype": "none",
    "svg.hashsalt": "blendcap",
}


def styled(plot: Callable[..., Figure]) -> Callable[..., Figure]:
    """A function that makes a figure, in our style; no global state is touched."""

    @wraps(plot)
    def in_style(*args, **kwargs):
        import matplotlib

        with matplotlib.rc_context(STYLE):
            return plot(*args, **kwargs)

    return in_style


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches; drawn without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plain(name: str) -> str:
    """A name for a plot: Matplotlib would read two dollars as mathematics."""
    return name.replace("$", r"\$")


def thinned(times: np.ndarray, values: np.ndarray, points: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """A curve with at most about `points` points that keeps its peaks: the lowest and highest of each stretch."""
    stretches = points // 2
    if len(values) <= points:
        return times, values
    edges = np.linspace(0, len(values), stretches + 1).astype(int)
    kept = []
    for start, stop in pairwise(edges):
        part = values[start:stop]
        if np.isnan(part).all():
            kept += [start]
        else:
            kept += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
    return times[kept], values[kept]


def write_plot(path: str | Path, figure: Figure) -> None:
    """Write a figure as .png, .svg or .pdf."""
    import matplotlib

    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (".png", ".svg", ".pdf"):
        raise InputError(f"Cannot write {path} as a plot; end its name with .png, .svg or .pdf.")
    dates = {"CreationDate": None} if ending == ".pdf" else {"Date": None} if ending == ".svg" else {}
    with write_whole(path) as temporary, matplotlib.rc_context(STYLE):
        figure.savefig(temporary, dpi=144, metadata=dates)


def inline_svg(figure: Figure) -> str:
    """A figure as SVG to stand inside a page: its ink, lines and paper follow the page's CSS variables."""
    import matplotlib

    buffer = io.StringIO()
    with matplotlib.rc_context(STYLE):
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(buffer, format="svg", dpi=110, transparent=True, metadata=nothing)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r' xmlns(:xlink)?="[^"]*"', "", svg, count=2)
    for color, variable in ((INK, "ink"), (GRID, "line"), (PAPER, "paper")):
        svg = svg.replace(color, f"var(--{variable})")
    svg = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), svg)  # half the page was digits
    shown = f'<svg role="img" style="max-width:{100 * figure.get_figwidth():.0f}pt"'  # a small plot stays small
    return re.sub(r'<svg width="[^"]*" height="[^"]*"', shown, svg, count=1)
