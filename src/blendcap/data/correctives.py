"""Weights of correctives from the shapes that drive them."""

from __future__ import annotations

import numpy as np

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
