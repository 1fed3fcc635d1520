"""Shapes that belong to other shapes: correctives, which follow their drivers, and shapes that need another."""

from __future__ import annotations

import numpy as np

from blendcap.data.facs import NEEDS
from blendcap.data.names import canonical
from blendcap.data.rig import Rig


def driven(rig: Rig, weights: np.ndarray) -> np.ndarray:
    """Weights (..., N) in which every corrective of the rig has the product of its drivers' weights.

    A corrective is a shape of `rig.combinations` with two drivers or more; a shape with one (mouthClose, which makes
    sense with jawOpen only) is the animator's own and stays as it is. The rig itself stays linear.
    """
    result = np.array(weights, dtype=np.float64)
    for corrective, drivers in rig.combinations.items():
        if len(drivers) > 1:
            result[..., rig.index(corrective)] = np.prod([result[..., rig.index(name)] for name in drivers], axis=0)
    return result


def needs(rig: Rig, name: str) -> tuple[str, ...]:
    """The shapes without which a shape makes no sense, from the rig or, if it says nothing, from ARKit's rule."""
    if name in rig.combinations:
        return tuple(rig.combinations[name])
    wanted = NEEDS.get(canonical(name), ())
    return tuple(n for n in rig.names if canonical(n) in wanted)
