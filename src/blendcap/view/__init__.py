"""For people to look at: stills, previews, contact sheets, plots, heat maps and the report."""
