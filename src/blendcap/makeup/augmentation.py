"""Training pictures of faces that nobody has: smooth random warps (section 9 of Reading Between the Dots, 2016)."""

from __future__ import annotations

import numpy as np

from blendcap.makeup.patches import Patches
from blendcap.makeup.units import Region

SMOOTH = 10.0  # pixels over which a warp changes
SIZE = 1.2  # standard deviation of a warp, pixels


def warped(patches: Patches, region: Region, seed: int) -> Patches:
    """The patches of a region under one smooth random warp, as another face would have them."""
    import cv2

    rng = np.random.default_rng(seed)
    images = {}
    for name in region.patches:
        frames = patches.images[name]
        height, width = frames.shape[1:]
        shift = [cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), SMOOTH) for _ in range(2)]
        shift = [SIZE * field / field.std() for field in shift]
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        table = ((x + shift[0]).astype(np.float32), (y + shift[1]).astype(np.float32))
        images[name] = np.stack([cv2.remap(frame, *table, cv2.INTER_LINEAR) for frame in frames])
    return Patches(images, patches.rate, patches.sure)
