"""What a detector of points in pictures has learned from annotated examples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from blendcap.data import checks
from blendcap.data.errors import InputError


@dataclass(frozen=True, eq=False)
class LandmarkModel:
    """Filters over histograms of oriented gradients, how they score, and where the points use to lie.

    Parameters
    ----------
    names : (L,) str
        One a point.
    filters : (L, K, D) float32
        K filters a point; a score is the product of a filter with a descriptor of D numbers.
    good, bad : (L, 2) float64
        Mean and deviation of the scores at the point and elsewhere.
    mean : (L, 2) float64
        Where the point lies on average, pixels.
    covariance : (L, 2, 2) float64
        How that varies, pixels squared.
    size : (2,) int64
        Width and height of the pictures, pixels.
    cells, cell : int
        A descriptor sees a square of `cells` x `cells` cells of `cell` pixels.
    channels : int
        Of the pictures.
    places : (L, 3) float64, optional
        Where the points lie on an average face, mm.

    Raises
    ------
    InputError
        If a shape is wrong or a number is not finite.
    """

    names: tuple[str, ...]
    filters: np.ndarray
    good: np.ndarray
    bad: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    size: np.ndarray
    cells: int
    cell: int
    channels: int = 1
    places: np.ndarray | None = None

    def __post_init__(self):
        put = object.__setattr__
        put(self, "names", checks.names(self.names, "The landmark model's names"))
        count = len(self.names)
        for name in ("cells", "cell", "channels"):
            put(self, name, int(getattr(self, name)))
            if not 1 <= getattr(self, name) <= 64:
                raise InputError(f"The landmark model's {name} is {getattr(self, name)}; it must be between 1 and 64.")
        shapes = {"good": (count, 2), "bad": (count, 2), "mean": (count, 2), "covariance": (count, 2, 2)}
        for name, shape in shapes.items():
            put(self, name, checks.array(getattr(self, name), shape, f"The landmark model's {name}", finite=True))
        shape = (count, checks.ANY, self.channels * self.cells**2 * 9)
        filters = checks.array(self.filters, shape, "The landmark model's filters", dtype=np.float32, finite=True)
        put(self, "filters", filters)
        put(self, "size", checks.array(self.size, (2,), "The landmark model's size", dtype=np.int64))
        if self.places is not None:
            put(self, "places", checks.array(self.places, (count, 3), "The landmark model's places", finite=True))

    def arrays(self) -> dict[str, np.ndarray]:
        """The model as arrays by name, for a file; filters at half precision."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        arrays = {name: np.asarray(value) for name, value in values.items() if value is not None}
        arrays["names"] = np.array(self.names, dtype=np.str_)
        arrays["filters"] = self.filters.astype(np.float16)
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> LandmarkModel:
        """The model that `arrays` wrote down."""
        known = {f.name for f in fields(cls)}
        given = {name: value for name, value in arrays.items() if name in known}
        missing = sorted(known - set(given) - {"places"})
        if missing:
            raise InputError(f"The landmark model lacks {', '.join(missing)}; train it again.")
        names = tuple(str(name) for name in np.asarray(given.pop("names")))
        return cls(names=names, **given)
