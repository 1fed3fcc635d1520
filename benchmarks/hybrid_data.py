"""Takes with painted patches and known truth, for `hybrid.py`: lessons, tests and real performances on two faces.

One performer of each face is the teacher. What was tuned (regions, thresholds, windows) was tuned on the mannequins 1
and 5; reported are the teacher's unseen takes, two other people of each face, and all real performances.

Markers lie between the paint, as in the papers: a marker that is glued on a stroke hides it, and nobody glues markers
on lids (54 markers on the upper face did not see them shut, section 8 of Reading Between the Dots, 2016). Only the
lessons have markers on lids and paint too, once: their solve gives the intensities to learn.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

import blendcap
from accuracy_data import DATA, MM, performance
from blendcap import Animation, Binding, Camera, MarkerTake, Rig, SolveSettings, SurfacePoints
from blendcap.data import landmarks68
from blendcap.data.names import match
from blendcap.makeup.lesson import Lesson
from blendcap.makeup.patches import Patches, extract_patches
from blendcap.makeup.setup import locate
from blendcap.makeup.units import ARKIT_TABLE
from blendcap.modeling.contacts import find_contacts
from blendcap.numerics.similarity import apply
from blendcap.synthetic.exercises import TRAINED, Exercise, action_units, frown, lip_swing
from blendcap.synthetic.head_camera import film_head, mount_head_camera, slip_matrices
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.paint import Stroke
from blendcap.synthetic.performances import for_rig
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.shot import Shot
from blendcap.synthetic.takes import SKIN, Truth, choose_points, make_take
from ict_people import with_seated_eyes

RATE = 24.0  # of the exercises
LESSON_RATE = 12.0  # of the lessons: frames that are far apart teach more
MORE = ("1", "2", "5", "6", "10", "12", "15", "20", "26", "63", "64")  # units that the papers' lesson lacks
SCAN = 0.5  # mm by which the neutral of the solver's rig errs, as smooth as faces differ
REACH = 10.0  # mm from a vertex to the regions of the bent mannequin
APART = 3.0  # mm from the middle of a stroke to that of a marker, at least
SHARED = "lip_red"  # paint that gives way to markers: lips bear both
ASIDE = {"10L+12L+18L+23L": "AU10+12+18+23L", "10R+12R+18R+23R": "AU10+12+18+23R"}
UNITS = tuple(ASIDE.get(unit, f"AU{unit}") for unit in TRAINED)
PEOPLE = {"mannequin": (1, 31, 32), "ICT": (101, 121, 122)}  # the first is the teacher
PLAYED = {"mannequin": ("alexdjulin_alex_rom_3.csv", 3300, 3700), "ICT": ("alexdjulin_alex_rom_3.csv", 3630, 4030)}


@cache
def given(kind: str, person: int) -> Rig:
    """The rig that the solver has: the template's shapes carried to a neutral that the scan got 0.5 mm wrong."""
    own, template = face(kind, person), face(kind, 0)
    error = face(kind, person + 1000).mesh.vertices - face(kind, person + 2000).mesh.vertices
    error -= error.mean(0)
    error *= SCAN / np.sqrt((error**2).sum(1).mean())
    return replace(blendcap.transfer_rig(template, own.mesh.with_vertices(own.mesh.vertices + error)), name=own.name)


@cache
def face(kind: str, person: int) -> Rig:
    """The rig of a person with ARKit's shapes; 0 is the template."""
    if kind == "mannequin":
        return blendcap.mannequin(person, shapes=52)
    if person == 0:
        rig = blendcap.read_rig(DATA / "rigs" / "ict_facekit.npz")
        return replace(rig, regions={**rig.regions, **_regions(rig)}, contacts=find_contacts(rig), name="ICT 0")
    template = face(kind, 0)
    with np.load(DATA / "rigs" / "ict_facekit.npz", allow_pickle=False) as file:
        modes = file["identity_deltas"]
        shift = MM * np.tensordot(np.random.default_rng(person).normal(size=len(modes)), modes, axes=1)
    return replace(with_seated_eyes(template, template.mesh.vertices + shift), name=f"ICT {person}")


