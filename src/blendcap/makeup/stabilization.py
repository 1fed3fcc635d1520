"""How the head sits before the camera in each frame, told by points that do not move with the face."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError

WINDOW = (15, 15)  # pixels
LEVELS = 2  # of the pyramid
AGREE = 1.0  # pixels between a point and itself, tracked there and back
FARTHEST = 40.0  # pixels from where it began: no helmet slips that far, so the point was lost


class Stabilizer:
    """Follows a few points from the neutral frame on, by optical flow, and fits a similarity to them.

    Section 7.2.2 of the 2016 paper: a point on the helmet and two stabilizing markers. Each frame is matched with the
    neutral one, not with the frame before, so that nothing drifts; a point that flow does not take there and back
    within a pixel is left out of that frame.

    Parameters
    ----------
    neutral : (H, W) uint8
        The neutral frame, grey.
    points : (K, 2)
        Pixels in it, K at least 2: stable markers and, if it is in the picture, a point of the helmet.
    """

    def __init__(self, neutral: np.ndarray, points: np.ndarray):
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
            raise InputError(f"Stabilizing takes at least two points in the neutral picture, but got {points.shape}.")
        self.neutral, self.points = neutral, points
        self.last = points.astype(np.float32)

    def follow(self, frame: np.ndarray) -> tuple[np.ndarray, float]:
        """The matrix (2, 3) from the neutral frame's pixels to this one's, and the part of the points that it rests on.

        Without two points that are found the last known place is taken, and the part is 0.
        """
        import cv2

        start = self.points.astype(np.float32)[:, None]
        options = {"winSize": WINDOW, "maxLevel": LEVELS, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
        there, seen, _ = cv2.calcOpticalFlowPyrLK(self.neutral, frame, start, self.last[:, None].copy(), **options)
        back, again, _ = cv2.calcOpticalFlowPyrLK(frame, self.neutral, there, start.copy(), **options)
        moved = there[:, 0].astype(np.float64)
        good = (seen.ravel() > 0) & (again.ravel() > 0)
        good &= np.linalg.norm((back - start)[:, 0], axis=1) < AGREE
        good &= np.linalg.norm(moved - self.points, axis=1) < FARTHEST
        if good.sum() < 2:
            return similarity(self.points, self.last), 0.0
        matrix = similarity(self.points[good], moved[good])
        self.last = (self.points @ matrix[:, :2].T + matrix[:, 2]).astype(np.float32)
        return matrix, float(good.mean())


class Held:
    """Knows where points that do not move with the face are in each frame, from the head's pose.

    Nothing is followed, so nothing is lost. The motion of the picture is the affine one nearest to the points': a head
    that turns is foreshortened.

    Parameters
    ----------
    paths : (T, K, 2)
        Pixels, K at least 3; NaN in frames in which it is not known.
    """

    def __init__(self, paths: np.ndarray):
        if paths.shape[1] < 3 or not np.isfinite(paths[0]).all():
            raise InputError("Holding the picture still takes three points that are known in the first frame.")
        self.paths, self.frame = paths, 0
        self.to_motion = np.linalg.pinv(_with_ones(paths[0]))
        self.last = np.eye(3)[:2]

    def follow(self, _: np.ndarray) -> tuple[np.ndarray, float]:
        """As `Stabilizer.follow`, for the next frame; of one that is not known the last known place is taken."""
        if self.frame == len(self.paths):
            raise InputError(
                f"The video goes on after the {self.frame} frames of the take; cut both to the same frames."
            )
        places = self.paths[self.frame]
        known = bool(np.isfinite(places).all())
        if known:
            self.last = (self.to_motion @ places).T  # least squares
        self.frame += 1
        return self.last, float(known)


def held(neutral: np.ndarray, anchors: np.ndarray) -> Stabilizer | Held:
    """Whatever holds a camera's picture still: anchors (K, 2) are followed from the neutral frame, (T, K, 2) known."""
    return Held(anchors) if np.ndim(anchors) == 3 else Stabilizer(neutral, anchors)


def _with_ones(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points, np.ones(len(points))])


def similarity(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The matrix (2, 3) that turns, scales and shifts points (K, 2) onto others, least squares."""
    middle, goal = start.mean(0), end.mean(0)
    a, b = (start - middle) @ [1, 1j], (end - goal) @ [1, 1j]
    turn = np.vdot(a, b) / max(np.vdot(a, a).real, 1e-12)
    linear = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
    return np.column_stack([linear, goal - linear @ middle])
