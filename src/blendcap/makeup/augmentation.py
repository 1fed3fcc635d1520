"""Training pictures of faces that nobody has: smooth random warps (section 9 of Reading Between the Dots, 2016)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from blendcap.makeup.patches import Patches, flows, laid_over
from blendcap.makeup.units import Region

SMOOTH = 10.0  # pixels over which a warp changes
SIZE = 1.2  # root mean square of a warp beside its mean, pixels: another face, laid over the first
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


def painted_anew(patches: Patches, region: Region, seed: int, size: float) -> Patches:
    """A warped copy as another take of the region is seen: laid over the patches, where the region wants that."""
    copy = warped(patches, region, seed, size)
    if not region.aligned:
        return copy
    return laid_over(copy, flows(copy.neutral, {name: patches.neutral[name] for name in region.patches}))


def thinned(takes: Sequence[Patches], most: int) -> tuple[list[Patches], np.ndarray]:
    """Every so many frames of takes, `most` about, and which (T,) of all frames they are."""
    counts = [len(patches.sure) for patches in takes]
    every = max(1, round(sum(counts) / most))
    parts = [
        replace(p, images={name: frames[::every] for name, frames in p.images.items()}, sure=p.sure[::every])
        for p in takes
    ]
    starts = np.cumsum([0, *counts[:-1]])
    return parts, np.concatenate([start + np.arange(n)[::every] for start, n in zip(starts, counts, strict=True)])
