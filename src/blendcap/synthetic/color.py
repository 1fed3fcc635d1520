"""Shots in color: a studio's key light and ambient light, motion blur, a sensor's noise, exposure that drifts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from blendcap.data import Animation, Camera, Mesh, Rig
from blendcap.rendering import Light, Surface, blended_slopes, default_colors, prepare, project
from blendcap.rendering.color import LINEAR, PIXELS, STEPS
from blendcap.rendering.grey import MOMENT
from blendcap.synthetic.face_paint import GUMS, TEETH, TONGUES, kinds_of
from blendcap.synthetic.paint import drawn_faces
from blendcap.synthetic.performer import Performer
from blendcap.synthetic.shot import Shot

STILL = 0.3  # pixels of motion in an exposure that blur nothing
GLOW = {TEETH: 0.4, TONGUES: 0.15, GUMS: 0.15}  # openness to the sky, at least: they light each other


@dataclass(frozen=True, eq=False)
class Take:
    """What a color camera records besides the face.

    Parameters
    ----------
    light : Light
        Directions as the camera sees them.
    background : (H, W, 3) float64
        sRGB, 0 to 1.
    gain : (T, 3) float64
        What each channel's light is multiplied by: the drift of exposure and white balance.
    shutter : float
        s.
    well, read : float
        Electrons of a full pixel, and noise of reading, electrons.
    """

    light: Light
    background: np.ndarray
    gain: np.ndarray
    shutter: float = 0.01
    well: float = 6000.0
    read: float = 8.0


def one_light(direction: tuple[float, float, float], key: float, ambient: float, gloss: float = 0.18) -> Light:
    """A key light and light from everywhere, nothing else."""
    return Light(key=direction, strengths=(key, 0.0, 0.0, ambient), gloss=gloss)


def film(
    name: str,
    performer: Performer,
    animation: Animation,
    camera: Camera,
    size: tuple[int, int],
    take: Take,
    *,
    seed: int,
) -> Shot:
    """One camera's shot of a performance in a room; the animation's head motion places the head in it.

    `lights` of the shot holds `key` (3,), the direction towards the light in the room, `key_strength`,
    `ambient_strength`, and `gain` (T, 3).
    """
    acted = performer.act(animation).select(performer.names)
    count = len(acted.weights)
    placement = np.tile(np.eye(4), (count, 1, 1)) if animation.head is None else np.asarray(animation.head)
    surface, rig, glow = dressed(performer.rig), performer.rig, _glow(performer.rig)

    def develop(vertices: np.ndarray, shift: np.ndarray, frame: int) -> np.ndarray:
        slopes = blended_slopes(rig, performer.expand(acted.weights[frame]))
        worn = surface if slopes is None else replace(surface, relief=replace(surface.relief, slopes=slopes))
        linear = _blurred(worn, vertices, shift, glow, camera, size, take)
        rng = np.random.default_rng([seed, frame])
        return _read_out(linear * take.gain[frame], take, rng)

    strengths = np.asarray(take.light.strengths)
    key = take.light.directions(camera.pose[:3, :3])[0]
    lights = {"key": key, "key_strength": strengths[0], "ambient_strength": strengths[3], "gain": take.gain}
    return Shot(name, size, camera, performer, acted, placement, take.shutter, lights, develop)


def dressed(rig: Rig) -> Surface:
    """The rig's neutral ready for pictures: in its texture, else in colors by region; no lashes, no clear layers."""
    if rig.mesh.texture is None:
        return prepare(rig.mesh, default_colors(rig))
    mesh, keep = rig.mesh, drawn_faces(rig)
    uv_faces = None if mesh.uv_faces is None else mesh.uv_faces[keep]
    parts = {"uv": mesh.uv, "uv_faces": uv_faces, "texture": mesh.texture, "normal_map": mesh.normal_map}
    return prepare(Mesh(mesh.vertices, mesh.faces[keep], **parts))


def _glow(rig: Rig) -> np.ndarray:
    """Openness to the sky (V,) that teeth, gums and tongue have at least."""
    return np.array([GLOW.get(int(kind), 0.0) for kind in kinds_of(rig)])


def room(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """A wall out of focus, with some things before it, (H, W, 3), sRGB."""
    width, height = size
    wall = rng.uniform(0.35, 0.65) + 0.06 * rng.normal(size=3)
    picture = np.ones((height, width, 3)) * wall
    for _ in range(7):
        left, top = rng.integers(0, width), rng.integers(0, height)
        wide, high = (int(n * rng.uniform(0.05, 0.4)) for n in size)
        picture[top : top + high, left : left + wide] = rng.uniform(0.15, 0.85) + 0.10 * rng.normal(size=3)
    picture = gaussian_filter(picture, (0.025 * height, 0.025 * height, 0))
    grain = gaussian_filter(rng.normal(size=(height, width)), 0.12 * height)
    return (picture + 0.02 * (grain / grain.std())[..., None]).clip(0.02, 0.98)


def drift(count: int, rate: float, size: float, rng: np.random.Generator, period: float = 1.5) -> np.ndarray:
    """(count,) of smooth noise with this standard deviation, slower than `period` seconds; long takes settle to it."""
    knots = max(4, int(count / rate / period) + 4)
    return np.interp(
        np.arange(count) / rate / period,
        np.arange(knots) - 1.0,
        gaussian_filter(rng.normal(size=knots), 0.5) * size * 1.3,
    )


def _blurred(surface: Surface, vertices, shift, glow, camera: Camera, size, take: Take) -> np.ndarray:
    """Linear light (H, W, 3): the mean of three moments of the exposure, or one if nothing moves."""
    moved = np.abs(project(vertices + shift, camera)[0] - project(vertices, camera)[0])
    posed = surface.posed(vertices)
    sky = np.maximum(posed.sky, glow)
    moments = (0.0,) if np.nanmax(moved) < STILL else (-MOMENT, 0.0, MOMENT)
    total = np.zeros((size[1], size[0], 3))
    for moment in moments:
        there = surface.posed(vertices + moment * shift, sky)
        total += LINEAR[there.picture(camera, size, light=take.light, background=take.background)]
    return total / len(moments)


def _read_out(linear: np.ndarray, take: Take, rng: np.random.Generator) -> np.ndarray:
    """sRGB (H, W, 3) uint8 of linear light, with the noise of photons and of reading."""
    signal = linear * take.well
    signal += rng.standard_normal(linear.shape, dtype=np.float32) * np.sqrt(signal + take.read**2)
    return PIXELS[(np.clip(signal / take.well, 0, 1) * (STEPS - 1) + 0.5).astype(np.int32)]
