"""What all mannequins share, computed once: the subdivided surface, its regions and contacts, the atlas."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from blendcap.synthetic.mannequin.atlas import Atlas, make_atlas
from blendcap.synthetic.mannequin.cage import Cage, head_cage, ring
from blendcap.synthetic.mannequin.ear import sculpted_ears
from blendcap.synthetic.mannequin.identity import make_person
from blendcap.synthetic.mannequin.parts import Part, make_parts
from blendcap.synthetic.mannequin.regions import skin_regions
from blendcap.synthetic.mannequin.subdivision import Surface, subdivide

_CONTACTS = ("lips", "lids_left", "lids_right")


class Shared(NamedTuple):
    """The head before it is anybody."""

    cage: Cage
    surface: Surface
    regions: Mapping[str, np.ndarray]  # of the skin
    contacts: Mapping[str, np.ndarray]
    auricles: np.ndarray  # what the sculpted ears add to the surface, (V, 3), mm
    rest: np.ndarray  # the skin of the plain person, (V, 3), mm
    parts: list[Part]  # of the plain person
    atlas: Atlas


@lru_cache(maxsize=1)
def shared() -> Shared:
    """The head before it is anybody."""
    cage = head_cage()
    lips = [_both(cage, ring("seam", range(5))), _both(cage, ring("seam", range(8, 3, -1)))]
    lids = [cage.index(ring("margin", range(7))), cage.index(ring("margin", (0, 11, 10, 9, 8, 7, 6)))]
    chains = [*lips, *lids, *(cage.twin[chain] for chain in lids)]
    surface = subdivide(cage.size, cage.quads, cage.sharpness, cage.corners, cage.twins, chains)
    pairs = [np.stack(surface.chains[k : k + 2], 1) for k in (0, 2, 4)]
    contacts = {name: pair[pair[:, 0] != pair[:, 1]] for name, pair in zip(_CONTACTS, pairs, strict=True)}
    auricles = sculpted_ears(cage, surface)
    rest = surface.evened(surface.through(cage.mirrored(cage.half)) + auricles)
    parts = make_parts(make_person(cage, {}))
    atlas = make_atlas(cage, surface, rest, parts)
    return Shared(cage, surface, skin_regions(cage, surface), contacts, auricles, rest, parts, atlas)


def _both(cage: Cage, names: list[str]) -> np.ndarray:
    """A chain from the right corner over the midline to the left corner."""
    left = cage.index(names)
    return np.concatenate([cage.twin[left[:0:-1]], left])
