"""A helmet with four grey cameras before the face, each with a ring of lights around its lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numba import njit

from blendcap.data import Camera, InputError, Rig, SurfacePoints, landmarks68
from blendcap.rendering import default_colors, vertex_normals
from blendcap.rendering.camera import look_at
from blendcap.rendering.color import to_linear
from blendcap.rendering.grey import GreySurface
from blendcap.rendering.light import openness
from blendcap.synthetic.motion import motion_matrices
from blendcap.synthetic.paint import Stroke, drawn_faces, paint, skin_faces
from blendcap.synthetic.shot import Shot
from blendcap.synthetic.takes import Truth

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SEATS = {"upper_right": (-30, 12), "upper_left": (30, 12), "lower_right": (-24, -24), "lower_left": (24, -24)}
DISTANCE = 185.0  # of a lens from the middle of the face, mm
FOCAL = 0.83  # of the picture's height: a wide lens
DISTORTION = (-0.20, 0.045, 0.0, 0.0, 0.0)
SLIGHT = {"angle": 1.5, "place": 3.0, "focal": 0.01, "lens": 0.004}  # no two helmets are alike: degrees, mm, parts
DOT = 1.75  # radius of a marker, mm
PAINT = 1.15  # reflectance: the paint sends light back
GLOSS, WET = 0.10, 0.8  # highlights of skin and of eyes


@dataclass(frozen=True)
class Sensor:
    """How light becomes a number.

    Parameters
    ----------
    exposure : float
        s.
    well : float
        Electrons of a full pixel: fewer, more noise.
    read : float
        Noise of reading, electrons.
    gamma : float
        The picture is light to this power.
    """

    exposure: float = 0.004
    well: float = 4000.0
    read: float = 12.0
    gamma: float = 0.6

    def read_out(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Grey values (H, W) uint8 of light, 1 for a full pixel, with the noise of photons and of reading."""
        noise = rng.standard_normal(light.shape, dtype=np.float32)
        return _read_out(light, noise, self.well, self.read, _curve(self.gamma))


LEVELS = 4095


@cache
def _curve(gamma: float) -> np.ndarray:
    """The grey value of each level of light."""
    return np.round(255 * (np.arange(LEVELS + 1) / LEVELS) ** gamma).astype(np.uint8)


@njit(cache=True, nogil=True, error_model="numpy")
def _read_out(light, noise, well, read, curve):
    picture = np.empty(light.shape, dtype=np.uint8)
    for y in range(light.shape[0]):
        for x in range(light.shape[1]):
            signal = max(light[y, x], 0.0) * well
            signal += noise[y, x] * np.sqrt(signal + read * read)
            picture[y, x] = curve[int(min(max(signal / well, 0.0), 1.0) * LEVELS + 0.5)]
    return picture


