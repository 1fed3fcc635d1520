"""What a classifier sees of a patch: responses of Gabor filters, oriented gradients, edges, or how the strokes moved.

Section 7.2.2 of Reading Between the Dots (2016), section 4.1.10 of the thesis: 8 filters, 2 scales, 4 orientations.
How far each stroke has moved is ours: it follows a weight in proportion, which the look of a patch does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np

from blendcap.data import InputError

SCALES = ((1.8, 5.0), (3.2, 9.0))  # width of the envelope and wavelength, pixels
ORIENTATIONS = 4
KERNEL = 13  # pixels
ELONGATION = 0.6
CELL = 2  # pixels of a patch to one of a feature, in both directions
COARSE = 4  # the same of motion
SOFT = 2.0  # pixels of blur before motion is sought
MOTION = 25.0  # a pixel of motion counts as much as this: about as much as a Gabor filter's answer
NEAR = 4.0  # pixels: paint whose motion is averaged
BARE = 0.02  # of white: where there is less paint near, it tells little
MEAN_MOTION = 8.0  # a pixel of mean motion counts as much as this


@cache
def gabor_bank() -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Even and odd kernels of the 8 filters; the even ones are blind to a constant."""
    import cv2

    bank = []
    for width, wavelength in SCALES:
        for turn in np.arange(ORIENTATIONS) * np.pi / ORIENTATIONS:
            even, odd = (
                cv2.getGaborKernel((KERNEL, KERNEL), width, turn, wavelength, ELONGATION, phase, cv2.CV_32F)
                for phase in (0.0, np.pi / 2)
            )
            bank.append((even - even.mean(), odd))
    return tuple(bank)


def gabor(image: np.ndarray) -> np.ndarray:
    """Magnitude of the 8 responses (8, h / 2, w / 2) float32 of a patch (h, w) uint8: it hardly feels small shifts."""
    import cv2

    light = image.astype(np.float32) / 255
    size = (image.shape[1] // CELL, image.shape[0] // CELL)
    responses = []
    for even, odd in gabor_bank():
        power = cv2.magnitude(cv2.filter2D(light, -1, even), cv2.filter2D(light, -1, odd))
        responses.append(cv2.resize(power, size, interpolation=cv2.INTER_AREA))
    return np.stack(responses)


def hog(image: np.ndarray) -> np.ndarray:
    """Histograms of oriented gradients (D,) of a patch (h, w) uint8, cells of 8 pixels (Dalal and Triggs 2005)."""
    import cv2

    height, width = (8 * (n // 8) for n in image.shape)
    describe = cv2.HOGDescriptor((width, height), (16, 16), (8, 8), (8, 8), 9)
    return np.asarray(describe.compute(np.ascontiguousarray(image[:height, :width]))).ravel()


def edges(image: np.ndarray) -> np.ndarray:
    """Strength of the edges (h / 2, w / 2) float32 of a patch (h, w) uint8."""
    import cv2

    light = cv2.GaussianBlur(image.astype(np.float32) / 255, (0, 0), 1.0)
    strength = cv2.magnitude(cv2.Sobel(light, -1, 1, 0), cv2.Sobel(light, -1, 0, 1))
    return cv2.resize(strength, (image.shape[1] // CELL, image.shape[0] // CELL), interpolation=cv2.INTER_AREA)


def motion(image: np.ndarray, neutral: np.ndarray) -> np.ndarray:
    """How far the paint of a patch (h, w) uint8 has moved from the neutral one (h / 4, w / 4, 2), where it was.

    By dense inverse search (Kroeger et al. 2016, doi:10.1007/978-3-319-46493-0_29).
    """
    moved, paint = _moved(image, neutral, finest=1)
    return _coarse(moved * paint * MOTION)


def fine_motion(image: np.ndarray, neutral: np.ndarray) -> np.ndarray:
    """Motion to the last pixel, of thin strokes that move by one or two: the mean of the paint near each place.

    A mean, unlike a sum, does not tell how much paint is near, which differs from hand to hand (normalized
    convolution, Knutsson and Westin 1993, doi:10.1109/CVPR.1993.341081).
    """
    import cv2

    moved, paint = _moved(image, neutral, finest=0)
    total, amount = (cv2.GaussianBlur(values, (0, 0), NEAR) for values in (moved * paint, paint[..., 0]))
    return _coarse(total / (amount + BARE)[..., None] * MEAN_MOTION)


def _moved(image: np.ndarray, neutral: np.ndarray, finest: int) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel (h, w, 2) of a neutral patch has moved, and how much paint (h, w, 1) it bore, 0 to 1."""
    import cv2

    start, end = (cv2.GaussianBlur(picture, (0, 0), SOFT) for picture in (neutral, image))
    moved = np.asarray(_flow(finest).calc(start, end, None))  # pyright: ignore[reportCallIssue, reportArgumentType]
    return moved, start.astype(np.float32)[..., None] / 255


def _coarse(values: np.ndarray) -> np.ndarray:
    """Means (h / 4, w / 4, 2) of cells."""
    import cv2

    return cv2.resize(values, (values.shape[1] // COARSE, values.shape[0] // COARSE), interpolation=cv2.INTER_AREA)


@cache
def _flow(finest: int):
    """Dense inverse search whose pictures are halved `finest` times at least."""
    import cv2

    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    if finest == 0:
        flow.setFinestScale(0)
        flow.setGradientDescentIterations(16)
        flow.setVariationalRefinementIterations(0)  # it spreads motion to strokes that keep still
    return flow


LOOKS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {"gabor": gabor, "hog": hog, "edges": edges}
TRAVELS: Mapping[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "motion": motion, "fine": fine_motion,
}  # fmt: skip
FEATURES = (*LOOKS, *TRAVELS)


def check_features(kind: str) -> None:
    """Refuse features that nobody knows."""
    unknown = [part for part in kind.split("+") if part not in FEATURES]
    if unknown:
        raise InputError(f"The features {unknown[0]!r} are unknown; choose of {', '.join(FEATURES)}, joined by +.")


def features(images: Sequence[np.ndarray], neutral: Sequence[np.ndarray], kind: str = "gabor") -> np.ndarray:
    """Features (T, D) float32 of a region's patches, each (T, h, w) uint8, side by side; neutral ones are (h, w)."""
    check_features(kind)
    columns = []
    for part in kind.split("+"):
        for frames, rest in zip(images, neutral, strict=True):
            seen = [TRAVELS[part](frame, rest) if part in TRAVELS else LOOKS[part](frame) for frame in frames]
            columns.append(np.array(seen, dtype=np.float32).reshape(len(frames), -1))
    return np.concatenate(columns, axis=1)