def _regions(rig: Rig) -> dict[str, np.ndarray]:
    """The mannequin's regions of skin on a face without such: each vertex goes with the nearest of a bent mannequin."""
    other = face("mannequin", 0)
    marks, goal = (landmarks68(r).positions(r.mesh)[:60] for r in (other, rig))  # inner lips coincide
    labels = np.concatenate([np.full(len(other.regions[name]), k) for k, name in enumerate(SKIN)])
    bent = RBFInterpolator(marks, goal)(other.mesh.vertices[np.concatenate([other.regions[name] for name in SKIN])])
    skin = rig.regions["face"]
    far, nearest = cKDTree(bent).query(rig.mesh.vertices[skin])
    return {name: skin[(labels[nearest] == k) & (far < REACH)] for k, name in enumerate(SKIN)}


Spoil = Callable[[int, int, np.ndarray], np.ndarray]  # camera, frame number, picture


@dataclass(frozen=True)
class Filmed:
    """A take, its truth, and what four head cameras saw of it."""

    rig: Rig  # the solver's
    own: Rig  # the performer's face, on which markers are placed
    acted: Animation  # without the neutral frames that every take begins with
    take: MarkerTake
    truth: Truth
    binding: Binding
    patches: Patches
    makeup: Sequence[Stroke]
    seed: int
    cameras: Sequence[Camera]
    frames: np.ndarray | None  # (C, T, H, W) uint8 on disk, as they were before they were spoilt; None if not kept
    spoil: Spoil | None

    def judge(self, rig: Rig) -> Rig:
        """A rig's shapes on the performer's own neutral: the scan's error is not charged to the solve."""
        return replace(rig, mesh=self.own.mesh)

    def videos(self) -> list[Iterator[np.ndarray]]:
        """The kept frames, camera by camera."""
        return _spoilt(self.frames, self.spoil)


def film(
    kind: str, person: int, animation: Animation, seed: int, cache_folder: Path, name: str, *,
    flaw: str = "", spoil: Spoil | None = None, bump: float = 0.0, spread: bool = False, keep: bool = False,
) -> Filmed:  # fmt: skip
    """Film a performer with four head cameras and cut the patches; what was cut is kept, and if asked for the frames.

    Whoever spoils a film keeps its frames.
    """
    own, rig = face(kind, person), given(kind, person)
    performer = make_performer(own, seed=person)
    makeup = draw_makeup(performer.rig, seed=seed)
    points = choose_points(own, 50, seed=seed) if spread else between(own, makeup, 50, seed)
    take, truth = make_take(performer, animation, points, seed=seed)
    if bump:
        take, truth = _bumped(take, truth, bump)
    binding = blendcap.bind(rig, take, points)
    key, helmet = _key(performer.rig, take, animation, makeup), mount_head_camera(performer.rig, seed=seed)
    shoot = partial(film_head, truth, helmet, seed=seed, makeup=makeup)
    frames = _kept(cache_folder / f"{name}-{key}.frames.npy", shoot) if keep else None
    path = cache_folder / f"{name}{flaw}-{key}.npz"
    if not path.exists():
        setup = locate(rig, take, binding, helmet.cameras, [helmet.size] * len(helmet.cameras))
        videos = [shot.frames() for shot in shoot()] if frames is None else _spoilt(frames, spoil)
        cut = extract_patches(videos, setup.places, setup.anchors, take.rate, dots=setup.dots, dot_radius=6.0)
        np.savez_compressed(path, sure=cut.sure, **cut.images)
    with np.load(path, allow_pickle=False) as file:
        images = {key: file[key] for key in file.files if key != "sure"}
        patches = Patches(images, take.rate, file["sure"], {key: frames[0] for key, frames in images.items()})
    return Filmed(rig, own, animation, take, truth, binding, patches, makeup, seed, helmet.cameras, frames, spoil)


