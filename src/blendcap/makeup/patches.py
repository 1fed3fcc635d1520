"""From frames to patches of paint: stabilized, cut out, freed of skin and markers, aligned to the training face."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from blendcap.data import InputError
from blendcap.makeup.regions import PATCH_SIZE
from blendcap.makeup.stabilization import Held, Stabilizer, held
from blendcap.makeup.threads import in_threads

BLOCK = 600  # frames
AT_ONCE = 8  # frames of each camera that are in memory
LEAST_PAINT, MOST_PAINT = 0.01, 0.5  # part of a neutral patch that paint covers
CONTRAST = 0.25  # paint is brighter than skin by this part at least
CRUMB = 8  # pixels; pieces that are smaller are rims of markers and glints
FINE = 16  # parts of a pixel to which discs are drawn
STROKE = 11  # pixels of a patch; strokes are thinner
SEARCH = 3  # pixels of blur before patches of two people are laid over each other


@dataclass(frozen=True, eq=False)
class Patches:
    """The makeup patches of a take.

    Parameters
    ----------
    images : {patch: (T, h, w) uint8}
        Paint white, all else black.
    rate : float
        Frames a second.
    sure : (T,) float64
        Part of the stabilizing points that were found, the least over the cameras; 1 or 0 where they are not followed.
    neutral : {patch: (h, w) uint8}
        At rest: the first frame of the take.
    """

    images: Mapping[str, np.ndarray]
    rate: float
    sure: np.ndarray
    neutral: Mapping[str, np.ndarray]

    def of(self, names: Sequence[str]) -> list[np.ndarray]:
        """The pictures of these patches; refuses one that is not there."""
        lacking = [name for name in names if name not in self.images]
        if lacking:
            raise InputError(
                f"The patch {lacking[0]!r} is needed, but there are only {', '.join(self.images)}; cut the "
                "same patches that the classifier is trained on."
            )
        return [self.images[name] for name in names]


def extract_patches(
    videos: Sequence[Iterable[np.ndarray]],
    places: Mapping[str, tuple[int, np.ndarray]],
    anchors: Sequence[np.ndarray],
    rate: float,
    **options,
) -> Patches:
    """The makeup patches of a whole take; see `each_block`."""
    return collect(each_block(videos, places, anchors, rate, **options))


def collect(blocks: Iterable[Patches]) -> Patches:
    """Blocks, one after the other, as one."""
    parts = list(blocks)
    images = {name: np.concatenate([part.images[name] for part in parts]) for name in parts[0].images}
    return Patches(images, parts[0].rate, np.concatenate([part.sure for part in parts]), parts[0].neutral)


def each_block(
    videos: Sequence[Iterable[np.ndarray]],
    places: Mapping[str, tuple[int, np.ndarray]],
    anchors: Sequence[np.ndarray],
    rate: float,
    *,
    dots: Sequence[np.ndarray] | None = None,
    dot_radius: float = 5.0,
    threshold: float | None = None,
    block: int = BLOCK,
) -> Iterator[Patches]:
    """Cut the patches out of head-camera video, a block of frames at a time: memory does not grow with the take.

    Parameters
    ----------
    videos : a sequence of frames (H, W) uint8, grey, per camera
        Read once, a frame at a time. The first frame is neutral.
    places : {patch: (camera, corners (4, 2))}
        Where each patch is in the first frame, from `seen_patches`; corners run around the patch.
    anchors : (K, 2) or (T, K, 2) per camera
        Pixels of points that do not move with the face: in the first frame, then they are followed by optical flow
        (see `Stabilizer`), or in every frame.
    rate : float
        Frames a second.
    dots : (T, M, 2) per camera, optional
        Pixels of the markers; a disc there is not paint.
    dot_radius : float
        Pixels.
    threshold : float, optional
        How much brighter than the skin around it paint is, in multiples of the patch's median; found from the first
        frame of each patch if not given.
    block : int
        Frames.

    Raises
    ------
    InputError
        If there is no frame, the videos differ in length, a patch shows no paint, or the threshold is negative.
    """
    if threshold is not None and not 0 <= threshold < np.inf:
        raise InputError(f"The threshold of paint is {threshold:g}, but must be 0 or more; leave it out to find one.")
    cutters = [_Cutter(view, places, anchors[view], threshold) for view in range(len(videos))]
    neutral: dict[str, np.ndarray] = {}
    stream, done = _together(videos), 0

    def cut(view: int) -> None:
        for k, pictures in enumerate(frames):
            cutters[view].cut(pictures[view], None if dots is None else dots[view][done + k], dot_radius)

    while frames := list(islice(stream, min(AT_ONCE, block - done % block))):
        in_threads(cut, range(len(cutters)))
        done += len(frames)
        neutral = neutral or {name: pictures[0] for cutter in cutters for name, pictures in cutter.images.items()}
        if done % block == 0:
            yield _collected(cutters, places, rate, neutral)
    if not neutral:
        raise InputError("The head-camera video has no frame; check the files.")
    if cutters[0].sure:
        yield _collected(cutters, places, rate, neutral)


def _collected(cutters: list[_Cutter], places, rate: float, neutral) -> Patches:
    """What the cutters have cut since they were last asked."""
    images = {name: np.array(pictures) for cutter in cutters for name, pictures in cutter.images.items()}
    sure = np.min([cutter.sure for cutter in cutters], axis=0)
    for cutter in cutters:
        cutter.forget()
    return Patches({name: images[name] for name in places}, rate, sure, {name: neutral[name] for name in places})


def _together(videos: Sequence[Iterable[np.ndarray]]) -> Iterator[tuple[np.ndarray, ...]]:
    """The frames of all cameras side by side; refuses those that end before the others."""
    streams = [iter(video) for video in videos]
    count = 0
    while True:
        frames = [next(stream, None) for stream in streams]
        over = [frame is None for frame in frames]
        if all(over):
            return
        if any(over):
            raise InputError(
                f"Camera {over.index(True)} ends after {count} frames, before the others; give videos of one length."
            )
        yield tuple(frame for frame in frames if frame is not None)
        count += 1


class _Cutter:
    """Cuts the patches of one camera."""

    def __init__(self, view: int, places, anchors: np.ndarray, threshold: float | None):
        self.corners = {name: corners for name, (camera, corners) in places.items() if camera == view}
        self.anchors, self.threshold = anchors, threshold
        self.images: dict[str, list[np.ndarray]] = {name: [] for name in self.corners}
        self.sure: list[float] = []
        self.limits: dict[str, float] = {}
        self.stabilizer: Stabilizer | Held | None = None

    def forget(self) -> None:
        """Let go of what was cut so far."""
        self.images, self.sure = {name: [] for name in self.corners}, []

    def cut(self, frame: np.ndarray, dots: np.ndarray | None, radius: float) -> None:
        first = self.stabilizer is None
        if first:
            self.stabilizer = held(frame, self.anchors)
        assert self.stabilizer is not None
        matrix, sure = self.stabilizer.follow(frame)
        self.sure.append(sure)
        for name, corners in self.corners.items():
            warp = patch_warp(corners @ matrix[:, :2].T + matrix[:, 2])
            patch = cut_out(frame, warp)
            if first:
                self.limits[name] = paint_threshold(patch, name) if self.threshold is None else self.threshold
            found = paint(
                patch, self.limits[name], None if dots is None else in_patch(dots, warp), radius * _zoom(warp)
            )
            if first and not found.any():
                raise InputError(
                    f"Nothing in the patch {name!r} of the first frame is brighter than the skin around it by "
                    f"{self.limits[name]:g} times the patch's median; give a smaller threshold, or none to find one."
                )
            self.images[name].append(found)


def patch_warp(corners: np.ndarray) -> np.ndarray:
    """The homography (3, 3) from pixels of a frame to those of a patch with corners (4, 2)."""
    import cv2

    width, height = PATCH_SIZE
    goal = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float32)
    return cv2.getPerspectiveTransform(corners.astype(np.float32), goal)


def cut_out(frame: np.ndarray, warp: np.ndarray) -> np.ndarray:
    """The patch (h, w) uint8 of a frame."""
    import cv2

    return cv2.warpPerspective(frame, warp, PATCH_SIZE, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def paint_threshold(patch: np.ndarray, name: str = "patch") -> float:
    """How much brighter than the skin around it paint is, in multiples of the median of a neutral patch (Otsu)."""
    import cv2

    raised = _raised(patch)
    limit, mask = cv2.threshold(raised, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    level, white = _level(patch), mask > 0
    plain = LEAST_PAINT < white.mean() < MOST_PAINT and raised[white].mean() > CONTRAST * level
    if not plain:
        raise InputError(
            f"No paint is visible in the patch {name!r} of the first frame; check that the frame is neutral and lit, "
            "or give how much brighter than skin paint is."
        )
    return float(limit) / level


def paint(patch: np.ndarray, limit: float, dots: np.ndarray | None = None, radius: float = 5.0) -> np.ndarray:
    """The paint (h, w) uint8, 0 or 255, of a patch: what is thin and bright, whatever the light does."""
    import cv2

    white = np.where(_raised(patch) > limit * _level(patch), 255, 0).astype(np.uint8)
    for center in [] if dots is None else np.rint(_near(dots, radius) * FINE).astype(int).tolist():
        cv2.circle(white, center, round(radius * FINE), 0, -1, shift=FINE.bit_length() - 1)
    _, pieces, figures, _ = cv2.connectedComponentsWithStats(white)
    kept = np.where(np.asarray(figures)[:, cv2.CC_STAT_AREA] < CRUMB, 0, 255).astype(np.uint8)
    kept[0] = 0  # what is not paint
    return np.take(kept, np.asarray(pieces, dtype=np.intp))


def _raised(patch: np.ndarray) -> np.ndarray:
    """How much brighter than its surroundings each pixel is (h, w) uint8: what a disc wider than a stroke removes."""
    import cv2

    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (STROKE, STROKE))
    return cv2.morphologyEx(patch, cv2.MORPH_TOPHAT, disc)


def _level(patch: np.ndarray) -> float:
    """The median of a patch (h, w) uint8, 1 at least, by counting: a sort takes ten times as long."""
    below = np.cumsum(np.bincount(patch.ravel(), minlength=256))
    middle = np.searchsorted(below, [(patch.size + 1) // 2, patch.size // 2 + 1])
    return max(float(middle.mean()), 1.0)


def in_patch(points: np.ndarray, warp: np.ndarray) -> np.ndarray:
    """Points (M, 2) of a frame in the pixels of a patch."""
    result = points @ warp[:, :2].T + warp[:, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        return result[:, :2] / result[:, 2:]


def _near(dots: np.ndarray, radius: float) -> np.ndarray:
    """Those of the dots (M, 2) whose discs touch a patch; NaN never does."""
    return dots[(dots > -radius - 1).all(1) & (dots < np.array(PATCH_SIZE) + radius + 1).all(1)]


def _zoom(warp: np.ndarray) -> float:
    """Patch pixels per frame pixel, about."""
    return float(np.sqrt(abs(np.linalg.det(warp[:2, :2] / warp[2, 2]))))


def flows(start: Mapping[str, np.ndarray], goal: Mapping[str, np.ndarray]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Where in the neutral patches `start` of one face the places of another's, `goal`, are: a table of x and of y.

    Section 7.2.4 of the 2016 paper (there Liu's flow; here dense inverse search, Kroeger et al. 2016,
    doi:10.1007/978-3-319-46493-0_29).
    """
    import cv2

    flow, tables = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM), {}
    for name, picture in goal.items():
        ours, theirs = (cv2.GaussianBlur(image, (0, 0), SEARCH) for image in (picture, start[name]))
        moved = np.asarray(flow.calc(ours, theirs, None))  # pyright: ignore[reportCallIssue, reportArgumentType]
        height, width = picture.shape
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        tables[name] = (x + moved[..., 0], y + moved[..., 1])
    return tables


def laid_over(patches: Patches, tables: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Patches:
    """The patches seen through the tables of `flows`, every frame and the neutral one."""
    import cv2

    def through(name: str, picture: np.ndarray) -> np.ndarray:
        return cv2.remap(picture, *tables[name], cv2.INTER_LINEAR)

    images = {name: np.stack([through(name, picture) for picture in patches.images[name]]) for name in tables}
    neutral = {name: through(name, patches.neutral[name]) for name in tables}
    return Patches(images, patches.rate, patches.sure, neutral)
