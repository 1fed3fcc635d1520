"""Words that the tests of the mannequin share: people, weights by name, gaps, and folds."""

from functools import cache

import igl
import numpy as np

from blendcap import Rig, mannequin
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS
from blendcap.synthetic.mannequin.parts import ROWS
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


def solids(rig: Rig, vertices: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Both rows of teeth as closed surfaces: vertices (K, 3), mm, and triangles (F, 3) that look outwards."""
    start, found = len(shared().rest), []
    for part in shared().parts:
        own = vertices[start : start + len(part.vertices)]
        start += len(part.vertices)
        if not part.kind.endswith("teeth"):
            continue
        row = np.arange(len(own)).reshape(ROWS, -1)
        a, b = row, np.roll(row, -1, axis=0)
        quads = np.stack([a[:, :-1], b[:, :-1], b[:, 1:], a[:, 1:]], -1).reshape(-1, 4)
        caps = [[[ring[0], ring[k], ring[k + 1]] for k in range(1, ROWS - 1)] for ring in (row[:, 0], row[::-1, -1])]
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], np.concatenate(caps)])
        x, y, z = (own[faces[:, k]] for k in range(3))
        outwards = np.einsum("ij,ij->", x, np.cross(y, z)) > 0
        found.append((np.ascontiguousarray(own), np.ascontiguousarray(faces if outwards else faces[:, ::-1])))
    return found


def depth_in_teeth(rig: Rig, vertices: np.ndarray) -> float:
    """How deep the deepest vertex of the skin lies in a tooth, mm; negative if all keep off."""
    skin = np.unique(np.concatenate([rig.regions[name] for name in ("lips", "mouth", "cheeks", "jaw", "nose")]))
    skin = np.ascontiguousarray(vertices[skin])
    winding = igl.SIGNED_DISTANCE_TYPE_WINDING_NUMBER
    found = [igl.signed_distance(skin, own, faces, sign_type=winding)[0] for own, faces in solids(rig, vertices)]
    return -float(np.min(found))


def depth_in_eyes(rig: Rig, vertices: np.ndarray) -> float:
    """How deep the deepest vertex of lids and sockets lies in its eyeball, mm; negative if all keep off."""
    eyes = rig.mesh.vertices[rig.regions["eyes"]]
    skin = np.concatenate([rig.regions["lids"], rig.regions["sockets"]])
    skin = vertices[skin[skin < len(shared().rest)]]
    depths = []
    for side in (1, -1):
        globe = eyes[eyes[:, 0] * side > 0]
        middle = (globe.max(0) + globe.min(0)) / 2
        center = np.array([middle[0], middle[1], globe[:, 2].min() + GLOBE_RADIUS])
        own = skin[skin[:, 0] * side > 0]
        depths.append(GLOBE_RADIUS - np.linalg.norm(own - center, axis=1).min())
    return float(max(depths))
