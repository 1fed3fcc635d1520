"""What can be chosen about a solve."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from numbers import Real

from blendcap.data import InputError
from blendcap.data.checks import names
from blendcap.solving.curves import CURVE_ERROR
from blendcap.solving.noise import MODEL_ERROR
from blendcap.solving.paper import BETA, GAMMA, INFLUENCE
from blendcap.solving.prior import SYMMETRY

METHODS = ("learned", "paper", "live")
METHODS_OF = {  # the methods that a setting belongs to, where it does not belong to all
    "smoothness": ("learned", "live"),
    "curve_error": ("learned", "live"),
    "symmetry": ("learned", "live"),
    "passes": ("learned",),
    "beta": ("paper",),
    "gamma": ("paper",),
    "coupling": ("paper",),
    "influence": ("paper",),
}
HELMETS = ("rigid", "paper", "none")
LARGEST = 1e6  # of a setting, in its unit: above it nothing moves
MOST_PASSES = 100
LEAST_CURVE_ERROR = 1e-3
HEADS = ("auto", "remove", "keep")


@dataclass(frozen=True)
class SolveSettings:
    """Choices of a marker solve; the defaults are what we recommend.

    Parameters
    ----------
    method : {"learned", "paper", "live"}
        "learned": exact whole-take solves whose prior and dynamics are learned from the take itself.
        "paper": Eq. 3 of the 2016 paper (Eq. 33 of the thesis), every frame on its own.
        "live": as learned, but with the past only (the noise is that of the first second): gaps are not bridged, and
        the head's motion is removed only if `stable` names its markers.
    smoothness : float
        Factor on the learned coupling of neighbouring frames (learned, live): 1 as learned, 0 none.
    beta : float
        β of Eq. 3, mm² (paper): the cost of the sum of weights. The larger, the sparser and the more muted.
    gamma : float
        ε of Γ = εI in Eq. 3, mm² (paper): keeps the optimum unique.
    coupling : float
        λ of λ |a_t - a_(t-1)|² added to Eq. 3, mm² (paper); 0 is the paper's.
    helmet : {"rigid", "paper", "none"}
        Motion of the helmet against the head: six signed unknowns, the thesis' twelve dummy shapes (Eq. 34 to 37),
        or none.
    head : {"auto", "remove", "keep"}
        Large head motion, found from stable markers and returned on its own: removed if there is any, always, or never.
    stable : (K,) str
        Names of markers that do not move with the face; found from the take if empty.
    longest_gap : float
        Seconds; shorter gaps of a marker are filled before the solve, longer ones stay missing, and so do longer ones
        that other software filled.
    noise : float, optional
        Standard deviation of a marker coordinate, mm; estimated from the take if not given.
    model_error : float
        Standard deviation of what the rig cannot explain, mm; added to the noise, so that a clean take is not
        over-fitted.
    symmetry : float
        Correlation of left and right partners before the take is seen (learned, live), 0 to 0.99.
    influence : float
        Largest γ of Eq. 4, mm² (paper): how much a fully trusted curve of the makeup patches counts.
    curve_error : float
        Standard deviation of a fully trusted curve (learned, live), weight units: the smaller, the more it counts.
    passes : int
        Solves of the whole take (learned); the prior is re-estimated between them.

    Raises
    ------
    InputError
        If a name is unknown, a number is out of its range, or a setting belongs to another method.
    """

    method: str = "learned"
    smoothness: float = 1.0
    beta: float = BETA
    gamma: float = GAMMA
    coupling: float = 0.0
    helmet: str = "rigid"
    head: str = "auto"
    stable: tuple[str, ...] = ()
    longest_gap: float = 0.1
    noise: float | None = None
    model_error: float = MODEL_ERROR
    symmetry: float = SYMMETRY
    influence: float = INFLUENCE
    curve_error: float = CURVE_ERROR
    passes: int = 3

    def __post_init__(self):
        for name, known in (("method", METHODS), ("helmet", HELMETS), ("head", HEADS)):
            if getattr(self, name) not in known:
                raise InputError(f"The {name} {getattr(self, name)!r} is unknown; choose one of {', '.join(known)}.")
        for name in ("smoothness", "beta", "gamma", "coupling", "longest_gap", "model_error", "influence"):
            value = getattr(self, name)
            if not (_is_number(value) and value >= 0):
                raise InputError(f"The setting {name} must be a number that is not negative, but is {value!r}.")
        if self.noise is not None and not (_is_number(self.noise) and self.noise > 0):
            raise InputError(
                f"The noise must be a positive number of mm, but is {self.noise!r}; leave it out if unknown."
            )
        for name in ("smoothness", "coupling", "noise", "model_error", "beta", "gamma", "influence"):
            value = getattr(self, name)
            if value is not None and value > LARGEST:
                raise InputError(f"The setting {name} is {value:g}, which is out of range; {LARGEST:g} is the most.")
        if not (_is_number(self.curve_error) and self.curve_error >= LEAST_CURVE_ERROR):
            raise InputError(
                f"The curve error must be at least {LEAST_CURVE_ERROR:g}, but is {self.curve_error!r}; 0.1 is usual."
            )
        if not (_is_number(self.symmetry) and 0 <= self.symmetry <= 0.99):
            raise InputError(f"The symmetry must lie between 0 and 0.99, but is {self.symmetry!r}.")
        if isinstance(self.passes, bool) or not (isinstance(self.passes, int) and 1 <= self.passes <= MOST_PASSES):
            raise InputError(
                f"A solve needs a whole number of passes from 1 to {MOST_PASSES}, but passes is {self.passes!r}."
            )
        for name, methods in METHODS_OF.items():
            if self.method not in methods and getattr(self, name) != getattr(SolveSettings, name):
                owners = " or ".join(methods)
                raise InputError(
                    f"The setting {name} belongs to the method {owners}, not to {self.method}; leave it out."
                )
        object.__setattr__(self, "stable", names(self.stable, "The stable markers"))

    def as_text(self) -> dict[str, str]:
        """The settings as names and texts, for a report."""
        return {f.name: str(getattr(self, f.name)) for f in fields(self)}


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
