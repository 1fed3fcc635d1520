"""Does a face detector that never saw our faces take them for faces, and find the features where they are?

    python benchmarks/face_judge.py [--people N]

MediaPipe FaceMesh 0.10.21 runs in an environment of its own (`face_judge_mediapipe.py`), made here in the cache;
pictures and answers pass through files.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from blendcap import Rig, mannequin
from blendcap.data.names import match
from blendcap.io.ict import read_ict_pack
from blendcap.rendering import Light, face_camera, prepare_rig, project, shaped
from blendcap.synthetic.face_paint import paint_face
from results import write_section

HERE = Path(__file__).resolve().parent
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "blendcap-tests" / "mediapipe-0.10.21"
NEEDS = ("numpy<2", "opencv-python-headless>=4.11,<4.12", "absl-py", "attrs", "flatbuffers", "protobuf>=4.25,<5",
         "matplotlib")  # fmt: skip
SIZE, TURN = (480, 480), np.radians(25.0)
EXPRESSIONS: dict[str, dict[str, float]] = {
    "neutral": {},
    "smile": {"mouthSmileLeft": 0.8, "mouthSmileRight": 0.8, "cheekSquintLeft": 0.5, "cheekSquintRight": 0.5},
    "open": {"jawOpen": 0.6}, "blink": {"eyeBlinkLeft": 1, "eyeBlinkRight": 1},
    "raised brows": {"browInnerUp": 1, "browOuterUpLeft": 1, "browOuterUpRight": 1},
    "frown": {"browDownLeft": 1, "browDownRight": 1, "mouthFrownLeft": 0.7, "mouthFrownRight": 0.7},
    "pucker": {"mouthPucker": 0.8}, "sneer": {"noseSneerLeft": 0.8, "noseSneerRight": 0.8},
    "surprise": {"jawOpen": 0.4, "eyeWideLeft": 0.8, "eyeWideRight": 0.8, "browInnerUp": 0.8},
    "wink": {"eyeBlinkLeft": 1, "mouthSmileLeft": 0.6},
}  # fmt: skip
# One vertex of FaceMesh for each of the 68, from the subject's right, as iBUG counts. No map is official; of FaceMesh's
# vertices along lips and nose these lie nearest to the mean of the 300-W annotations (that of dlib), both laid on each
# other by the corners of eyes and mouth. They were not chosen by our faces' truth.
FACEMESH = np.array([
    127, 234, 93, 132, 58, 136, 150, 176, 152, 400, 379, 365, 288, 361, 323, 454, 356,
    70, 63, 105, 66, 107, 336, 296, 334, 293, 300, 168, 197, 5, 4, 98, 97, 2, 326, 327,
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,
    61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181, 78, 82, 13, 312, 308, 317, 14, 87,
])  # fmt: skip
GROUPS = {"jaw": range(17), "brows": range(17, 27), "nose bridge": range(27, 30), "nose tip": [30],
          "nose base": range(31, 36), "eyes": range(36, 48), "mouth": range(48, 68)}  # fmt: skip
COMPARABLE = ("nose bridge", "nose base", "eyes", "mouth")


class Frame(NamedTuple):
    """One picture with its truth."""

    kind: str
    person: int
    expression: str
    yaw: float
    picture: np.ndarray
    truth: np.ndarray  # (68, 2) pixels


def environment(python: str = sys.executable) -> Path:
    """The interpreter of MediaPipe's own environment, made if it is not there.

    Raises
    ------
    RuntimeError
        If the package registry cannot be reached or has no wheel for this Python.
    """
    interpreter = CACHE / "bin" / "python"
    if (CACHE / "ready").exists():
        return interpreter
    install = [str(interpreter), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    try:  # its own list asks for jax and for a cv2 that clashes: FaceMesh needs neither
        subprocess.run([python, "-m", "venv", "--clear", str(CACHE)], check=True, capture_output=True, timeout=300)
        subprocess.run([*install, "--no-deps", "mediapipe==0.10.21"], check=True, capture_output=True, timeout=900)
        subprocess.run([*install, *NEEDS], check=True, capture_output=True, timeout=900)
    except (subprocess.SubprocessError, OSError) as error:
        reason = getattr(error, "stderr", b"") or b""
        raise RuntimeError(f"no environment for MediaPipe: {error} {reason.decode(errors='replace')[-300:]}") from None
    (CACHE / "ready").touch()
    return interpreter


def judged(pictures: list[np.ndarray]) -> np.ndarray:
    """FaceMesh's answer (T, 478, 2) in pixels; NaN where it found no face."""
    interpreter = environment()
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "pictures.npz", pictures=np.stack(pictures))
        subprocess.run([str(interpreter), str(HERE / "face_judge_mediapipe.py"), folder], check=True, env=clean,
                       capture_output=True, timeout=3600)  # fmt: skip
        with np.load(Path(folder) / "points.npz") as answer:
            return answer["points"]


