"""One camera's points found in one picture after the other; lids, which shut within a frame, at several places."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from blendcap.data import Rig
from blendcap.data.names import canonical
from blendcap.makeup.expectation import Guess
from blendcap.makeup.matching import Windows
from blendcap.makeup.skin_points import SkinPoints

CORRELATED = 0.8  # correlation with the neutral window from which on a point is found
SURE = 0.95  # mean correlation of a lid's points below which it is sought elsewhere, too
FARTHEST = 10.0  # pixels from where a point is sought
KEPT = 0.8  # of how far a point was from where it was expected, in each frame in which it is lost
BLUR = 0.7  # pixels, against noise
LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of a blink at which a lid is sought
CARRIED = 2.0  # mm by which a blink carries the points of a lid


class Lid(NamedTuple):
    """Points that a blink carries."""

    shape: int  # row of the blink in the rig
    rows: np.ndarray  # (L,) of the points
    windows: Windows


def lids_of(rig: Rig, points: SkinPoints) -> list[Lid]:
    """The lids of a rig, one a blink, as far as there are points on them."""
    lids = []
    for shape in np.flatnonzero([canonical(name).startswith("eyeBlink") for name in rig.names]):
        deltas = np.einsum("kc,kcd->kd", points.barycentric, rig.deltas[shape][rig.mesh.faces[points.faces]])
        rows = np.flatnonzero(np.linalg.norm(deltas, axis=1) > CARRIED)
        if len(rows):
            lids.append(Lid(int(shape), rows, points.windows.of(rows)))
    return lids


class Follower:
    """Finds the points of the neutral picture in one picture after the other."""

    def __init__(self, points: SkinPoints, lids: list[Lid], scale: int = 1):
        self.windows, self.lids, self.scale = points.windows, lids, scale
        self.offset = np.zeros_like(points.pixels)  # how far the points were from where they were expected
        self.keep = np.einsum("kim,kin->kmn", points.axes, points.axes)  # only what is surely seen is carried on

    def find(self, picture: np.ndarray, guess: Guess, lids: list[list[Guess]], frame: int) -> np.ndarray:
        """Pixels (K, 2) in a picture (H, W) uint8, NaN where a point is lost.

        Parameters
        ----------
        guess : Guess
        lids : a list of Guess per lid
            Where its points are at each of `LEVELS`.
        frame : int
            Of the guesses.
        """
        picture = soft(picture, self.scale)
        start = guess.pixels[frame] + self.offset
        found, correlation = self.windows.find(picture, start, guess.warps[frame])
        for lid, elsewhere in zip(self.lids, lids, strict=True):
            best = correlation[lid.rows].mean()
            if best > SURE:
                continue
            for other in elsewhere:
                places, said = lid.windows.find(picture, other.pixels[frame], other.warps[frame])
                if said.mean() > best:
                    best, found[lid.rows], correlation[lid.rows] = said.mean(), places, said
                    start[lid.rows] = other.pixels[frame]
        good = (correlation > CORRELATED) & (np.linalg.norm(found - start, axis=1) < FARTHEST)
        moved = np.einsum("kmn,kn->km", self.keep, found - guess.pixels[frame])
        self.offset = np.where(good[:, None], moved, KEPT * self.offset)
        return np.where(good[:, None], found, np.nan)


def soft(picture: np.ndarray, scale: int = 1) -> np.ndarray:
    """A picture (H, W) float32 with less noise; `scale` pixels in each direction become one."""
    import cv2

    if scale > 1:
        size = (picture.shape[1] // scale, picture.shape[0] // scale)
        whole = np.ascontiguousarray(picture[: size[1] * scale, : size[0] * scale])
        picture = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(picture.astype(np.float32), (0, 0), BLUR)
