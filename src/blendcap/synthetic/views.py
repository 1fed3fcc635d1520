"""A performer before ordinary cameras: one video camera, three photographs, five synchronised views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from blendcap.data import Animation, Camera, Rig, landmarks68
from blendcap.rendering.camera import look_at
from blendcap.synthetic.color import Take, drift, film, one_light, room
from blendcap.synthetic.motion import motion_matrices
from blendcap.synthetic.performer import Performer
from blendcap.synthetic.shot import Shot

ANGLES = {"left": 40.0, "centre": 0.0, "right": -40.0}  # degrees; the camera stands on the subject's left, ...
FIVE = {"left_far": 60.0, "left": 30.0, "centre": 0.0, "right": -30.0, "right_far": -60.0}


def one_camera(performer: Performer, animation: Animation, *, seed: int, size: tuple[int, int] = (640, 480)) -> Shot:
    """A video of someone at a desk: one light from the side and above, a room behind, an exposure that drifts.

    The head moves as the animation says, or as `head_motion` does if it says nothing. The camera stands still, about
    60 cm away, and its lens bends lines a little.
    """
    rng = np.random.default_rng(seed)
    if animation.head is None:
        head = head_motion(performer.rig, len(animation.weights), animation.rate, seed=seed)
        animation = replace(animation, head=head)
    camera = _camera(performer.rig, size, rng.uniform(-8, 8), rng.uniform(-4, 6), 620.0, 0.50, rng)
    direction = (rng.choice([-1, 1]) * rng.uniform(0.4, 1.1), rng.uniform(0.3, 0.9), rng.uniform(0.5, 1.0))
    light = one_light(direction, rng.uniform(0.75, 1.0), rng.uniform(0.25, 0.45))
    count = len(animation.weights)
    exposure = np.exp(drift(count, animation.rate, 0.07, rng))
    white = 1 + np.array([0.02, 0.0, -0.03]) * drift(count, animation.rate, 1.0, rng, period=4.0)[:, None]
    take = Take(light, room(size, rng), exposure[:, None] * white, shutter=0.45 / animation.rate)
    return film("camera", performer, animation, camera, size, take, seed=seed)


def photographs(performer: Performer, *, seed: int, size: tuple[int, int] = (720, 960)) -> tuple[Shot, ...]:
    """Three pictures of the neutral face, from the subject's left, the front and the right, one after the other.

    The head has moved a little between them, and no two are exposed alike.
    """
    rng = np.random.default_rng(seed)
    names, rig = performer.names, performer.rig
    light = one_light((rng.uniform(-0.5, 0.5), 0.5, 1.0), 0.75, 0.5, gloss=0.12)
    background = np.ones((size[1], size[0], 3)) * rng.uniform(0.5, 0.75)
    shots = []
    for number, (name, angle) in enumerate(ANGLES.items()):
        head = motion_matrices(rng.normal(size=(1, 6)) * np.repeat([2.5, np.deg2rad(1.5)], 3), _neck(rig))
        still = Animation(np.zeros((1, len(names))), names, 1.0, head)
        camera = _camera(rig, size, angle + 2 * rng.normal(), 2 * rng.normal(), 1300.0, 0.50, rng)
        gain = np.full((1, 3), np.exp(0.08 * rng.normal()))
        take = Take(light, background, gain, shutter=1 / 125, well=20000.0)
        shots.append(film(name, performer, still, camera, size, take, seed=seed + number))
    return tuple(shots)


def five_views(
    performer: Performer, animation: Animation, *, seed: int, size: tuple[int, int] = (600, 800)
) -> tuple[Shot, ...]:
    """Five cameras on an arc that open their shutters together, under even light: for geometry."""
    rng = np.random.default_rng(seed)
    light = one_light((0.0, 0.25, 1.0), 0.45, 0.75, gloss=0.06)
    background = np.full((size[1], size[0], 3), 0.22)
    shots = []
    for number, (name, angle) in enumerate(FIVE.items()):
        camera = _camera(
            performer.rig, size, angle + rng.normal(), 4 * (-1) ** number + rng.normal(), 1000.0, 0.55, rng
        )
        take = Take(light, background, np.ones((len(animation.weights), 3)), shutter=0.004, well=20000.0)
        shots.append(film(name, performer, animation, camera, size, take, seed=seed + number))
    return tuple(shots)


def head_motion(rig: Rig, count: int, rate: float, *, seed: int, size: tuple[float, float] = (8.0, 5.0)) -> np.ndarray:
    """(count, 4, 4) of someone who talks: turns and nods about the neck.

    `size` is the root mean square of translation, mm, and rotation, degrees.
    """
    rng = np.random.default_rng(seed)
    pad = int(2 * rate)
    path = gaussian_filter1d(rng.normal(size=(count + 2 * pad, 6)), 0.3 * rate, axis=0)[pad : pad + count]
    path *= np.sqrt(2 * 0.3 * rate * np.sqrt(np.pi))  # unit variance at every length of the take
    return motion_matrices(path / np.sqrt(3) * np.repeat([size[0], np.deg2rad(size[1])], 3), _neck(rig))


def _camera(rig: Rig, size, yaw: float, pitch: float, distance: float, part: float, rng) -> Camera:
    """A camera that looks at the face from so many degrees; from brow to chin it fills a part of the height."""
    marks = landmarks68(rig).positions(rig.mesh)
    middle = marks[[0, 16, 27, 30, 8]].mean(0)
    yaw, pitch = np.deg2rad([yaw, pitch])
    towards = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    eye = middle + distance * towards + 5 * rng.normal(size=3)
    tall = float(marks[17:27, 1].max() - marks[8, 1])
    focal = part * size[1] * distance / tall * (1 + 0.01 * rng.normal())
    principal = (np.array(size) - 1) / 2 + 0.005 * size[0] * rng.normal(size=2)
    intrinsics = np.array([[focal, 0, principal[0]], [0, focal, principal[1]], [0, 0, 1.0]])
    lens = np.array([-0.08, 0.02, 0, 0, 0]) + rng.normal(size=5) * [0.02, 0.01, 0.0005, 0.0005, 0]
    return Camera(intrinsics, look_at(eye, middle), lens)


def _neck(rig: Rig) -> np.ndarray:
    """About where the head turns: below the ears."""
    marks = landmarks68(rig).positions(rig.mesh)
    return marks[[0, 16]].mean(0) - [0, 0.5 * abs(marks[27, 1] - marks[8, 1]), 0]
