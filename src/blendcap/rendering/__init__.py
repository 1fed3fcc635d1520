"""One picture maker for previews, overlays and synthetic cameras: a z-buffer rasteriser and its shading."""
