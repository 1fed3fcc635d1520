"""For people to look at: stills, previews, contact sheets, plots, heat maps and the report.

The names load when first used: the command line asks for them only when it draws.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

_HOMES = {
    "Film": "film",
    "marker_heat": "heatmap",
    "vertex_error": "heatmap",
    "write_beside_film": "beside_film",
    "write_comparison": "comparison",
    "write_contact_sheet": "sheet",
    "write_heatmap": "heatmap",
    "write_landmarks": "landmarks",
    "write_plot": "style",
    "write_preview": "preview",
    "write_report": "report",
    "write_still": "still",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from blendcap.view.beside_film import write_beside_film as write_beside_film
    from blendcap.view.comparison import write_comparison as write_comparison
    from blendcap.view.film import Film as Film
    from blendcap.view.heatmap import marker_heat as marker_heat
    from blendcap.view.heatmap import vertex_error as vertex_error
    from blendcap.view.heatmap import write_heatmap as write_heatmap
    from blendcap.view.landmarks import write_landmarks as write_landmarks
    from blendcap.view.preview import write_preview as write_preview
    from blendcap.view.report import write_report as write_report
    from blendcap.view.sheet import write_contact_sheet as write_contact_sheet
    from blendcap.view.still import write_still as write_still
    from blendcap.view.style import write_plot as write_plot


def __getattr__(name: str):
    if name not in _HOMES:
        raise AttributeError(f"module 'blendcap.view' has no attribute {name!r}")
    return getattr(importlib.import_module(f"blendcap.view.{_HOMES[name]}"), name)
