"""Training pictures of faces that nobody has: smooth random warps (section 9 of Reading Between the Dots, 2016)."""

from __future__ import annotations

import numpy as np

from blendcap.makeup.patches import Patches, laid_over
from blendcap.makeup.units import Region

SMOOTH = 10.0  # pixels over which a warp changes
SIZE = 1.2  # standard deviation of a warp, pixels: another face, laid over the first
ELSEWHERE = (1.0, 2.0, 3.0)  # the same of other hands: strokes that were painted anew, more or less alike


def warped(patches: Patches, region: Region, seed: int, size: float = SIZE) -> Patches:
    """The patches of a region under one smooth random warp, as another face would have them."""
    import cv2

    rng = np.random.default_rng(seed)
    tables = {}
    for name in region.patches:
        height, width = patches.neutral[name].shape
        shift = [cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), SMOOTH) for _ in range(2)]
        shift = [size * field / field.std() for field in shift]
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        tables[name] = ((x + shift[0]).astype(np.float32), (y + shift[1]).astype(np.float32))
    return laid_over(patches, tables)