def people(kind: str, seed: int, data: Path | None = None) -> Rig:
    """Somebody: a mannequin, or an ICT face under our paint with drawn identity modes."""
    if kind == "mannequin":
        return mannequin(seed, shapes=52)
    assert data is not None
    coefficients = 0.8 * np.random.default_rng(seed).normal(size=100)
    return paint_face(read_ict_pack(data, coefficients), seed)


def frames_of(rig: Rig, kind: str, person: int, expressions=tuple(EXPRESSIONS)) -> list[Frame]:
    """The person in each expression from the front and turned, in a light and before a background drawn anew."""
    rng, neutral, frames = np.random.default_rng([person, len(kind)]), prepare_rig(rig), []
    points = rig.points["landmarks68"]
    rest = points.positions(rig.mesh)
    framed = np.concatenate([rest + np.array([0, 60.0, -40]), rest])
    for number, name in enumerate(expressions):
        weights = np.zeros(len(rig.names))
        for shape, weight in EXPRESSIONS[name].items():
            for own in match([shape], rig.names).get(shape, ()):
                weights[rig.index(own)] = weight
        surface = shaped(neutral, rig, weights)
        for yaw in (0.0, TURN * (-1) ** number):
            key, fill, rim, sky = rng.uniform([0.45, 0.1, 0, 0.25], [0.95, 0.3, 0.5, 0.5])
            light = Light(key=tuple(rng.uniform([-1, 0.1, 0.4], 1)), strengths=(key, fill, rim, sky), gloss=0.2)
            camera = face_camera(framed, SIZE, yaw)
            picture = surface.picture(camera, SIZE, light=light, background=rng.uniform(0.1, 0.8, 3))
            truth = project(points.matrix(rig.mesh) @ rig.pose(weights), camera)[0]
            frames.append(Frame(kind, person, name, yaw, picture, truth))
    return frames


def errors(frames: list[Frame], points: np.ndarray) -> np.ndarray:
    """Distances (T, 68) of FaceMesh's points from the truth, in outer-eye distances from the front; NaN if unseen."""
    return np.linalg.norm(_away(frames, points), axis=2)


def errors_without_offsets(frames: list[Frame], points: np.ndarray) -> np.ndarray:
    """`errors`, less what FaceMesh's point is always beside the landmark: a step (3,) in the face's own frame for each
    landmark, fitted on the people of odd number for those of even number, and the other way round."""
    away, odd = _away(frames, points), np.array([frame.person % 2 == 1 for frame in frames])
    yaw = np.array([frame.yaw for frame in frames])
    seen, left = np.isfinite(away).all((1, 2)), away.copy()
    for shown, others in ((odd, seen & ~odd), (~odd, seen & odd)):
        across = np.stack([np.cos(yaw), -np.sin(yaw)], 1)  # of steps to the face's left and forwards
        step, *_ = np.linalg.lstsq(across[others], away[others, :, 0], rcond=None)
        left[shown] -= np.stack([across[shown] @ step, np.tile(away[others, :, 1].mean(0), (shown.sum(), 1))], 2)
    return np.linalg.norm(left, axis=2)


def errors_of_mean_face(frames: list[Frame], points: np.ndarray) -> np.ndarray:
    """`errors` of one who answers the mean of the other people's landmarks, laid over FaceMesh's points: a baseline."""
    truth, odd = np.stack([frame.truth for frame in frames]), np.array([frame.person % 2 == 1 for frame in frames])
    views, answers = np.sign([frame.yaw for frame in frames]), np.full((len(frames), 68, 2), np.nan)
    for n in np.flatnonzero(np.isfinite(points).all((1, 2))):
        mean = truth[(odd != odd[n]) & (views == views[n])].mean(0)
        answers[n] = _laid_over(mean, points[n, FACEMESH])
    return np.linalg.norm(answers - truth, axis=2) / _spans(frames)[:, None]


