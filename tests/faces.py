"""Words that the tests of the mannequin share: people, weights by name, gaps, and folds."""

from functools import cache

import numpy as np

from blendcap import Rig, mannequin
from blendcap.synthetic.mannequin.shared import shared


@cache
def person(identity: int | str = 0) -> Rig:
    return mannequin(identity)


def weights(rig: Rig, **values: float) -> np.ndarray:
    """Weights by name; one that needs a side means both."""
    result = np.zeros(len(rig.names))
    for name, value in values.items():
        for full in (name,) if name in rig.names else (f"{name}Left", f"{name}Right"):
            result[rig.index(full)] = value
    return result


def alone(rig: Rig, name: str) -> np.ndarray:
    """The weights that show one shape: itself, and what drives it."""
    return weights(rig, **dict.fromkeys((name, *rig.combinations.get(name, ())), 1.0))


def gap(rig: Rig, vertices: np.ndarray, contact: str) -> float:
    """The widest gap of a contact, mm."""
    pairs = rig.contacts[contact]
    return float(np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1).max())


def reflected(vectors: np.ndarray) -> np.ndarray:
    return vectors * [-1, 1, 1]


def skin_normals(vertices: np.ndarray) -> np.ndarray:
    """Normals (Q, 3) of the skin's quads, of the length of twice their area."""
    quads = shared().surface.quads
    a, b, c, d = (vertices[quads[:, k]] for k in range(4))
    return np.cross(c - a, d - b)
