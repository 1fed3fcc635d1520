"""What a classifier sees of a patch: responses of Gabor filters, oriented gradients, edges, or how the strokes moved.

Section 7.2.2 of Reading Between the Dots (2016), section 4.1.10 of the thesis: 8 filters, 2 scales, 4 orientations.
How far each stroke has moved is ours: it follows a weight in proportion, which the look of a patch does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from threading import local

import numpy as np

from blendcap.data import InputError
from blendcap.makeup.threads import in_threads

See = Callable[[np.ndarray], np.ndarray]  # from a patch (h, w) uint8 to what is seen of it

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
TOGETHER = 16  # frames that a thread looks at before it asks for more
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


def motion(neutral: np.ndarray) -> See:
    """How far the paint of a patch (h, w) uint8 has moved from the neutral one (h / 4, w / 4, 2), where it was.

    By dense inverse search (Kroeger et al. 2016, doi:10.1007/978-3-319-46493-0_29).
    """
    start = _soft(neutral)
    weight = _paint(start) * MOTION
    return lambda image: _coarse(_moved(start, image, finest=1) * weight)


def fine_motion(neutral: np.ndarray) -> See:
    """Motion to the last pixel, of thin strokes that move by one or two: the mean of the paint near each place.

    A mean, unlike a sum, does not tell how much paint is near, which differs from hand to hand (normalized
    convolution, Knutsson and Westin 1993, doi:10.1109/CVPR.1993.341081).
    """
    import cv2

    start = _soft(neutral)
    paint = _paint(start)
    scale = MEAN_MOTION / (cv2.GaussianBlur(paint, (0, 0), NEAR) + BARE)[..., None]
    return lambda image: _coarse(cv2.GaussianBlur(_moved(start, image, finest=0) * paint, (0, 0), NEAR) * scale)


def _soft(image: np.ndarray) -> np.ndarray:
    import cv2

    return cv2.GaussianBlur(image, (0, 0), SOFT)


def _paint(soft: np.ndarray) -> np.ndarray:
    """How much paint (h, w, 1) each pixel of a soft neutral patch bears, 0 to 1."""
    return soft.astype(np.float32)[..., None] / 255


def _moved(start: np.ndarray, image: np.ndarray, finest: int) -> np.ndarray:
    """How far each pixel (h, w, 2) of a soft neutral patch has moved."""
    return np.asarray(_flow(finest).calc(start, _soft(image), None))  # pyright: ignore[reportCallIssue, reportArgumentType]


def _coarse(values: np.ndarray) -> np.ndarray:
    """Means (h / 4, w / 4, 2) of cells."""
    import cv2

    return cv2.resize(values, (values.shape[1] // COARSE, values.shape[0] // COARSE), interpolation=cv2.INTER_AREA)


def _flow(finest: int):
    """Dense inverse search whose pictures are halved `finest` times at least: each thread has its own."""
    flows = _of_thread.__dict__.setdefault("flows", {})
    if finest not in flows:
        flows[finest] = _new_flow(finest)
    return flows[finest]


_of_thread = local()


def _new_flow(finest: int):
    import cv2

    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    if finest == 0:
        flow.setFinestScale(0)
        flow.setGradientDescentIterations(16)
        flow.setVariationalRefinementIterations(0)  # it spreads motion to strokes that keep still
    return flow


LOOKS: Mapping[str, See] = {"gabor": gabor, "hog": hog, "edges": edges}
TRAVELS: Mapping[str, Callable[[np.ndarray], See]] = {"motion": motion, "fine": fine_motion}  # from a neutral patch
FEATURES = (*LOOKS, *TRAVELS)


def check_features(kind: str) -> None:
    """Refuse features that nobody knows."""
    unknown = [part for part in kind.split("+") if part not in FEATURES]
    if unknown:
        raise InputError(f"The features {unknown[0]!r} are unknown; choose of {', '.join(FEATURES)}, joined by +.")


def features(images: Sequence[np.ndarray], neutral: Sequence[np.ndarray], kind: str = "gabor") -> np.ndarray:
    """Features (T, D) float32 of a region's patches, each (T, h, w) uint8, side by side; neutral ones are (h, w)."""
    check_features(kind)
    columns = [
        (frames, TRAVELS[part](rest) if part in TRAVELS else LOOKS[part])
        for part in kind.split("+")
        for frames, rest in zip(images, neutral, strict=True)
    ]

    def rows(start: int) -> np.ndarray:
        parts = [[see(frame) for frame in frames[start : start + TOGETHER]] for frames, see in columns]
        return np.concatenate([np.array(part, dtype=np.float32).reshape(len(part), -1) for part in parts], axis=1)

    return np.concatenate(in_threads(rows, range(0, len(images[0]), TOGETHER)))
