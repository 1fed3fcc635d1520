"""Weights as shares of a full shape, so that what is believed of weights holds whatever unit a rig counts them in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blendcap.data import Rig


def full_weights(rig: Rig) -> np.ndarray:
    """(N,) the weight that is all of a shape: its upper bound, or the lower where it only goes below 0."""
    lower, upper = rig.bounds.T
    full = np.where(upper > 0, upper, lower)
    return np.where(full == 0, 1.0, full)


def in_shares(rig: Rig) -> Rig:
    """The same rig with weights of 1 where its own are full: sliders to 100, 0.5 or -1 are like all others."""
    full = full_weights(rig)
    if (full == 1).all():
        return rig
    return replace(rig, deltas=full[:, None, None] * rig.deltas, bounds=np.sort(rig.bounds / full[:, None]))