def _key(rig: Rig, take: MarkerTake, animation: Animation, makeup: Sequence[Stroke]) -> str:
    """What a film depends on: the face as it is now, its paint, what it does, and where its markers are."""
    parts = [rig.mesh.vertices, rig.deltas, take.positions, animation.weights, *(stroke.points for stroke in makeup)]
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()[:12]


def _kept(path: Path, shoot: Callable[[], Sequence[Shot]]) -> np.ndarray:
    """All frames (C, T, H, W) of a film, made once and read from disk."""
    if not path.exists():
        shots = shoot()
        part, (width, height) = path.with_name(f"{path.name}.{os.getpid()}"), shots[0].size
        shape = (len(shots), shots[0].count, height, width)
        kept = np.lib.format.open_memmap(part, mode="w+", dtype=np.uint8, shape=shape)
        for view, shot in enumerate(shots):
            for number, frame in enumerate(shot.frames()):
                kept[view, number] = frame
        del kept  # written
        part.rename(path)
    return np.load(path, mmap_mode="r")


def between(rig: Rig, makeup: Sequence[Stroke], count: int, seed: int) -> SurfacePoints:
    """Markers spread over the skin that neither bears paint, but on the red of the lips, nor is a lid."""
    paint = cKDTree(np.concatenate([stroke.points for stroke in makeup if not stroke.name.startswith(SHARED)]))
    painted = np.flatnonzero(paint.query(rig.mesh.vertices)[0] < APART)
    taken = np.concatenate([painted, rig.regions["lids"]])
    free = {name: np.setdiff1d(vertices, taken) for name, vertices in rig.regions.items()}
    return choose_points(replace(rig, regions=free), count, seed=seed)


def _spoilt(frames: np.ndarray, spoil: Spoil | None) -> list[Iterator[np.ndarray]]:
    """The frames (C, T, H, W), camera by camera, each spoilt when it is read."""

    def of_view(view: int) -> Iterator[np.ndarray]:
        for number, frame in enumerate(frames[view]):
            yield frame if spoil is None else spoil(view, number, frame)

    return [of_view(view) for view in range(len(frames))]


