"""Plausible people from a seed: measures that go together in people are drawn together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from blendcap.synthetic.mannequin.asymmetry import ASYMMETRIES
from blendcap.synthetic.mannequin.measures import MEASURES

# What measures have in common: the correlation of each with a trait. The rest of its variance is its own.
TRAITS: Mapping[str, Mapping[str, float]] = {
    "size": {"head_width": 0.5, "head_length": 0.5, "forehead_height": 0.4, "bizygomatic_width": 0.5,
             "midface_height": 0.4, "lower_face_height": 0.4, "nose_length": 0.4, "mouth_width": 0.4,
             "nasal_width": 0.3, "intercanthal_width": 0.4, "bigonial_width": 0.4},
    "ruggedness": {"brow_ridge": 0.6, "bigonial_width": 0.45, "chin_width": 0.45, "chin_projection": 0.4,
                   "neck_width": 0.5, "lower_face_height": 0.35, "nose_protrusion": 0.35, "dorsal_hump": 0.35,
                   "brow_height": -0.5, "eye_height": -0.4, "upper_lip_height": -0.3, "lower_lip_height": -0.25,
                   "cheekbone": 0.2},
    "fullness": {"cheek_fullness": 0.7, "neck_width": 0.45, "bigonial_width": 0.35, "bizygomatic_width": 0.3,
                 "cheekbone": -0.3, "jaw_drop_angle": 0.3},
    "breadth of nose and lips": {"nasal_width": 0.5, "nasal_bridge_height": -0.5, "nose_protrusion": -0.4,
                                 "upper_lip_height": 0.55, "lower_lip_height": 0.6, "maxilla": 0.5,
                                 "mouth_width": 0.35, "dorsal_hump": -0.35, "eye_depth": -0.2},
}  # fmt: skip


def drawn(seed: int) -> dict[str, float]:
    """Measures and asymmetries of somebody, each within two standard deviations; one seed is one person."""
    rng = np.random.default_rng(seed)
    traits = dict(zip(TRAITS, rng.normal(size=len(TRAITS)), strict=True))
    result = {}
    for name, measure in {**MEASURES, **ASYMMETRIES}.items():
        shares = {trait: loadings.get(name, 0.0) for trait, loadings in TRAITS.items()}
        own = np.sqrt(1 - sum(share**2 for share in shares.values()))
        draw = own * rng.normal() + sum(share * traits[trait] for trait, share in shares.items())
        result[name] = float(measure.deviation * np.clip(draw, -2, 2))
    return result
