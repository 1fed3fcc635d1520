"""Makeup for the recognition of action units: strokes of white paint where muscles move the skin.

Places after Ravikumar et al., "Reading Between the Dots" (2016), section 7.2.1: inner and outer brow, between the
brows, upper and lower lid, around the lips. The strokes on the red of the lips, on the sides of the nose and on the
cheeks are ours: there lips roll and part, the sneer shows, and cheeks rise. The upper lid is painted with the eyes
shut: skin seen above an open eye may be that of the fold, which stays where it is when the lid comes down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from blendcap.data import InputError, Mesh, Rig, landmarks68
from blendcap.data.names import match
from blendcap.numerics.barycentric import barycentric_flat
from blendcap.rendering.rasterize import visibility
from blendcap.solving.shares import in_shares
from blendcap.synthetic.paint import Stroke, skin_faces

# Strokes of the subject's right side (_right, mirrored for _left) and of the middle. A place is a mean of landmarks
# plus (dx, dy) in distances between the outer corners of the eyes: dx to the subject's left, dy up. Those of `SHUT` are
# places on the face with the eyes shut.
STROKES = """
brow_inner_1_right   20 -.01 .075 / 21 .0 .075 / 21 .05 .07
brow_inner_2_right   20 -.01 .135 / 21 .0 .14 / 21 .05 .135
brow_inner_3_right   20 -.01 .195 / 21 .0 .205 / 21 .05 .20
brow_outer_1_right   17 -.01 .065 / 18 .0 .075 / 19 -.02 .08
brow_outer_2_right   17 .01 .125 / 18 .01 .135 / 19 -.02 .14
brow_outer_3_right   17 .05 .185 / 18 .03 .195 / 19 -.02 .20
glabella_right       27,21 .0 .075 / 27,21 .005 .0 / 27,27,21 -.005 -.04
bridge_1             27,39 -.0 -.03 / 27 .0 -.0 / 27,42 .0 -.03
bridge_2             28,39 .03 -.06 / 28 .0 -.015 / 28,42 -.03 -.06
lid_upper_right      36 .035 .015 / 37 .0 .03 / 37,38 .0 .035 / 38 .0 .03 / 39 -.035 .015
lid_lower_1_right    36 .03 -.035 / 41 .0 -.05 / 40,41 .0 -.055 / 40 .0 -.05 / 39 -.03 -.035
lid_lower_2_right    36 .0 -.10 / 41 .0 -.125 / 40 .0 -.125 / 39 -.01 -.10
cheek_right          36 .01 -.205 / 41 .0 -.235 / 40,41 .0 -.24 / 40 .0 -.235
lip_upper_right      48 .01 .055 / 49 -.01 .05 / 50 -.02 .05
lip_lower_right      48 .01 -.055 / 59 -.01 -.06 / 58 -.01 -.06
lip_middle           58,57 .0 -.055 / 57 .0 -.06 / 57,56 .0 -.055
lip_corner_right     48 -.045 .045 / 48 -.06 .0 / 48 -.045 -.045
lip_red_1_right      49,49,49,60,61 .0 .0 / 49,60,61 .0 .0
lip_red_2_right      50,50,50,61 .0 .0 / 50,61 .0 .0 / 50,61,61 .0 .0
lip_red_3_right      59,59,59,60,67 .0 .0 / 59,60,67 .0 .0
lip_red_4_right      58,58,58,67 .0 .0 / 58,67 .0 .0 / 58,67,67 .0 .0
lip_red_5            57,57,57,66 .0 .0 / 57,66 .0 .0 / 57,66,66 .0 .0
nose_side_1_right    29,31 .01 .09 / 29,31 -.05 .085 / 29,31 -.09 .07
nose_side_2_right    29,31 -.005 .01 / 29,31 -.06 .01 / 29,31 -.10 .0
"""
ACTION_UNITS = {  # what each stroke is there to show
    "brow_inner": (1,), "brow_outer": (2,), "glabella": (4, 9), "bridge": (9,), "lid_upper": (45, 43, 7),
    "lid_lower": (7, 6), "cheek": (6, 12), "lip_upper": (10, 12, 18), "lip_lower": (18, 23), "lip_middle": (18, 23),
    "lip_corner": (12, 18, 23), "lip_red": (10, 18, 26), "nose_side": (9, 10),
}  # fmt: skip
SHUT = ("lid_upper",)  # strokes that are painted with the eyes shut
MIRROR = np.array([
    *range(16, -1, -1), *range(26, 16, -1), *range(27, 31), *range(35, 30, -1), 45, 44, 43, 42, 47, 46, 39, 38, 37, 36,
    41, 40, *range(54, 47, -1), *range(59, 54, -1), *range(64, 59, -1), 67, 66, 65,
])  # fmt: skip
BLINKS = ("eyeBlinkLeft", "eyeBlinkRight")
RADIUS = 0.8  # half a stroke's width, mm
STEP = 0.5  # between the places at which the brush is put to the skin, mm
PIXEL = 0.25  # of the picture that finds the skin, mm
FAR = 1e6  # mm; rays from there are parallel
BORDER = 40.0  # around the landmarks, mm
CLIFF = 3.0  # mm; where the skin falls away by more from step to step, the brush is lifted
THROUGH = 30.0  # mm; what lies farther behind most of a stroke is seen through an open eye or mouth


@dataclass(frozen=True)
class Hand:
    """How evenly strokes are painted, mm.

    Parameters
    ----------
    shift : float
        Standard deviation of a whole stroke's place, in each direction.
    wobble : float
        Standard deviation along a stroke, smooth over a centimetre.
    width : float
        Standard deviation of the logarithm of a stroke's width.
    """

    shift: float = 0.7
    wobble: float = 0.3
    width: float = 0.12


def draw_makeup(rig: Rig, *, seed: int, hand: Hand | None = None) -> list[Stroke]:
    """Strokes on the neutral face of a rig with landmarks, each painted by a hand that is not a ruler.

    Parameters
    ----------
    rig : Rig
        The performer's own, `performer.rig`.
    seed : int
        Of the hand.

    Raises
    ------
    InputError
        If the rig has no points "landmarks68".
    """
    hand, rng = hand or Hand(), np.random.default_rng(seed)
    open_eyes, shut_eyes = _Front(rig, rig.mesh), _Front(rig, _with_shut_eyes(rig))
    unit = float(np.linalg.norm(open_eyes.marks[45] - open_eyes.marks[36]))
    strokes = []
    for line in STROKES.strip().splitlines():
        name, text = line.split(maxsplit=1)
        skin = shut_eyes if name.startswith(SHUT) else open_eyes
        for side in ("right", "left") if name.endswith("_right") else ("",):
            path = _steady(_places(text, skin.marks, unit, mirrored=side == "left"))
            path += hand.shift * rng.normal(size=2) + _wobble(len(path), hand.wobble, rng)
            radius = RADIUS * np.exp(hand.width * (rng.normal() + _wobble(len(path), 1.0, rng)[:, 0]))
            points, kept = skin.under(path)
            if kept.sum() < 2:
                raise InputError(f"The stroke {name!r} finds no skin on the rig {rig.name!r}; check its landmarks.")
            strokes.append(Stroke(name.replace("right", side), points[kept], radius[kept]))
    return strokes


def _with_shut_eyes(rig: Rig) -> Mesh:
    """The neutral with both eyes shut; a rig without such shapes leaves them open."""
    shares = in_shares(rig)
    blinks = [rig.index(own) for found in match(BLINKS, rig.names).values() for own in found]
    return rig.mesh.with_vertices(rig.mesh.vertices + shares.deltas[blinks].sum(0, dtype=np.float64))


def _places(text: str, marks: np.ndarray, unit: float, *, mirrored: bool) -> np.ndarray:
    """The places (K, 2) in the face's plane through which a stroke goes, mm."""
    places = []
    for word in text.split("/"):
        numbers, x, y = word.split()
        rows = np.array([int(n) for n in numbers.split(",")])
        sign = -1 if mirrored else 1
        rows = MIRROR[rows] if mirrored else rows
        places.append(marks[rows, :2].mean(0) + unit * np.array([sign * float(x), float(y)]))
    return np.array(places)


