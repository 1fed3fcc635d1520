"""Films of an animation: in real time, and no smoother than an eye needs, for half the work."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from blendcap.data import Animation
    from blendcap.view import Film

FILM_SIZE = (960, 540)
MOST, ROUNDED = 30.0, 0.02  # pictures a second; a rate that is so much of it higher counts as it


def thin_film(animation: Animation, title: str = "") -> Film:
    """A film of an animation that leaves out frames until it has at most 30 pictures a second."""
    from blendcap.view import Film

    return Film(FILM_SIZE, title=title, every=max(1, ceil(animation.rate / MOST - ROUNDED)))


def writes(path: Path, film: Film, animation: Animation) -> str:
    """What is written, and which frames of the animation it shows."""
    if film.every == 1:
        return f"Write {path}"
    return f"Write {path}: one of {film.every} frames, {film.rate(animation):g} a second, in real time"
