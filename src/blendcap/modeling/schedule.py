"""How a template softens while it settles on a scan: the paper's schedule and the measured one."""

from __future__ import annotations

from dataclasses import dataclass

from blendcap.data import InputError


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
        The most steps of a level; nearly all end after fewer than 15.
    cosine : float
        The least cosine between the normals of a vertex and of its match.
    reach : float
        The largest distance of a match, as a share of the template's size.
    triangles : bool
        Match to the closest point of the triangles; otherwise to the closest vertex.
    """

    stiffness: tuple[float, ...] = (13.0, 6.5, 2.6, 1.3, 0.65)
    landmarks: tuple[float, ...] = (10.0, 5.0, 3.0, 1.5, 1.0)
    even: bool = True
    memory: int = 5
    tolerance: float = 1e-4
    steps: int = 60
    cosine: float = 0.5
    reach: float = 0.05
    triangles: bool = True


SCHEDULES = {
    "even": Schedule(),
    "paper": Schedule(
        stiffness=(50.0, 20.0, 5.0, 2.0, 0.8, 0.5, 0.35, 0.2), landmarks=(5.0, 2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0),
        even=False, memory=0, tolerance=1e-3, steps=10, cosine=0.7, triangles=False),
}  # fmt: skip


def schedule_of(method: str | Schedule) -> Schedule:
    """A schedule by its name, or as given."""
    if isinstance(method, Schedule):
        return method
    if method not in SCHEDULES:
        raise InputError(f"The registration method {method!r} is unknown; choose one of {', '.join(SCHEDULES)}.")
    return SCHEDULES[method]
