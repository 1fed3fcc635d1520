"""The contact sheets in docs/pictures.

python benchmarks/contact_sheets.py [NAME ...]      all of them, or some, such as mannequin-people stage-scan

Sheets with ICT-FaceKit or a real scan need `BLENDCAP_DATA`, the folder of real data.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from blendcap import Animation, Mesh, Rig, mannequin, read_mesh
from blendcap.data import landmarks68
from blendcap.data.names import match
from blendcap.io.ict import read_ict_pack
from blendcap.modeling.build import build_rig
from blendcap.modeling.landmark_pairs import find_pairs
from blendcap.modeling.scan_repair import ready_scan, unit_by_landmarks
from blendcap.modeling.shut_eyes import keep_eyes_open
from blendcap.modeling.transfer import transfer
from blendcap.rendering import face_camera, prepare, prepare_rig, project, shaped
from blendcap.synthetic.face_paint import paint_face
from blendcap.synthetic.head_camera import film_head, mount_head_camera
from blendcap.synthetic.makeup import draw_makeup
from blendcap.synthetic.performances import speech
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.scans import make_scan
from blendcap.synthetic.takes import choose_points, make_take
from blendcap.synthetic.views import five_views, one_camera, photographs
from blendcap.synthetic.wrinkles import wrinkle
from blendcap.view.heatmap import heatmap
from blendcap.view.image import draw_text
from blendcap.view.posing import framed_vertices

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "pictures"
PEOPLE = ("plain", "ada", "kofi", "lars", "rosa", "mei", 1, 2, 3, 5, 11, 15)
SHAPES = (
    "browInnerUp", "browDown", "browOuterUpLeft", "browKnit", "eyeBlink", "eyeSqueeze", "eyeWide", "cheekSquint",
    "noseSneer", "nostrilDilate", "mouthSmile", "smileOpen", "mouthCornerUp", "mouthFrown", "mouthStretch",
    "mouthUpperUp", "mouthLowerDown", "mouthFunnel", "mouthPucker", "mouthRollLower", "mouthLeft", "cheekPuff",
    "chinRaise", "jawStretch",
)  # fmt: skip
SIDES = (0.0, 0.7, 1.5708)  # yaw, rad
SMILE = {"mouthSmile": 0.9, "cheekSquint": 0.5}
ACTED = (
    {},
    {"browInnerUp": 1, "browOuterUp": 1},
    {"browDown": 1, "noseSneer": 0.8},
    {"eyeBlink": 1},
    {"mouthPucker": 1},
    {"mouthSmile": 0.9, "cheekSquint": 0.6, "jawOpen": 0.2},
)
FOLDS = (
    {"browInnerUp": 1, "browOuterUp": 1},
    {"browDown": 1},
    {"noseSneer": 1},
    {"mouthSmile": 0.8, "eyeSquint": 1},
)

CONTACTS = (
    ("blink", {"eyeBlink": 1}, range(42, 48), 0.2),
    ("half a blink", {"eyeBlink": 0.5}, range(42, 48), 0.2),
    ("smile", {"mouthSmile": 1}, range(48, 68), 0.45),
    ("pressed lips", {"mouthPress": 1}, range(48, 68), 0.45),
)


def weights(rig: Rig, pose: Mapping[str, float]) -> np.ndarray:
    """Weights (N,) by names, in any spelling; one that needs a side means both, a driven shape its drivers too."""
    result = np.zeros(len(rig.names))
    for name, weight in pose.items():
        keys = [name] if match([name], rig.names) or name in rig.names else [f"{name}Left", f"{name}Right"]
        for key in keys:
            for own in [key] if key in rig.names else match([key], rig.names)[key]:
                result[[rig.index(n) for n in (own, *rig.combinations.get(own, ()))]] = weight
    return result


def portrait(rig: Rig, pose: Mapping[str, float], size: tuple[int, int], yaw: float, label: str = "", low=-1e9):
    """Picture (H, W, 3) of a head, from `low` mm upwards, smooth: four pixels become one."""
    neutral, fine = rig.mesh.vertices, (2 * size[0], 2 * size[1])
    camera = face_camera(neutral[neutral[:, 1] > low], fine, yaw)
    picture = Image.fromarray(shaped(prepare_rig(rig), rig, weights(rig, pose)).picture(camera, fine)).reduce(2)
    ImageDraw.Draw(picture).text((6, 6), label, fill=(40, 45, 50), font_size=12)
    return np.asarray(picture)


def closeup(rig: Rig, pose: Mapping[str, float], marks: range, size: tuple[int, int], yaw: float, label: str):
    """Picture (H, W, 3) of what lies around some of the 68 landmarks."""
    whole = (9 * size[0] // 2, 9 * size[0] // 2)
    middle = project(landmarks68(rig).positions(rig.mesh)[marks].mean(0), face_camera(rig.mesh.vertices, whole, yaw))[0]
    left, top = (middle - np.array(size) / 2).astype(int)
    picture = Image.fromarray(portrait(rig, pose, whole, yaw)[top : top + size[1], left : left + size[0]])
    ImageDraw.Draw(picture).text((6, size[1] - 20), label, fill=(40, 45, 50), font_size=12)
    return np.asarray(picture)


def grid(pictures: Iterable[np.ndarray], columns: int) -> np.ndarray:
    pictures = list(pictures)
    return np.vstack([np.hstack(pictures[k : k + columns]) for k in range(0, len(pictures), columns)])


def small(picture: np.ndarray, part: float) -> np.ndarray:
    """A part of the size, grey as color."""
    image = Image.fromarray(picture).convert("RGB")
    return np.asarray(image.resize((round(image.width * part), round(image.height * part)), Image.Resampling.LANCZOS))


def ict(look: int, identity: int | None = None) -> Rig:
    """ICT-FaceKit under our paint: its mean face, or one with drawn identity modes."""
    pack = Path(os.environ["BLENDCAP_DATA"]) / "rigs" / "ict_facekit.npz"
    modes = None if identity is None else 0.8 * np.random.default_rng(identity).normal(size=100)
    return paint_face(read_ict_pack(pack, modes), look)


def people() -> np.ndarray:
    return grid((portrait(mannequin(who, 52), {}, (320, 384), 0.6, str(who)) for who in PEOPLE), 6)


def shapes() -> np.ndarray:
    rig = mannequin()
    return grid((portrait(rig, {name: 1}, (250, 300), 0.55, name) for name in SHAPES), 8)


def smiles() -> np.ndarray:
    rigs = [(who, mannequin(who, 52)) for who in (*PEOPLE[:6], 3, 11)]
    poses = (SMILE, {**SMILE, "jawOpen": 0.4})
    return grid((portrait(rig, pose, (250, 300), 0.55, str(who)) for pose in poses for who, rig in rigs), 8)


def looks() -> np.ndarray:
    yaws = (0.6, 0.0, -0.5)
    return grid((portrait(mannequin(n, 52), {}, (300, 350), yaws[n % 3], low=-120) for n in range(1, 13)), 6)


def ict_painted() -> np.ndarray:
    rigs = [ict(seed, seed) for seed in range(1, 6)]
    return grid((portrait(rig, {}, (300, 350), yaw, low=-120) for yaw in (0.0, 0.5) for rig in rigs), 5)


def wrinkles() -> np.ndarray:
    bare = [mannequin("lars", 52), ict(2, 2)]
    rows = [[(rig, pose) for rig in rigs for pose in FOLDS] for rigs in (bare, [wrinkle(rig) for rig in bare])]
    return grid((portrait(rig, pose, (300, 330), 0.4, low=-110) for row in rows for rig, pose in row), 8)


def held(rig: Rig, poses: Iterable[Mapping[str, float]], frames: int = 3) -> Animation:
    """Each pose for some frames."""
    return Animation(np.repeat([weights(rig, pose) for pose in poses], frames, axis=0), rig.names, 60.0)


def head_cameras() -> np.ndarray:
    rows = []
    for rig, cameras in ((mannequin("ada"), range(4)), (ict(3), (2,))):
        person = make_performer(rig, seed=3)
        take = make_take(person, held(rig, ACTED), choose_points(rig, 50), seed=3, neutral_frames=0)[1]
        shots = film_head(take, mount_head_camera(person.rig, seed=1), seed=7, makeup=draw_makeup(person.rig, seed=5))
        rows += [[next(shots[c].frames(3 * n + 1)) for n in range(len(ACTED))] for c in cameras]
    return grid((small(picture[:, 20:580], 0.5) for row in rows for picture in row), len(ACTED))


def one_cameras() -> np.ndarray:
    tiles = []
    for rig, seed in ((mannequin(5), 5), (ict(2, 2), 8)):
        talk = speech(rig, rate=30.0, seconds=3.0, seed=3)
        shot = one_camera(make_performer(rig, seed=3), talk, seed=seed)
        most = [int((talk.weights @ weights(rig, {name: 1})).argmax()) for name in ("jawOpen", "eyeBlink")]
        frames = sorted({*most, 30, 75})
        tiles += [small(next(shot.frames(frame)), 400 / 640) for frame in frames]
    return grid(tiles, 4)


def photos() -> np.ndarray:
    rows = []
    for rig in (mannequin(2), ict(4, 4)):
        person, blink = make_performer(rig, seed=3), held(rig, [{"eyeBlink": 1}])
        rows.append(np.hstack([small(next(s.frames()), 300 / 720) for s in photographs(person, seed=2)]))
        rows.append(np.hstack([small(next(s.frames(1)), 180 / 600) for s in five_views(person, blink, seed=2)]))
    return np.vstack(rows)


def scan() -> np.ndarray:
    mesh = make_scan(make_performer(mannequin(3, 52), seed=3), seed=3).mesh
    dressed, bare = prepare(mesh), prepare(mesh, (0.80, 0.64, 0.56))
    cameras = [face_camera(mesh.vertices, (520, 560), yaw) for yaw in (1.0, 0.0, -1.0)]
    return grid((surface.picture(camera, (520, 560)) for surface in (bare, dressed) for camera in cameras), 3)


def transferred() -> np.ndarray:
    """Lids and lips of a template, of somebody after plain transfer, and with contact kept."""
    template, person = mannequin(shapes=52), mannequin(2, 52)
    rigs = {"template": template, "plain transfer": transfer(template, person.mesh, method="paper").rig,
            "contact kept": transfer(template, person.mesh).rig}  # fmt: skip
    return grid((closeup(rig, pose, marks, (325, 240), yaw, f"{title}: {name}")
                 for title, rig in rigs.items() for name, pose, marks, yaw in CONTACTS), len(CONTACTS))  # fmt: skip


def registered() -> np.ndarray:
    """The pictures of the report of `rig build`: a real head scan, the template aligned, the rig, its distance."""
    data = Path(os.environ["BLENDCAP_DATA"])
    template = read_ict_pack(data / "rigs" / "ict_facekit.npz")
    scan = read_mesh(data / "scans" / "LeePerrySmith" / "LeePerrySmith.obj", "mm")
    given, _ = find_pairs(scan, template)
    ready = ready_scan(scan, unit_by_landmarks(given, template)[0])
    pairs = None if given is None else (given[0], ready.unit_mm * given[1])
    pairs, free, _ = keep_eyes_open(template, pairs)
    built = build_rig(template, ready.mesh, pairs, free=free)
    bare = (Mesh(mesh.vertices, mesh.faces) for mesh in (built.scan, built.start))
    surfaces = [*(prepare(mesh, (0.80, 0.64, 0.56)) for mesh in bare), prepare_rig(built.rig)]
    cameras, rows = [face_camera(framed_vertices(built.rig), (300, 360), yaw) for yaw in SIDES], []
    for label, surface in zip(("scan", "template, aligned", "rig"), surfaces, strict=True):
        rows.append(np.hstack([surface.picture(camera, (300, 360)) for camera in cameras]))
        draw_text(rows[-1], label, (10, 350), height=14, anchor="ls")
    return np.vstack([*rows, heatmap(built.rig, built.registration.distance, size=(900, 420), yaws=SIDES)])


SHEETS = {
    "mannequin-people": people, "mannequin-shapes": shapes, "mannequin-smiles": smiles, "looks": looks,
    "ict-painted": ict_painted, "wrinkles": wrinkles, "stage-headcam": head_cameras, "stage-onecamera": one_cameras,
    "stage-photos": photos, "stage-scan": scan, "transfer": transferred, "lee-registered": registered,
}  # fmt: skip


def main() -> None:
    for name in sys.argv[1:] or SHEETS:
        Image.fromarray(SHEETS[name]()).save(FOLDER / f"{name}.jpg", quality=84, optimize=True)
        print(f"{name}.jpg: {(FOLDER / f'{name}.jpg').stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
