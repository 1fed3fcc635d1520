"""Learn a detector of points from pictures with rectangles around them (section 3.2.2 of the thesis)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from blendcap.data import InputError, LandmarkModel
from blendcap.modeling.hog import cell_maps, describe

EXEMPLARS = 30  # pictures whose own descriptors become filters, in the thesis' way
ELSEWHERE = 120  # wrong places looked at in each picture
SPREAD = 0.002  # least deviation of the prior, of the picture's width
RIDGE = 0.05  # of the mean variance, added to the covariance of descriptors


def train_landmarks(
    images: Sequence[np.ndarray],
    rectangles: Sequence[Mapping[str, Sequence[float]]],
    *,
    method: str = "discriminant",
    cells: int = 4,
    cell: int = 8,
    radius: float = 0.02,
    places: np.ndarray | None = None,
    seed: int = 0,
) -> LandmarkModel:
    """Learn to find points from annotated pictures.

    Parameters
    ----------
    images : sequence of (H, W) or (H, W, C)
        Pictures of one size, uint8 or 0 to 1.
    rectangles : sequence of {name: (left, top, width, height)}
        For each picture a rectangle, pixels, centered on each point; every picture has the same names.
    method : "discriminant" or "exemplars"
        One filter a point, which tells the right places from all others (linear discriminant); or the thesis' way,
        the descriptors of up to 30 pictures themselves.
    cells, cell : int
        A descriptor sees `cells` x `cells` cells of `cell` pixels; the thesis' HOG of size 32 is 4 x 8.
    radius : float
        Of the pictures' width: a place this near to a rectangle's middle is a right one; the thesis' 20 pixels in 1024.
    places : (L, 3), optional
        Where the points lie on an average face, mm.
    seed : int
        Of the wrong places.

    Raises
    ------
    InputError
        If there are too few pictures, they differ in size, or a rectangle is missing or outside.
    """
    if method not in ("discriminant", "exemplars"):
        raise InputError(f"There is no way of training called {method!r}; choose discriminant or exemplars.")
    pictures, names, centers = _checked(images, rectangles)
    rng = np.random.default_rng(seed)
    height, width, channels = pictures[0].shape
    examples = [_examples(p, c, (cells, cell), radius * width, rng) for p, c in zip(pictures, centers, strict=True)]
    if method == "exemplars":
        filters = np.stack([right[:, 0] for right, _ in examples[:EXEMPLARS]], 1)
    else:
        filters = _discriminants(examples)[:, None]
    good, bad = _score_models(examples, filters)
    mean = centers.mean(0)
    off = centers - mean
    covariance = np.einsum("pli,plj->lij", off, off) / len(centers) + (SPREAD * width) ** 2 * np.eye(2)
    return LandmarkModel(
        names=names, filters=filters, good=good, bad=bad, mean=mean, covariance=covariance,
        size=np.array([width, height]), cells=cells, cell=cell, channels=channels, places=places,
    )  # fmt: skip


def as_picture(image: np.ndarray) -> np.ndarray:
    """An image as (H, W, C) float32, 0 to 1; colors of uint8 become one channel of brightness."""
    image = np.asarray(image)
    if image.dtype == np.uint8:
        image = image.astype(np.float32) / 255
        if image.ndim == 3:
            image = image[..., :3].mean(2) if image.shape[2] >= 3 else image[..., 0]
    return (image[..., None] if image.ndim == 2 else image).astype(np.float32)


def _checked(images, rectangles) -> tuple[list[np.ndarray], tuple[str, ...], np.ndarray]:
    pictures = [as_picture(image) for image in images]
    if len(pictures) < 2 or len(pictures) != len(rectangles):
        raise InputError(
            f"There are {len(pictures)} pictures and {len(rectangles)} sets of rectangles; training needs as many of "
            "one as of the other, and at least 2."
        )
    if len({picture.shape for picture in pictures}) > 1:
        raise InputError("The pictures for training differ in size or channels; resize them to one size first.")
    names = tuple(rectangles[0])
    if not names:
        raise InputError("The first picture has no rectangles; annotate each picture with the same names.")
    centers = np.empty((len(pictures), len(names), 2))
    height, width = pictures[0].shape[:2]
    for n, own in enumerate(rectangles):
        if set(own) != set(names):
            odd = sorted(set(own) ^ set(names))[0]
            raise InputError(f"Picture {n} differs from the first in having a rectangle {odd!r}; give all of them one.")
        box = np.array([own[name] for name in names], dtype=np.float64)
        if box.shape != (len(names), 4):
            raise InputError(f"A rectangle of picture {n} is not (left, top, width, height); give four numbers.")
        centers[n] = box[:, :2] + (box[:, 2:] - 1) / 2
        outside = ((centers[n] < 0) | (centers[n] > [width - 1, height - 1])).any(1)
        if outside.any() or not np.isfinite(box).all():
            raise InputError(f"The rectangle {names[int(outside.argmax())]!r} of picture {n} lies outside of it.")
    return pictures, names, centers


def _examples(picture, centers, square, radius, rng) -> tuple[np.ndarray, np.ndarray]:
    """Descriptors (L, 5, D) of right places, the first at the point itself, and (L, M, D) of wrong ones."""
    maps = cell_maps(picture, square[1])
    height, width = picture.shape[:2]
    near = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * max(0.1 * radius, 1)
    right = describe(maps, (centers[:, None] + near).reshape(-1, 2), *square).reshape(len(centers), len(near), -1)
    anywhere = rng.uniform(0, [width - 1, height - 1], size=(ELSEWHERE // 2, 2))
    turn = rng.uniform(0, 2 * np.pi, ELSEWHERE // 2)
    around = np.stack([np.cos(turn), np.sin(turn)], 1) * radius * rng.uniform(1, 4, (len(turn), 1))
    wrong = []
    for center in centers:
        spots = np.concatenate([anywhere, center + around])
        far = ((spots - center) ** 2).sum(1) > radius**2
        spots = spots[np.resize(np.flatnonzero(far), len(spots))]
        wrong.append(describe(maps, spots, *square))
    return right, np.stack(wrong)


def _discriminants(examples) -> np.ndarray:
    """Filters (L, D) that tell right from wrong places: the difference of means, whitened by the wrong ones."""
    right = np.concatenate([r for r, _ in examples], 1).astype(np.float64)
    wrong = np.concatenate([w for _, w in examples], 1).astype(np.float64)
    filters = []
    for own, other in zip(right, wrong, strict=True):
        off = np.concatenate([own - own.mean(0), other - other.mean(0)])
        covariance = off.T @ off / len(off)
        ridge = RIDGE * np.trace(covariance) / len(covariance)
        direction = np.linalg.solve(covariance + ridge * np.eye(len(covariance)), own.mean(0) - other.mean(0))
        filters.append(direction / np.linalg.norm(direction))
    return np.array(filters, dtype=np.float32)


def _score_models(examples, filters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (L, 2) of the scores at right and at wrong places."""
    models = []
    for kind in (0, 1):
        values = np.concatenate([np.einsum("lpd,lkd->lpk", e[kind], filters).reshape(len(filters), -1)
                                 for e in examples], 1)  # fmt: skip
        models.append(np.stack([values.mean(1), np.maximum(values.std(1), 1e-6)], 1))
    return models[0], models[1]