@dataclass(frozen=True, eq=False)
class HeadCamera:
    """A helmet's cameras, in the space of the head as it sits when it has not slipped.

    Parameters
    ----------
    names : (C,) str
    cameras : (C,) Camera
    size : (width, height)
    lights : (C, 8) float64
        A ring light around each lens: position, direction, strength times the squared distance at which white paper
        fills a pixel (mm^2), power of the cosine with which it gets weaker to the side.
    ambient : float
        What the set adds, of a full pixel.
    sensor : Sensor
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    size: tuple[int, int]
    lights: np.ndarray
    ambient: float = 0.02
    sensor: Sensor = field(default_factory=Sensor)


def mount_head_camera(
    rig: Rig, *, seed: int, size: tuple[int, int] = (640, 480), sensor: Sensor | None = None
) -> HeadCamera:
    """A helmet for this head: two cameras at the height of the eyes and two below the mouth.

    Parameters
    ----------
    rig : Rig
        The performer's own.
    seed : int
        Cameras are screwed on a little differently, and no two lenses are alike.
    size : (width, height)
        Pixels.
    """
    marks, rng = landmarks68(rig).positions(rig.mesh), np.random.default_rng(seed)
    unit = np.linalg.norm(marks[45] - marks[36])
    center = marks[[36, 45, 48, 54]].mean(0) + unit * np.array([0, 0.02, -0.1])
    cameras, lights = [], []
    for seat in SEATS.values():
        yaw, pitch = np.deg2rad(seat + SLIGHT["angle"] * rng.normal(size=2))
        towards = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        eye = center + DISTANCE * unit / 88 * towards + SLIGHT["place"] * rng.normal(size=3)
        focal = FOCAL * size[1] * (1 + SLIGHT["focal"] * rng.normal(size=2))
        principal = (np.array(size) - 1) / 2 + 0.01 * size[0] * rng.normal(size=2)
        intrinsics = np.array([[focal[0], 0, principal[0]], [0, focal[1], principal[1]], [0, 0, 1.0]])
        lens = np.array(DISTORTION) + SLIGHT["lens"] * rng.normal(size=5) * [1, 1, 0.1, 0.1, 0]
        camera = Camera(intrinsics, look_at(eye, center), lens)
        cameras.append(camera)
        strength = 0.34 * (1 + 0.05 * rng.normal()) * (DISTANCE * unit / 88) ** 2
        lights.append([*camera.position, *camera.pose[2, :3], strength, 2.0])
    return HeadCamera(tuple(SEATS), tuple(cameras), size, np.array(lights), sensor=sensor or Sensor())


def film_head(
    truth: Truth, helmet: HeadCamera, *, seed: int, makeup: Sequence[Stroke] = (), dots: bool = True
) -> tuple[Shot, ...]:
    """The four films of a take, synchronous with its markers: the same weights, the same dots, the same slip.

    Parameters
    ----------
    truth : Truth
        Of `make_take`.
    helmet : HeadCamera
    seed : int
        Of the noise.
    makeup : sequence of Stroke
        Of `draw_makeup` on the same performer.
    dots : bool
        Whether the markers are seen as white dots. `Shot.dots` are those on skin that can be painted: of a texture in
        several tiles the first.

    Returns
    -------
    tuple of Shot
        Their space is the helmet's; `lights["rings"]` (C, 8) and `lights["ambient"]` are those of the helmet.
    """
    glued = _on_paintable_skin(truth) if dots else None
    surface, placement = _dressed(truth.performer.rig, makeup, glued), slip_matrices(truth)
    lights = {"rings": helmet.lights, "ambient": np.array(helmet.ambient)}

    def developed(number: int):
        def develop(vertices: np.ndarray, shift: np.ndarray, frame: int) -> np.ndarray:
            camera, rng = helmet.cameras[number], np.random.Generator(np.random.SFC64([seed, number, frame]))
            light = surface.picture(vertices, camera, helmet.size, helmet.lights, ambient=helmet.ambient, shift=shift)
            return helmet.sensor.read_out(light, rng)

        return develop

    return tuple(
        Shot(
            name=name, size=helmet.size, camera=helmet.cameras[number], performer=truth.performer,
            animation=truth.animation, placement=placement, exposure=helmet.sensor.exposure, lights=lights,
            develop=developed(number), dots=glued,
        )
        for number, name in enumerate(helmet.names)
    )  # fmt: skip


def slip_matrices(truth: Truth) -> np.ndarray:
    """(T, 4, 4) from the rig's space to the helmet's, mm: the face as the slipping helmet sees it."""
    return motion_matrices(truth.slip, truth.pivot)


def _on_paintable_skin(truth: Truth) -> SurfacePoints:
    """The markers that can be seen as dots: not those on the neck or the back of the head of a texture in tiles."""
    points, kept = truth.points, skin_faces(truth.performer.rig)[truth.points.faces]
    return points.select([name for name, keep in zip(points.names, kept, strict=True) if keep])


def _dressed(rig: Rig, makeup: Sequence[Stroke], dots: SurfacePoints | None) -> GreySurface:
    """The performer's face in grey, with dots and makeup."""
    mesh = rig.mesh
    if mesh.uv is None or mesh.uv_faces is None:
        raise InputError(f"The rig {rig.name!r} has no texture coordinates (uv), so nothing can be painted on it.")
    glued = [] if dots is None else zip(dots.names, dots.positions(mesh), strict=True)
    layers = [[Stroke(name, place[None], np.array([DOT])) for name, place in glued], list(makeup)]
    keep = drawn_faces(rig)
    faces = np.ascontiguousarray(mesh.faces[keep])
    colors = default_colors(replace(rig, mesh=replace(mesh, texture=None)))
    assert colors is not None  # it has no texture
    albedo = np.nan_to_num(to_linear(colors) @ LUMINANCE)
    texture = np.zeros((0, 0), dtype=np.uint8)
    if mesh.texture is not None:
        texture = np.round(255 * to_linear(mesh.texture[..., :3] / 255) @ LUMINANCE).astype(np.uint8)
    gloss = np.full(len(albedo), GLOSS)
    gloss[rig.regions.get("eyes", [])] = WET
    sky = openness(mesh.vertices, vertex_normals(mesh.vertices, faces), faces)
    cover, painted = paint(rig, layers)
    uv_faces = np.ascontiguousarray(mesh.uv_faces[keep])
    return GreySurface(faces, albedo, sky, gloss, mesh.uv, uv_faces, texture, cover, painted[keep], PAINT)
