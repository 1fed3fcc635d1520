"""What the skin cannot go through: lips slide over the teeth, lids over the eyeball, skin over bone and into itself."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from blendcap.numerics.closest import Closest
from blendcap.synthetic.mannequin.cage import ring
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS

# How far the control points of each ring of the mouth keep off the front of the teeth, mm.
OFF_TEETH = {"bag": 1.7, "lining": 2.5, "inner": 3.3, "seam": 3.9, "crest": 4.7, "border": 5.7}

OFF_GLOBE = {"edge": 1.3, "crease": 2.2, "sulcus": 3.0}  # and of the rings of the eye, off the eyeball, mm

# Skin that is pressed together to a third of its length pushes on what lies behind it: from the lips out and in, and
# from the chin down.
LEAST = 0.5
_ROWS = (("border", "around", "fold"), ("seam", "inner", "lining", "bag"))
_BEHIND = (("M88", "neck1.0"), ("M87", "neck1.1"))

# How much the skin is bound to slide along the bone below it.
_BONY = {
    "a0": 1, "H2": 1, "H3": 1, "H4": 1, "P5": 1, "P6": 1, "b0": 1, "b2": 1, "b3": 1, "b4": 1, "c0": 1, "c2": 1, "c3": 1,
    "N0": 1, "G1": 1, "N1": 1, "C1": 1, "B1": 0.7, "N2": 0.7, "orbit.1": 1, "orbit.2": 1, "orbit.3": 1, "orbit.4": 1,
    "orbit.5": 1, "orbit.6": 1, "orbit.7": 1, "orbit.8": 0.8, "orbit.9": 0.7, "P7": 1, "P8": 0.9, "P9": 0.6, "Q5": 1,
    "Q6": 1, "Q7": 1, "Q8": 0.4, "Q9": 0.3, "R8": 0.5, "R9": 0.4, "S8": 0.8, "S9": 0.8, "S10": 0.6, "M67": 0.8,
    "M68": 0.8, "M77": 0.8, "M78": 0.8, "neck1": 0.5, "neck2": 0.5,
}  # fmt: skip


def over_teeth(face: Face, moved: np.ndarray, arch: np.ndarray) -> np.ndarray:
    """A displacement (H, 3) of the left half that ends outside the dental arch.

    Parameters
    ----------
    face : Face
    moved : (H, 3) float64
    arch : (A, 3) float64
        The front of the upper teeth from the midline to the last molar, mm.
    """
    margin, middle = face.weights(OFF_TEETH), face.points[:, 0] <= 1e-9
    at, kept = np.flatnonzero(margin), moved.copy()
    resting = _above_arch(face.points[at][:, [0, 2]], arch[:, [0, 2]], margin[at])
    above, below = face.pairs("seam", range(4))
    closed = np.abs(moved[above] - moved[below]).max(1) < 1e-9
    margin[at] -= np.linalg.norm(resting, axis=1)  # who rests closer to the teeth may come as close
    for share in (1.0, 0.5):  # the arch is convex, so between two places outside it the way may lead through it
        lifted = np.zeros((len(kept), 2))
        lifted[at] = _above_arch((face.points + share * kept)[at][:, [0, 2]], arch[:, [0, 2]], margin[at])
        kept[:, [0, 2]] += _pushed_along(face, lifted, closed) / share
        kept[middle, 0] = moved[middle, 0]
    return kept


def _pushed_along(face: Face, lifted: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Lifts (H, 2) with what lies before a lifted point: a lip keeps its thickness, and closed (4,) lips stay so."""
    above, below = face.pairs("inner", range(4))
    for one, other in ((above, below), (below, above)):
        less = closed & (np.linalg.norm(lifted[one], axis=1) < np.linalg.norm(lifted[other], axis=1))
        lifted[one[less]] = lifted[other[less]]
    for behind, before, share in (("inner", "seam", 1), ("seam", "crest", 1), ("crest", "border", 0.9),
                                  ("border", "around", 0.6)):  # fmt: skip
        back, front = (face.cage.index(ring(name, 9)) for name in (behind, before))
        less = np.linalg.norm(lifted[front], axis=1) < share * np.linalg.norm(lifted[back], axis=1)
        lifted[front[less]] = share * lifted[back[less]]
    return lifted