def _laid_over(shape: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The shape (L, 2) turned, scaled and moved onto points (L, 2) with the least squares."""
    here, there = ((p - p.mean(0)) @ [1, 1j] for p in (shape, points))
    placed = here * np.vdot(here, there) / np.vdot(here, here).real
    return np.stack([placed.real, placed.imag], 1) + points.mean(0)


def _away(frames: list[Frame], points: np.ndarray) -> np.ndarray:
    """From the truth to FaceMesh's points, (T, 68, 2), in outer-eye distances."""
    return (points[:, FACEMESH] - np.stack([frame.truth for frame in frames])) / _spans(frames)[:, None, None]


def _spans(frames: list[Frame]) -> np.ndarray:
    """The distance (T,) of the outer corners of the eyes as it is from the front, pixels."""
    return np.array([np.linalg.norm(f.truth[36] - f.truth[45]) / np.cos(f.yaw) for f in frames])


def report(frames: list[Frame], away: np.ndarray) -> dict[str, tuple[float, float]]:
    """Share of faces found, and mean errors by group in per cent of the outer-eye distance: from the front, turned."""
    seen, frontal = np.isfinite(away).all(1), np.array([frame.yaw == 0 for frame in frames])
    rows = {"all but the nose tip": [n for n in range(68) if n != 30], **{n: list(r) for n, r in GROUPS.items()}}
    rows["all but jaw, brows and nose tip"] = [n for name in COMPARABLE for n in GROUPS[name]]
    result = {"found": tuple(100 * float(seen[view].mean()) for view in (frontal, ~frontal))}
    for name, which in rows.items():
        result[name] = tuple(100 * float(away[np.ix_(seen & view, which)].mean()) for view in (frontal, ~frontal))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--people", type=int, default=20)
    count = parser.parse_args().people
    data = Path(os.environ.get("BLENDCAP_DATA", HERE.parent.parent / "shared" / "data")) / "rigs" / "ict_facekit.npz"
    columns = {}
    for kind in ("mannequin", "ICT-FaceKit") if data.exists() else ("mannequin",):
        frames, points = [], []
        for seed in range(1, count + 1):
            frames_here = frames_of(people(kind, seed, data), kind, seed)
            points.append(judged([frame.picture for frame in frames_here]))
            frames += [frame._replace(picture=np.empty(0)) for frame in frames_here]
        for measure, label in MEASURES.items():
            columns[f"{kind}, {label}"] = report(frames, measure(frames, np.concatenate(points)))
        print(columns, flush=True)
    write_section("Faces before a judge", "python benchmarks/face_judge.py", _text(count) + _table(columns))


def _text(count: int) -> str:
    return (
        f"MediaPipe FaceMesh 0.10.21 on {count} people in {len(EXPRESSIONS)} expressions, from the front and turned by "
        "25° to one side, light and background drawn for every picture, hair with the person: "
        f"{2 * count * len(EXPRESSIONS)} pictures of each face. Found: share of the pictures. Others: mean distance of "
        "FaceMesh's points from the true landmarks in % of the distance between the outer corners of the eyes, from "
        "the front / turned.\n\n"
        "*As it is* takes for each landmark the vertex of FaceMesh that is usually taken. FaceMesh and iBUG's 68 "
        "landmarks are two schemes: its jaw lies higher and inside the outline, its brows on their upper edge, and "
        "ICT-FaceKit marks bridge, nostrils and inner lips elsewhere again. *Offset removed* takes that away as "
        "comparisons across schemes do: one constant step in the face's own frame for each landmark, left, up and "
        "forwards, fitted on ten people and reported on the other ten, and the other way round. *Mean face* is a "
        "baseline: whoever answers the mean landmarks of the other ten people, laid over FaceMesh's points. No "
        "landmark is left out; the tip of the nose is stated apart.\n\n"
    )


def _table(columns: dict[str, dict[str, tuple[float, float]]]) -> str:
    head = f"| % | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}\n"
    rows = next(iter(columns.values()))
    cells = {row: [f"{column[row][0]:.2f} / {column[row][1]:.2f}" for column in columns.values()] for row in rows}
    return head + "\n".join(f"| {row} | {' | '.join(parts)} |" for row, parts in cells.items())


MEASURES = {errors: "as it is", errors_without_offsets: "offset removed", errors_of_mean_face: "mean face"}


if __name__ == "__main__":
    main()
