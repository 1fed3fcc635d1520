"""For people to look at: preview, plots, heat map, report."""
