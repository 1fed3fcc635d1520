"""What the vertices of any rig are a part of, told by words in the names of its regions: other hands name alike."""

from __future__ import annotations

import numpy as np

from blendcap.data.rig import Rig

INSIDE = ("socket", "mouthbag", "tongue", "gum", "teeth", "tooth", "eyeball", "globe")
INSIDE_WHOLE = ("eye", "eyes", "mouth")  # these only as whole names: a region "around the mouth" is skin
CLEAR = (
    "lash",
    "occlusion",
    "lacrimal",
    "eyeblend",
)  # layers before the eye: only a renderer with transparency has a use


def is_skin(region: str) -> bool:
    """Whether a region's name is none of eyes, teeth, gums, tongue, sockets, lashes and clear layers over the eye."""
    word = _word(region)
    return word not in INSIDE_WHOLE and not any(part in word for part in INSIDE + CLEAR)


def inside_vertices(rig: Rig) -> np.ndarray:
    """(V,) bool: in a region that is not skin."""
    return _in_regions(rig, [name for name in rig.regions if not is_skin(name)])


def clear_vertices(rig: Rig) -> np.ndarray:
    """(V,) bool: lashes and the clear layers over the eyes."""
    return _in_regions(rig, [name for name in rig.regions if any(part in _word(name) for part in CLEAR)])


def _word(region: str) -> str:
    return region.lower().replace("_", "").replace(" ", "")


def _in_regions(rig: Rig, names: list[str]) -> np.ndarray:
    inside = np.zeros(len(rig.mesh.vertices), dtype=bool)
    for name in names:
        inside[rig.regions[name]] = True
    return inside
