"""The shapes of the eyelids: both margins travel on their own spheres round the eyeball.

A linear shape takes the chord where a lid takes the arc, so half a blink would cut into the eyeball. The line where the
lids meet therefore bulges as far as it must for the chord to stay clear of it.
"""

from __future__ import annotations

import numpy as np

from blendcap.synthetic.mannequin.cage import ring
from blendcap.synthetic.mannequin.face import Face, push
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS

CLEARANCE = 0.9  # of the lid margin's control points above the eyeball, mm
MEETING = 0.22  # the lids meet this far up from the lower lid
_BULGE = 0.25  # of the lining as it slides round the eyeball, whose curve its quads cut, mm
_TO_CANTHI = np.array([0.25, 0.08, 0.0, 0.16, 0.36])  # and higher towards the canthi, which do not sink


def lids(face: Face, upper: float, lower: float, fold: float = 1.0, meeting: float = MEETING) -> np.ndarray:
    """Displacement (H, 3) that closes the upper and the lower lid by a share of the way; a negative share opens.

    Parameters
    ----------
    face : Face
    upper, lower : float
        Share of the way to where the lids meet.
    fold : float
        How much the skin above the upper lid follows.
    meeting : float
        Where they meet: 0 at the lower lid, 1 at the upper.
    """
    moved = np.zeros_like(face.points)
    line = _meeting_line(face, meeting)
    for places, share, up in ((range(1, 6), upper, 1.0), (range(11, 6, -1), lower, -1.0)):
        _move_lid(face, moved, places, line, share, up, fold)
    return moved


def _move_lid(face: Face, moved: np.ndarray, places: range, line: np.ndarray, share: float, up: float, fold: float):
    globe, points = face.person.globe, face.points
    sock, margin, edge, crease, sulcus = (
        face.cage.index(ring(name, places)) for name in ("sock", "margin", "edge", "crease", "sulcus")
    )
    outward = _unit(line - globe)
    moved[margin] = _arc(points[margin], line, globe, share) - points[margin]
    rim = line + 1.5 * outward + [0, 0.9 * up, 0]
    moved[edge] = _arc(points[edge], rim, globe, share) - points[edge]
    along = points[sock] + 0.5 * moved[margin]  # the lining slides round the eyeball
    reach = np.linalg.norm(points[sock] - globe, axis=1, keepdims=True) + _BULGE * max(share, 0)
    moved[sock] = globe + reach * _unit(along - globe) - points[sock]
    if up > 0:
        stretched = 0.45 * line + 0.55 * points[crease]
        stretched = globe + (GLOBE_RADIUS + 2.8) * _unit(stretched - globe)
        moved[crease] = 0.8 * share * fold * (stretched - points[crease])
        moved[sulcus] = share * fold * np.array([0, -1.6, -0.5])
    else:
        moved[crease] = share * np.array([0, 1.2, 0.3])
        moved[sulcus] = share * np.array([0, 0.4, 0.2])


def _meeting_line(face: Face, meeting: float) -> np.ndarray:
    """Where margins 1 to 5 meet, (5, 3): so far out that half way there each upper point clears the eyeball."""
    globe = face.person.globe
    above, below = face.pairs("margin", range(1, 6))
    top, bottom = face.points[above], face.points[below]
    low = min(meeting, MEETING)  # a lower lid that rises far rises evenly: at the canthi it would turn over
    level = np.maximum(meeting, low + (1 - low) * _TO_CANTHI[:, None])
    direction = _unit(bottom + level * (top - bottom) - globe)
    reach = np.zeros(len(direction))
    for start in (top - globe, bottom - globe):  # |start + reach direction| / 2 = the radius to keep
        along = (start * direction).sum(1)
        apart = (start**2).sum(1) - along**2
        needed = np.sqrt(np.maximum(4 * (GLOBE_RADIUS + CLEARANCE) ** 2 - apart, 0)) - along
        reach = np.maximum(reach, np.maximum(needed, np.linalg.norm(start, axis=1)))
    return globe + reach[:, None] * direction


def _arc(points: np.ndarray, goals: np.ndarray, center: np.ndarray, share: float) -> np.ndarray:
    """Points turned about `center` a share of the way to their goals; their radius changes evenly."""
    a, b = points - center, goals - center
    ra, rb = np.linalg.norm(a, axis=1, keepdims=True), np.linalg.norm(b, axis=1, keepdims=True)
    angle = np.arccos(np.clip((a * b).sum(1, keepdims=True) / (ra * rb), -1, 1))
    turned = (np.sin((1 - share) * angle) * a / ra + np.sin(share * angle) * b / rb) / np.sin(angle)
    return center + turned * ((1 - share) * ra + share * rb)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def blink(face: Face) -> np.ndarray:
    """Both lids close and meet."""
    return lids(face, 1.0, 1.0)


def close(face: Face) -> np.ndarray:
    """The upper lid sinks to the resting lower lid, as in sleep (action unit 43)."""
    return lids(face, 1.0, 1.0, 1.0, 0.1)


def instead_of(shape: np.ndarray, face: Face) -> np.ndarray:
    """A corrective that takes the lids out of a shape: with a blink, only the blink moves them, and they meet."""
    return -face.weights({"sock": 1, "margin": 1, "edge": 1, "crease": 0.7, "sulcus": 0.25})[:, None] * shape


def wide(face: Face) -> np.ndarray:
    """The lids draw apart."""
    return lids(face, -0.34, -0.18, 0.8)


def look_down(face: Face) -> np.ndarray:
    """The upper lid follows the eye down."""
    return lids(face, 0.48, -0.25, 0.7)


def look_up(face: Face) -> np.ndarray:
    """The upper lid follows the eye up."""
    return lids(face, -0.2, 0.1, 0.5)


def look_in(face: Face) -> np.ndarray:
    """The cornea under the lids carries them a little towards the nose."""
    lid = face.weights({"margin": 1, "edge": 1, "crease": 1}) * np.isin(face.place, (0, 6), invert=True)
    x, _, z = face.at("crease.3")
    lid = lid * face.near((x, 0, z), (12, 9, 12))
    above, below = face.pairs("margin", range(1, 6))
    lid[above] = lid[below] = 0.5 * (lid[above] + lid[below])  # both margins alike, so that a blink still closes them
    return push(lid, (-0.5, 0, 0))


def look_out(face: Face) -> np.ndarray:
    """And towards the temple."""
    return -look_in(face)