def pushed_on(face: Face, moved: np.ndarray, before: np.ndarray | float = 0.0) -> np.ndarray:
    """A displacement (H, 3) of the left half that presses the skin round the mouth together, but never folds it.

    Parameters
    ----------
    face : Face
    moved : (H, 3) float64
    before : (H, 3) float64, optional
        What other shapes have done already: the drivers of a corrective.
    """
    rows = [[face.cage.index(ring(name, 9)) for name in names] for names in _ROWS]
    rows += [[face.cage.index([name]) for name in names] for names in _BEHIND]
    kept = moved.copy()
    for row in rows:
        for near, far in pairwise(row):
            rest = face.points[far] - face.points[near]
            now = rest + (before + kept)[far] - (before + kept)[near]
            left = (now * rest).sum(1) / (rest**2).sum(1)
            kept[far] += np.maximum(LEAST - left, 0)[:, None] * rest
    return kept


def over_globe(face: Face, moved: np.ndarray) -> np.ndarray:
    """A displacement (H, 3) of the left half that ends, and is half-way, outside the eyeball."""
    margin = face.weights(OFF_GLOBE)
    at, kept, globe = np.flatnonzero(margin), moved.copy(), face.person.globe
    margin[at] = np.minimum(margin[at], np.linalg.norm(face.points[at] - globe, axis=1) - GLOBE_RADIUS)
    for share in (1.0, 0.5):
        out = (face.points + share * kept)[at] - globe
        height = np.linalg.norm(out, axis=1, keepdims=True)
        lifted = np.maximum(GLOBE_RADIUS + margin[at, None] - height, 0) * out / height
        kept[at] += lifted / share
    return kept


def _above_arch(ends: np.ndarray, line: np.ndarray, margin: np.ndarray) -> np.ndarray:
    """What lifts points (P, 2) to a height (P,) above a polyline (A, 2) that runs to the left and back."""
    along = np.diff(line, axis=0)
    share = ((ends[:, None] - line[:-1]) * along).sum(2) / (along**2).sum(1)
    away = ends[:, None] - line[:-1] - np.clip(share, 0, 1)[..., None] * along
    index = (away**2).sum(2).argmin(1)
    row = np.arange(len(ends))
    outward = np.stack([-along[:, 1], along[:, 0]], 1)[index]
    outward = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    height = (away[row, index] * outward).sum(1)
    beyond = (index == len(along) - 1) & (share[row, index] > 1)  # behind the last molar
    return np.where(beyond, 0.0, np.maximum(margin - height, 0))[:, None] * outward


def along_bone(face: Face, moved: np.ndarray, skin: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Displacements (S, H, 3) of the left half whose bony parts slide along the resting skin instead of a chord.

    The part of a displacement across the skin is kept as a height; the part along it ends on the skin.

    Parameters
    ----------
    face : Face
    moved : (S, H, 3) float64
    skin : (V, 3) float64
        The resting surface, mm.
    faces : (F, 3) int64
        Its triangles of the left half.
    """
    bony = face.weights(_BONY)
    shape, at = np.nonzero(np.linalg.norm(moved, axis=2) * bony > 1e-6)
    step, normal, start = moved[shape, at], face.normals[at], face.points[at]
    height = (step * normal).sum(1, keepdims=True)
    closest = Closest(skin, faces)
    _, _, rest = closest(face.points[np.unique(at)])
    _, hit, ends = closest(start + step - height * normal)
    a, b, c = (skin[faces[hit, k]] for k in range(3))
    upward = np.cross(b - a, c - a)
    upward /= np.linalg.norm(upward, axis=1, keepdims=True)
    began = rest[np.searchsorted(np.unique(at), at)]
    slid = ends - began + height * upward
    slid[start[:, 0] <= 1e-9, 0] = 0
    kept = moved.copy()
    kept[shape, at] += bony[at, None] * (slid - step)
    return kept