def _bumped(take: MarkerTake, truth: Truth, size: float) -> tuple[MarkerTake, Truth]:
    """The helmet, knocked by `size` mm to the side and down in the middle of the take, for good."""
    shift = np.zeros((len(take.positions), 1, 3))
    shift[len(shift) // 2 :, 0] = size * np.array([0.8, -0.6, 0.0])
    slip = truth.slip.copy()
    slip[:, :3] += shift[:, 0]
    moved = replace(truth, slip=slip, positions=truth.positions + shift)
    return replace(take, positions=take.positions + shift), moved


def lessons(kind: str, cache_folder: Path) -> tuple[list[Patches], list[Lesson]]:
    """Two lessons by the teacher of a face, who wears markers on the lids, too: the papers' units, and more units."""
    taught = [_lesson(kind, cache_folder, *what) for what in ((TRAINED, 4, 0), (MORE, 3, 50))]
    return [patches for patches, _ in taught], [shown for _, shown in taught]


def _lesson(
    kind: str, cache_folder: Path, units: Sequence[str], repeats: int, seed: int
) -> tuple[Patches, Lesson]:  # fmt: skip
    """Units shown one after the other, with the weights that the markers give."""
    person = PEOPLE[kind][0]
    shown = action_units(face(kind, person), units, rate=LESSON_RATE, repeats=repeats, seed=seed)
    filmed = film(kind, person, shown.animation, person + seed, cache_folder, f"{kind}-{person}-lesson", spread=True)
    lead = len(filmed.take.positions) - len(shown.animation.weights)
    spans = [((a + lead) / LESSON_RATE, (b + lead) / LESSON_RATE, ASIDE.get(u, f"AU{u}")) for u, a, b, _ in shown.turns]
    settings = SolveSettings(head="keep")
    solved = blendcap.solve(filmed.rig, filmed.take, filmed.binding, settings=settings).animation
    return filmed.patches, Lesson.of_spans(spans, len(filmed.take.positions), LESSON_RATE, solved)


def exercise(kind: str, person: int, cache_folder: Path, repeats: int = 2, seed: int = 7) -> tuple[Filmed, np.ndarray]:
    """The papers' units shown by a person: the film, and the true intensities (T, U) of `UNITS`."""
    shown = action_units(face(kind, person), TRAINED, rate=RATE, repeats=repeats, seed=seed)
    filmed = film(kind, person, shown.animation, person + seed, cache_folder, f"{kind}-{person}-units")
    return filmed, _intensities(shown, len(filmed.take.positions) - len(shown.animation.weights))


def extremes(kind: str, person: int, cache_folder: Path) -> Filmed:
    """The thesis' two extremes by a person: puckered lips that swing from side to side, and a frown (4.2.13)."""
    rig = face(kind, person)
    swing, down = lip_swing(rig, RATE), frown(rig, RATE)
    acted = Animation(np.concatenate([swing.weights, down.weights]), swing.names, RATE)
    return film(kind, person, acted, 300 + person, cache_folder, f"{kind}-{person}-extremes", keep=True)


def worn(filmed: Filmed, count: int, between_paint: bool) -> tuple[MarkerTake, Truth, Binding]:
    """The same performance with other markers, more, fewer, or on the lids, too: the film's helmet slips as it does."""
    if between_paint and count == len(filmed.take.names):
        return filmed.take, filmed.truth, filmed.binding
    own, seed = filmed.own, filmed.seed
    points = between(own, filmed.makeup, count, seed) if between_paint else choose_points(own, count, seed=seed)
    take, truth = make_take(filmed.truth.performer, filmed.acted, points, seed=200 + seed, slip=(0.0, 0.0))
    matrices = slip_matrices(filmed.truth)
    seen, true = (apply(part.positions, matrices[:, :3, :3], matrices[:, :3, 3]) for part in (take, truth))
    slip, pivot = filmed.truth.slip, filmed.truth.pivot
    take, truth = replace(take, positions=seen), replace(truth, slip=slip, pivot=pivot, positions=true)
    return take, truth, blendcap.bind(filmed.rig, take, points)


def _intensities(shown: Exercise, lead: int) -> np.ndarray:
    amounts = np.zeros((lead + len(shown.animation.weights), len(UNITS)))
    for unit, start, stop, _ in shown.turns:
        first = f"AU{unit.split('+')[0]}"
        column = shown.labels.weights[start:stop, shown.labels.names.index(first)]
        amounts[lead + start : lead + stop, UNITS.index(ASIDE.get(unit, f"AU{unit}"))] = column
    return amounts


def played(
    kind: str, person: int, cache_folder: Path, spoil: Spoil | None = None, flaw: str = "", bump: float = 0.0,
    draw: int = 0,
) -> Filmed:  # fmt: skip
    """A real performance played by a person, filmed; each draw has its own paint, markers, noise and helmet."""
    rig = face(kind, person)
    recording, first, last = PLAYED[kind]
    acted = performance(recording, rig, first, last) if kind == "ICT" else _on_mannequin(recording, rig, first, last)
    name = f"{kind}-{person}-played"
    seed = 500 + person + 1000 * draw
    return film(kind, person, acted, seed, cache_folder, name, flaw=flaw, spoil=spoil, bump=bump, keep=True)


def _on_mannequin(recording: str, rig: Rig, first: int, last: int) -> Animation:
    whole = blendcap.read_animation(DATA / "performances" / recording)
    part = Animation(np.clip(whole.weights[first:last], 0, 1), whole.names, whole.rate)
    return for_rig(part, rig)


def table_for(rig: Rig) -> dict[str, dict[str, float]]:
    """The table from units to shapes in the rig's own names."""
    table = {}
    for unit, shapes in ARKIT_TABLE.items():
        names = match(tuple(shapes), rig.names)
        table[unit] = {own: shapes[name] for name, owned in names.items() for own in owned}
    return table
