"""Cases with known truth: real performances on ICT-FaceKit faces of performers who are not the rig.

What is tuned uses `cases("tuning")` only; what is reported comes from `cases("report")`, which share no frame, no
identity, no performer seed and no range of motion noise with them: the last 20 s of Alexander's recording report. No
choice was made on them, but their blink gain was seen to fall short before the lids were tuned elsewhere.
`cases("fresh")` are other people, four of them in a part of another recording that nobody had looked at; they were
first run when all choices were made. (Eight others before them had shown blinks that trembled, which was mended.)
`cases("whole")` plays all of the recording on yet other people; choices were made on parts of it with other
identities, so it is the broader but not the blind figure.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from blendcap.data import Animation, MarkerTake, Mesh, Rig, SurfacePoints, triangulate
from blendcap.data.names import mirror_map
from blendcap.synthetic.performances import for_rig, range_of_motion
from blendcap.synthetic.performer import Performer, make_performer
from blendcap.synthetic.takes import Truth, choose_points, make_take

DATA = Path(os.environ.get("BLENDCAP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
FACE = 9409  # vertices of the face skin, without the back of the head, eyes and mouth
MM = 10.0  # ICT-FaceKit is in centimetres
LEFT_OUT = ("PupilDilate", "cheekRaiser")  # no performance drives them
MARKERS = 50


@dataclass(frozen=True)
class Case:
    """One performer, one range of motion, one take, and everything that is true about them.

    The solver is given `rig`, whose neutral is a registration of the performer's; answers are judged on `clean_rig`,
    whose neutral is the performer's own, so that the error of the scan is not charged to the solve. `points_given` is
    where a technician would click; the markers sit at `points_true`, in both takes.
    """

    name: str
    rig: Rig
    clean_rig: Rig
    rom_take: MarkerTake
    rom_truth: Truth
    take: MarkerTake
    truth: Truth
    points_given: SurfacePoints
    points_true: SurfacePoints

    @property
    def performer(self) -> Performer:
        return self.truth.performer

    @property
    def true_animation(self) -> Animation:
        """The truth with the performer's correctives, for `evaluate(..., truth_rig=case.performer.rig)`."""
        return self.performer.act(self.truth.animation)


# name, performance, first and last frame, identity, seed
PLANS = {
    "tuning": (
        ("alex first half, identity 1", "alexdjulin_alex_rom_3.csv", 0, 1500, 1, 1),
        ("happy, identity 2", "neurosync_Happy_Happy.csv", 0, 1500, 2, 2),
        ("alex first half, identity 3", "alexdjulin_alex_rom_3.csv", 500, 2000, 3, 3),
        *(
            (f"alex from {first}, identity {i}", "alexdjulin_alex_rom_3.csv", first, first + 610, i, i)
            for i, first in ((11, 0), (12, 600), (13, 1200), (14, 1800), (15, 2400), (16, 2810), (17, 300), (18, 2100))
        ),
    ),
    "report": (
        *((f"identity {i}", "alexdjulin_alex_rom_3.csv", 3420, 4030, i, i) for i in (51, 62, 74, 77, 78, 79, 80, 81)),
    ),
    "fresh": (
        *((f"alex, identity {i}", "alexdjulin_alex_rom_3.csv", 3420, 4030, i, i) for i in (95, 96, 97, 98)),
        *((f"happy, identity {i}", "neurosync_Happy_Happy.csv", 2400, 3046, i, i) for i in (141, 142, 143, 144)),
    ),
    "whole": (
        ("alex whole, identity 41", "alexdjulin_alex_rom_3.csv", 0, 4030, 41, 41),
        ("alex whole, identity 42", "alexdjulin_alex_rom_3.csv", 0, 4030, 42, 42),
        ("alex whole, identity 43", "alexdjulin_alex_rom_3.csv", 0, 4030, 43, 43),
    ),
}


def cases(
    kind: str = "tuning",
    *,
    strength: float = 1.0,
    noise: float = 0.2,
    misplacement: float = 1.5,
    slip: tuple[float, float] = (2.0, 2.0),
    occlusion: float = 0.05,
    registration: float = 0.5,
    markers: int = MARKERS,
) -> Iterator[Case]:
    """Cases of one kind, built one at a time.

    `registration` is the root mean square error of the rig's neutral, mm, as smooth as faces differ.
    """
    flaws = {"noise": noise, "slip": slip, "occlusion": occlusion}
    for name, recording, first, last, identity, seed in PLANS[kind]:
        rig = ict_rig(identity)
        performer = make_performer(rig, seed=seed, strength=strength)
        given = choose_points(rig, markers, seed=seed)
        rom = range_of_motion(rig, rate=60.0)
        rom_take, rom_truth = make_take(performer, rom, given, seed=1000 + seed, misplacement=misplacement, **flaws)
        acted = performance(recording, rig, first, last)
        glued = rom_truth.points
        take, truth = make_take(performer, acted, glued, seed=2000 + seed, misplacement=0.0, **flaws)
        yield Case(name, registered(rig, registration, seed), rig, rom_take, rom_truth, take, truth, given, glued)


