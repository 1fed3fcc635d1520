"""What is solved: files that are tried before the work; what could not serve is refused, what looks odd is said."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from cyclopts import Parameter

import blendcap
from blendcap.cli.progress import Progress

if TYPE_CHECKING:
    from blendcap import SolveSettings
    from blendcap.data import Animation, Binding, MarkerTake, PaintTracks, Rig

FIRST = 10  # frames that are looked at
FACE_MM = 40.0, 500.0  # the widest side of the box around markers of a face, those on a helmet too

log = logging.getLogger(__name__)


@Parameter(name="*")
@dataclass(frozen=True)
class Inputs:
    """The files beside the take."""

    rig: Path
    """The rig: .glb, .npz, a folder of .obj files or an ICT-FaceKit folder."""
    rom: Path | None = None
    """A range-of-motion take of the same markers; it places the markers on the rig more exactly."""
    correspondences: Path | None = None
    """A .json that says where each marker sits: {"NoseTip": 4321, "ChinL": "landmarks68/9"}. Found from the shape of
    the marker cloud if not given: check the picture then."""
    patches: Path | None = None
    """A .csv of curves by shape names that makeup patches tell, from `blendcap facs predict`: the hybrid solve."""
    patches_offset: float | None = None
    """Seconds by which the video of the patches begins after the take; needed only if they differ in length."""
    tracks: Path | None = None
    """A .npz of paint that was followed between the markers, from `blendcap facs track`."""
    unit: Literal["mm", "cm", "dm", "m", "in", "ft"] | None = None
    """The unit of the take, in place of the one that the file states."""

    @property
    def files(self) -> tuple[Path | None, ...]:
        """All that is read."""
        return self.rig, self.rom, self.correspondences, self.patches, self.tracks

    def read(self, take: Path, settings: SolveSettings, progress: Progress) -> Given:
        """Read everything, and refuse what could not serve."""
        from blendcap.io import read_animation, read_correspondences, read_markers, read_rig, read_tracks

        if self.patches is None and self.patches_offset is not None:
            raise blendcap.InputError(
                "--patches-offset says when the curves of --patches begin; give these, or leave it out."
            )
        with progress.step("read", "Read the rig and the take"):
            rig, markers = read_rig(self.rig), read_markers(take, unit=self.unit)
            motion = None if self.rom is None else read_markers(self.rom, unit=self.unit)
            places = None if self.correspondences is None else read_correspondences(self.correspondences)
            curves = None if self.patches is None else read_animation(self.patches)
            followed = None if self.tracks is None else read_tracks(self.tracks)
        check_inputs(take, markers, rig, places, settings)
        return Given(rig, markers, places, motion, curves, self.patches_offset, followed)


class Given(NamedTuple):
    """What was read."""

    rig: Rig
    take: MarkerTake
    places: Mapping[str, Any] | None = None
    motion: MarkerTake | None = None
    curves: Animation | None = None
    offset: float | None = None
    tracks: PaintTracks | None = None

    @property
    def paint(self) -> dict[str, Any]:
        """What `solve` takes of the paint."""
        return {"patches": self.curves, "patches_offset": self.offset, "tracks": self.tracks}

    def bound(self, progress: Progress) -> Binding:
        """The markers on the rig."""
        with progress.step("bind", "Place the markers on the rig") as tell:
            return blendcap.bind(self.rig, self.take, self.places, self.motion, progress=tell)


def check_inputs(
    path: Path, take: MarkerTake, rig: Rig, places: Mapping[str, Any] | None, settings: SolveSettings
) -> None:
    """Check a take that was read from `path`, and what it is to be solved with.

    Raises
    ------
    InputError
        If a place is a landmark and the rig has none, or a stable marker could not be used.
    """
    from blendcap.data import landmarks68

    if any(str(place).startswith("landmarks68/") for place in (places or {}).values()):
        landmarks68(rig)  # says how to give it some
    if settings.stable:
        known = [name for name in take.names if places is None or name in places]
        _check_stable(settings, take.names, known)
    _check_size(path, take)


def _check_stable(settings: SolveSettings, names: tuple[str, ...], bound: list[str]) -> None:
    from blendcap.data.names import listed

    if settings.head == "keep":
        raise blendcap.InputError("--stable says how to remove the head's motion, and --head keep not to; choose one.")
    for name in settings.stable:
        if name not in bound:
            lacks = "has no correspondence" if name in names else "the take does not have"
            close = get_close_matches(name, bound, 1)
            hint = f"do you mean {close[0]!r}?" if close else f"there are {listed(bound, 12)}."
            raise blendcap.InputError(f"--stable names the marker {name!r}, which {lacks}; {hint}")
    if len(settings.stable) < 3:
        raise blendcap.InputError(
            f"--stable names only {len(settings.stable)}; to find the head takes at least three markers."
        )


def _check_size(path: Path, take: MarkerTake) -> None:
    """Warn of markers in a box that no face fills, as in a wrong unit."""
    import numpy as np

    first = take.positions[:FIRST]
    seen = first[np.isfinite(first).all(2)]
    if len(seen) and not FACE_MM[0] <= (widest := float(np.ptp(seen, axis=0).max())) <= FACE_MM[1]:
        log.warning("The markers of %s span %.0f mm, which is no face: if its unit is wrong, say --unit.", path, widest)
