"""Named places on the mannequin: the 68 landmarks of the iBUG annotation and a layout of head-camera markers."""

from __future__ import annotations

import numpy as np

from blendcap.data import Mesh, SurfacePoints
from blendcap.synthetic.mannequin.cage import Cage

# iBUG 300-W order (Sagonas et al. 2013), from the subject's right (~) to the left; A+B is the middle of an edge, A++B a
# quarter of the way from A. Points lie where they do in the mean of annotated faces: the jaw's on the outline that is
# seen from the front, from ear to chin; the brows' on hair; along nostrils and lips at half the base of the
# nose, and at 0.63 (outer lip) and 0.27 (inner lip) of the way from the middle of the mouth to its corner.
_LANDMARKS = (
    "~R6 ~R6+~R7 ~R7 ~R8++~R7 ~S8++~R8 ~S8+~S9 ~S9++~M77 ~M77 M78 M77 S9++M77 S8+S9 S8++R8 R8++R7 R7 R6+R7 R6 "
    "~orbit.5 ~orbit.4++~orbit.5 ~orbit.3++~orbit.4 ~orbit.2++~orbit.3 ~G1+~orbit.1 "
    "G1+orbit.1 orbit.2++orbit.3 orbit.3++orbit.4 orbit.4++orbit.5 orbit.5 N1 N2 N3++N2 N4 "
    "~W3 ~nostril.3+~nostril.4 N6 nostril.3+nostril.4 W3 ~margin.6 ~margin.4 ~margin.2 ~margin.0 ~margin.10 ~margin.8 "
    "margin.0 margin.2 margin.4 margin.6 margin.8 margin.10 "
    "~border.4 ~border.2+~border.3 ~border.1 border.0 border.1 border.2+border.3 "
    "border.4 border.5+border.6 border.7 border.8 ~border.7 ~border.5+~border.6 "
    "~seam.4 ~seam.1 seam.0 seam.1 seam.4 seam.7 seam.8 ~seam.7"
)
_MIDDLE = {
    "forehead_middle": "b0", "glabella": "N0", "nose_bridge": "N1", "nose_tip": "N4", "philtrum": "around.0",
    "lip_upper_middle": "crest.0", "lip_lower_middle": "crest.8", "chin_dimple": "fold.8", "chin": "M68",
    "chin_under": "M78",
}  # fmt: skip
_SIDED = {
    "forehead": "b3", "temple": "P6", "brow_inner": "orbit.1", "brow_middle": "orbit.3", "brow_outer": "orbit.5",
    "lid_upper": "crease.3", "lid_lower": "crease.9", "eye_outer": "sulcus.6", "nose_side": "B1", "nose_wing": "W2",
    "infraorbital": "orbit.9", "cheekbone": "P8", "cheek": "Q9", "nasolabial": "Q10", "lip_upper": "border.2",
    "lip_corner": "border.4", "lip_lower": "border.6", "lip_side": "fold.5", "chin_side": "M67", "jaw": "S9",
    "jaw_angle": "S8",
}  # fmt: skip


def _vertex(cage: Cage, word: str) -> int:
    name = word.removeprefix("~")
    left = int(cage.index([name])[0])
    return int(cage.twin[left]) if word.startswith("~") else left


def _place(cage: Cage, word: str, middles: dict[tuple[int, int], int]) -> int:
    """The fine vertex of a word: a point, or on the way from one to another, halved as often as there is a plus."""
    ends = [_vertex(cage, end) for end in word.replace("++", "+").split("+")]
    first, last = ends[0], ends[-1]
    for _ in range(word.count("+")):
        last = middles[min(first, last), max(first, last)]
    return last


def landmarks(cage: Cage, mesh: Mesh, middles: dict[tuple[int, int], int]) -> SurfacePoints:
    """The 68 landmarks, named "0" to "67": 0 on the subject's right jaw, 36 the subject's right outer canthus.

    `middles` are those of the surface.
    """
    vertices = [_place(cage, word, middles) for word in _LANDMARKS.split()]
    return SurfacePoints.at_vertices([str(i) for i in range(len(vertices))], np.array(vertices), mesh)


def markers(cage: Cage, mesh: Mesh) -> SurfacePoints:
    """About fifty places for the markers of a head-mounted camera, mirror symmetric, sides by `_left` and `_right`."""
    places = {name: _vertex(cage, word) for name, word in _MIDDLE.items()}
    for name, word in _SIDED.items():
        places[f"{name}_left"], places[f"{name}_right"] = _vertex(cage, word), _vertex(cage, f"~{word}")
    return SurfacePoints.at_vertices(list(places), np.array(list(places.values())), mesh)