def ict_rig(identity: int | None = None) -> Rig:
    """The skin of the ICT face with 53 shapes; an identity is drawn from its 100 modes by seed, None is the mean."""
    parts = _ict()
    neutral = parts["neutral"]
    if identity is not None:
        coefficients = np.random.default_rng(identity).normal(size=len(parts["modes"]))
        neutral = neutral + np.tensordot(coefficients, parts["modes"], axes=1)
    return Rig(
        Mesh(neutral, parts["faces"]),
        parts["deltas"],
        parts["names"],
        mirror=mirror_map(parts["names"]),
        combinations={"mouthClose": ("jawOpen",)},
        regions=parts["regions"],
        contacts=parts["contacts"],
        name="ICT" if identity is None else f"ICT {identity}",
    )


def registered(rig: Rig, error: float, seed: int) -> Rig:
    """The rig with a neutral that a scan and a registration got wrong by `error` mm (root mean square)."""
    modes = _ict()["modes"]
    field = np.tensordot(np.random.default_rng(3000 + seed).normal(size=len(modes)), modes, axes=1)
    field -= field.mean(0)
    field *= error / np.sqrt((field**2).sum(1).mean())
    return replace(rig, mesh=rig.mesh.with_vertices(rig.mesh.vertices + field))


def performance(recording: str, rig: Rig, first: int = 0, last: int | None = None) -> Animation:
    """A real ARKit performance on the rig's shapes, clipped to 0 to 1, frames `first` to `last`."""
    with open(DATA / "performances" / recording, newline="") as file:
        header, *rows = list(csv.reader(file))
    values = np.array(rows, dtype=np.float64)
    rate = round(1 / np.median(np.diff(values[:, 0])))
    table = json.loads((DATA / "rigs" / "ict_arkit52_map.json").read_text())
    names = tuple(n for n in header if n in table)
    weights = values[first:last, [header.index(n) for n in names]]
    return for_rig(Animation(weights, names, rate), rig, table)


@cache
def _ict() -> dict:
    with np.load(DATA / "rigs" / "ict_facekit.npz", allow_pickle=False) as file:
        names = [str(n) for n in file["expression_names"]]
        kept = [i for i, n in enumerate(names) if not n.startswith(LEFT_OUT)]
        polygons = file["faces"]
        landmarks = file["landmarks68_multipie"]
        parts = {
            "names": tuple(names[i] for i in kept),
            "neutral": file["neutral"][:FACE] * MM,
            "deltas": file["expression_deltas"][kept, :FACE] * np.float32(MM),
            "modes": file["identity_deltas"][:, :FACE] * np.float32(MM),
            "faces": triangulate(polygons[(polygons < FACE).all(1)]),
        }
    parts["regions"] = _regions(parts, landmarks)
    parts["contacts"] = {
        "lips": landmarks[[[61, 67], [62, 66], [63, 65]]],
        "lids_right": landmarks[[[37, 41], [38, 40]]],  # the subject's right eye is the left in the picture
        "lids_left": landmarks[[[43, 47], [44, 46]]],
    }
    return parts


def _regions(parts: dict, landmarks: np.ndarray) -> dict[str, np.ndarray]:
    """Brows, lids, nose and lips near their landmarks; the rest is ears, forehead, cheeks, jaw and neck by place."""
    vertices = parts["neutral"].astype(np.float64)
    marks = vertices[landmarks]
    places = {"brows": marks[17:27], "nose": marks[27:36], "lids": marks[36:48], "lips": marks[48:68]}
    reach = {"brows": 12, "nose": 18, "lids": 12, "lips": 12}  # mm; the nose is deep inside
    near = np.stack([np.linalg.norm(vertices[:, None] - at, axis=2).min(1) / reach[n] for n, at in places.items()])
    owner = np.where(near.min(0) < 1, near.argmin(0), -1)
    regions = {name: np.flatnonzero(owner == i) for i, name in enumerate(places)}
    above, below = marks[17:27, 1].min(), marks[[48, 54], 1].mean()
    jawline = marks[np.linalg.norm(vertices[:, None, ::2] - marks[None, :17, ::2], axis=2).argmin(1), 1]
    rest = {
        "neck": vertices[:, 1] < np.minimum(jawline, below) - 8,
        "jaw": vertices[:, 1] < below,
        "forehead": vertices[:, 1] > above,
        "ears": vertices[:, 2] < marks[[0, 16], 2].mean(),
        "cheeks": np.ones(len(vertices), dtype=bool),
    }
    free = owner < 0
    for name, inside in rest.items():
        regions[name] = np.flatnonzero(free & inside)
        free &= ~inside
    return regions
