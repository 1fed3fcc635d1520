"""How a template softens while it settles on a scan: the paper's schedule and the measured one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import InputError
from blendcap.data.checks import ANY, array


@dataclass(frozen=True)
class Schedule:
    """How stiff the template is, level by level, and when a level ends.

    Parameters
    ----------
    stiffness : (K,) float
        alpha, falling; the template is scaled to a size of 1, as in Amberg et al. (2007).
    landmarks : (K,) float
        beta of each level: a landmark counts as much as beta² vertices.
    even : bool
        Weigh each edge by one over its squared length, so that dense and coarse parts are equally stiff.
    memory : int
        Steps that the Anderson acceleration remembers; 0 is the plain iteration.
    tolerance : float
        A level ends when vertices move less than this in a step (root mean square), as a share of the template's size.
    steps : int
        The most steps of a level. Where a scan ends, matches beyond its border are not believed, and a stiff template
        that goes on for long slides over it.
    cosine : float
        The least cosine between the normals of a vertex and of its match.
    reach : float
        The largest distance of a match, as a share of the template's size.
    triangles : bool
        Match to the closest point of the triangles; otherwise to the closest vertex.
    coarse : float
        Levels at least this stiff have one map for about seven vertices, blended between, instead of one for each:
        as long as the template is stiff the answer is nearly the same, in a fraction of the time.
    """

    stiffness: tuple[float, ...] = (13.0, 6.5, 2.6, 1.3, 0.65)
    landmarks: tuple[float, ...] = (10.0, 5.0, 3.0, 1.5, 1.0)
    even: bool = True
    memory: int = 5
    tolerance: float = 7e-5
    steps: int = 12
    cosine: float = 0.5
    reach: float = 0.05
    triangles: bool = True
    coarse: float = 2.6

    def __post_init__(self) -> None:
        for name in ("stiffness", "landmarks"):
            levels = array(getattr(self, name), (ANY,), f"The {name} of a schedule", finite=True)
            object.__setattr__(self, name, tuple(levels.tolist()))
        if not self.stiffness or len(self.stiffness) != len(self.landmarks):
            raise InputError(
                f"A schedule has {len(self.stiffness)} levels of stiffness and {len(self.landmarks)} of landmarks; "
                "give one of each for every level, and at least one level."
            )
        _within("stiffness", self.stiffness, 1e-12, np.inf)
        _within("landmarks", self.landmarks, 0, np.inf)
        _within("steps", (self.steps,), 1, np.inf, whole=True)
        _within("memory", (self.memory,), 0, np.inf, whole=True)
        _within("tolerance", (self.tolerance,), 1e-15, 1)
        _within("reach", (self.reach,), 1e-12, np.inf)
        _within("coarse", (self.coarse,), 0, np.inf)
        _within("cosine", (self.cosine,), -1, 1)


def _within(name: str, values: tuple, least: float, most: float, *, whole: bool = False) -> None:
    kinds = (int, np.integer) if whole else (int, float, np.number)
    for value in values:
        if isinstance(value, bool) or not isinstance(value, kinds) or not least <= value <= most:
            limits = f"at least {least:g}" if most == np.inf else f"within {least:g} and {most:g}"
            number = "a whole number" if whole else "a number"
            raise InputError(f"The {name} of a schedule must be {number}, {limits}, but is {value!r}.")


SCHEDULES = {
    "even": Schedule(),
    "paper": Schedule(
        stiffness=(50.0, 20.0, 5.0, 2.0, 0.8, 0.5, 0.35, 0.2), landmarks=(5.0, 2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0),
        even=False, memory=0, tolerance=1e-3, steps=10, cosine=0.7, triangles=False, coarse=np.inf),
}  # fmt: skip


def schedule_of(method: str | Schedule) -> Schedule:
    """A schedule by its name, or as given."""
    if isinstance(method, Schedule):
        return method
    if method not in SCHEDULES:
        raise InputError(f"The registration method {method!r} is unknown; choose one of {', '.join(SCHEDULES)}.")
    return SCHEDULES[method]