def _steady(places: np.ndarray) -> np.ndarray:
    """A smooth curve through places (K, 2), sampled every `STEP` mm."""
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    return CubicSpline(along, places, bc_type="natural")(np.linspace(0, along[-1], max(3, int(along[-1] / STEP))))


def _wobble(count: int, size: float, rng: np.random.Generator) -> np.ndarray:
    """(count, 2) smooth noise of this standard deviation."""
    width = 5.0 / STEP
    noise = gaussian_filter1d(rng.normal(size=(count + 40, 2)), width, axis=0)
    return size * noise[20 : count + 20] * np.sqrt(2 * width * np.sqrt(np.pi))


class _Front:
    """The skin of a posed face as parallel rays from the front meet it: what lies behind a place in its plane."""

    def __init__(self, rig: Rig, posed: Mesh):
        self.neutral, self.vertices, self.faces = rig.mesh.vertices, posed.vertices, rig.mesh.faces[skin_faces(rig)]
        self.marks = landmarks68(rig).positions(posed)
        marks = self.marks[:, :2]
        self.corner = np.array([marks[:, 0].min() - BORDER, marks[:, 1].max() + BORDER])
        size = (marks.max(0) - marks.min(0) + 2 * BORDER) / PIXEL
        depth = FAR - self.vertices[:, 2]
        pixels = (self.vertices[:, :2] - self.corner) / PIXEL * [1, -1]
        corners = np.column_stack([pixels * depth[:, None], depth])
        self.seen = visibility(corners, self.faces, (int(size[0]), int(size[1])))[0]

    def under(self, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places on the neutral skin (K, 3) under a path (K, 2), and where the brush touches it (K,) bool."""
        column, row = np.round((path - self.corner) / PIXEL * [1, -1]).astype(int).T
        inside = (row >= 0) & (column >= 0) & (row < self.seen.shape[0]) & (column < self.seen.shape[1])
        face = np.where(inside, self.seen[np.where(inside, row, 0), np.where(inside, column, 0)], -1)
        corners = self.vertices[self.faces[face]]
        weights = barycentric_flat(path, corners[..., :2]).clip(0, 1)  # a pixel's middle may be in the face next to it
        weights /= weights.sum(1, keepdims=True)
        depth = np.einsum("kc,kc->k", weights, corners[..., 2])
        kept = face >= 0
        kept &= depth > np.median(depth[kept]) - THROUGH if kept.any() else False
        kept[1:] &= np.abs(np.diff(depth)) < CLIFF
        return np.einsum("kc,kcd->kd", weights, self.neutral[self.faces[face]]), kept
