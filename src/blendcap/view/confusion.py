"""Which action unit a classifier of patches takes for which, in showings that were left out of its training."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from blendcap.makeup.classifier import PatchClassifier, RegionModel
from blendcap.view.style import BLUE, INK, PAPER, new_figure, plain, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DARK = 0.55  # share from which on a cell is so dark that its figure is pale
CELL = 0.42  # inches


@styled
def plot_confusion(classifier: PatchClassifier) -> Figure:
    """For each region: of the frames that show a unit (row), how many were told as which (column)."""
    models = [model for model in classifier.models if len(model.answers)]
    sizes = [len(model.answers) for model in models]
    columns = min(2, len(models))
    rows = -(-len(models) // columns)
    figure = new_figure(max(columns * (CELL * max(sizes) + 1.3), 4.0), rows * (CELL * max(sizes) + 1.5) + 0.5)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, model in zip(grid.flat, models, strict=False):
        _matrix(axes, model)
    for axes in grid.flat[len(models) :]:
        axes.set_visible(False)
    figure.supxlabel("told as", fontsize=8)
    figure.supylabel("shown", fontsize=8)
    return figure


def _matrix(axes: Axes, model: RegionModel) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    counts = model.confusion
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    axes.imshow(share, cmap=LinearSegmentedColormap.from_list("told", [PAPER, BLUE]), vmin=0, vmax=1, aspect="equal")
    for (row, column), count in np.ndenumerate(counts):
        if count:
            color = PAPER if share[row, column] > DARK else INK
            axes.text(column, row, f"{count:,}", ha="center", va="center", fontsize=7, color=color)
    names = [plain(name) for name in model.answers]
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.grid(False)
    axes.spines[:].set_visible(False)
    axes.set_title(
        f"{plain(model.region.name)}: {model.scores['unit']:.1%} of {counts.sum():,} clear frames", fontsize=8
    )
