"""Normal maps of wrinkles that shapes switch on, for any face that the plain mannequin can be laid over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blendcap.data import Rig
from blendcap.data.names import match
from blendcap.numerics.easing import smoothstep
from blendcap.rendering import normal_map_of
from blendcap.synthetic.canvas import Canvas, canvas_of
from blendcap.synthetic.face_paint import SKIN, is_mannequin, kinds_of, laid_out
from blendcap.synthetic.mannequin.furrows import FURROWS, SIDED
from blendcap.synthetic.mannequin.texture import skin_table
from blendcap.synthetic.plain import plain_places

STEEPEST = 2.0  # slope of a wrinkle; more comes from the border of a chart
TORN = 4.0  # mm between neighbouring texels: they lie in two charts


def wrinkle(rig: Rig, strength: float = 1.0, *, size: int = 1024) -> Rig:
    """The rig with a normal map for each shape that folds the skin: raised and drawn brows, sneer, squint, smile.

    Parameters
    ----------
    rig : Rig
        With uv and the points "landmarks68". Its shapes are known by ARKit's names in any spelling.
    strength : float
        Depth of the wrinkles; 1 is a person of about fifty.
    size : int
        Texels of a side of the maps, each of which takes 3 size² bytes.
    """
    rig = laid_out(rig)
    assert rig.mesh.uv is not None and rig.mesh.uv_faces is not None
    skin, canvas = _skin(rig), canvas_of(rig.mesh.uv, rig.mesh.uv_faces, size)
    canvas = canvas.part(np.all(skin[rig.mesh.faces], axis=1)[canvas.faces])
    table = np.zeros((len(skin), 3))
    table[skin] = skin_table()[:, :3] if is_mannequin(rig) else plain_places(rig, np.flatnonzero(skin))[:, :3]
    places, positions = (canvas.mixed(values, rig.mesh.faces) for values in (table, rig.mesh.vertices))
    frame = _frame(_picture(canvas, positions))
    maps = {}
    for name, half, furrow in _wanted(rig):
        relief = strength * furrow(places)
        relief *= 1.0 if half == 0 else smoothstep(-4, 4, half * places[:, 0])
        maps[name] = normal_map_of(_slopes(_picture(canvas, relief[:, None])[..., 0], frame))
    mesh = rig.mesh
    if mesh.normal_map is not None and mesh.normal_map.shape != (size, size, 3):
        mesh = replace(mesh, normal_map=None)
    return replace(rig, mesh=mesh, normal_maps=maps)


def _skin(rig: Rig) -> np.ndarray:
    if is_mannequin(rig):
        return np.arange(len(rig.mesh.vertices)) < len(skin_table())
    return kinds_of(rig) == SKIN


def _wanted(rig: Rig):
    """Shapes of the rig that fold the skin: name, side (1 left, -1 right, 0 both), and the relief on both sides."""
    for stem, furrow in FURROWS.items():
        keys = {f"{stem}Left": 1, f"{stem}Right": -1} if stem in SIDED else {stem: 0}
        for key, half in keys.items():
            found = match([key], rig.names).get(key, ())
            halves = (half,) if len(found) == 1 else (1, -1)
            yield from ((name, side, furrow) for name, side in zip(found, halves, strict=False))


def _picture(canvas: Canvas, values: np.ndarray) -> np.ndarray:
    """Values (T, C) at their texels, (H, W, C), NaN elsewhere."""
    picture = np.full((canvas.size, canvas.size, values.shape[1]), np.nan, dtype=np.float32)
    picture[canvas.where] = values
    return picture


def _along(picture: np.ndarray, axis: int) -> np.ndarray:
    """Difference of a texel's neighbours along an axis, halved; rows count upwards, as v does."""
    step = 0.5 * (np.roll(picture, -1, axis) - np.roll(picture, 1, axis))
    return step if axis == 1 else -step


def _frame(positions: np.ndarray) -> np.ndarray:
    """Lengths (H, W, 3) in mm a texel: of u, of v along u's direction, of v across it; NaN where a chart is torn."""
    a, b = _along(positions, 1), _along(positions, 0)
    length = np.linalg.norm(a, axis=2)
    aside = (a * b).sum(2) / np.maximum(length, 1e-9)
    across = np.sqrt(np.maximum((b * b).sum(2) - aside**2, 1e-12))
    frame = np.stack([length, aside, across], -1)
    frame[(length > TORN) | (across > TORN) | (length < 1e-3) | (across < 1e-3)] = np.nan
    return frame


def _slopes(relief: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Slopes (H, W, 2) along the tangent frame of a relief (H, W), mm; 0 where it has no neighbours."""
    along = _along(relief, 1) / frame[..., 0]
    across = (_along(relief, 0) - along * frame[..., 1]) / frame[..., 2]
    return np.clip(-np.nan_to_num(np.stack([along, across], -1)), -STEEPEST, STEEPEST)
