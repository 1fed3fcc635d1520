"""Paint any face: skin, lips, brows and hair as on the mannequin, laid over by landmarks; eyes and teeth by region."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blendcap.data import InputError, Rig, landmarks68
from blendcap.data.anatomy import CLEAR
from blendcap.rendering.appearance import globe_of
from blendcap.synthetic.canvas import bled, canvas_of, developed
from blendcap.synthetic.charts import in_one_picture
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS
from blendcap.synthetic.mannequin.inside import ENAMEL, GUM, TONGUE, paint_eye
from blendcap.synthetic.mannequin.look import Look, draw_look
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.mannequin.skin import INSIDE, WET_RIM, paint_skin
from blendcap.synthetic.mannequin.texture import painted
from blendcap.synthetic.plain import plain_places

SKIN, EYE, TEETH, TONGUES, GUMS, MOUTH, SOCKET, UNSEEN = range(8)
LAYERS = np.array([0, 1, 2, 2, 2, 0, 0, -1])  # kinds of one layer do not lie over each other in a texture
BACK = 0.8  # of the way from the gaze to the back of an eyeball
CORNEA = 1.03  # of the globe's radius: what stands out further is the cornea
_WORDS = ((SOCKET, ("socket",)), (MOUTH, ("mouthsocket", "mouthbag")), (TONGUES, ("tongue",)), (GUMS, ("gum",)),
          (TEETH, ("teeth", "tooth")), (UNSEEN, CLEAR))  # fmt: skip


def paint_face(rig: Rig, look: Look | int = 0, *, size: int = 1024) -> Rig:
    """The rig with a texture.

    Parameters
    ----------
    rig : Rig
        With uv and the points "landmarks68". Eyeballs, teeth, gums, tongue and sockets are told by the names of its
        regions. Where its uv leave the unit square or lie over each other, the charts are laid out anew.
    look : Look or int
        How it looks, or the seed of a drawn look; 0 is the plain one.
    size : int
        Texels of a side of the texture. (The mannequin's own texture always has 1024.)

    Raises
    ------
    InputError
        If the rig has no uv or no landmarks.
    """
    if not isinstance(look, Look):
        look = draw_look(int(look)) if look != 0 else Look()
    rig = laid_out(rig)
    if is_mannequin(rig):
        return replace(rig, mesh=replace(rig.mesh, texture=painted(look)))
    assert rig.mesh.uv is not None
    kinds = np.min(kinds_of(rig)[rig.mesh.faces], axis=1)
    whole = canvas_of(rig.mesh.uv, _shown(rig), size)
    linear = np.tile(np.asarray(look.skin, dtype=np.float32), (size, size, 1))
    for kind in np.unique(kinds):
        part, vertices = whole.part(kinds[whole.faces] == kind), np.unique(rig.mesh.faces[kinds == kind])
        table = np.zeros((len(rig.mesh.vertices), 9))
        table[vertices] = _values(rig, int(kind), vertices)
        linear[part.where] = _color(int(kind), part.mixed(table, rig.mesh.faces), look)
    return replace(rig, mesh=replace(rig.mesh, texture=bled(developed(linear), whole)))


def laid_out(rig: Rig) -> Rig:
    """The rig with texture coordinates that fit into one picture; if they did not, it loses the pictures that it had.

    Raises
    ------
    InputError
        If the rig has no uv or no landmarks.
    """
    if rig.mesh.uv is None or rig.mesh.uv_faces is None:
        raise InputError(f"The rig {rig.name!r} has no texture coordinates (uv), so there is nothing to paint on.")
    if is_mannequin(rig):
        return rig
    kinds, face = kinds_of(rig), int(landmarks68(rig).faces[30])
    layers = LAYERS[np.min(kinds[rig.mesh.faces], axis=1)]
    uv, uv_faces = in_one_picture(rig.mesh, layers, face, _eye_chart(rig, kinds))
    if uv is rig.mesh.uv:
        return rig
    mesh = replace(rig.mesh, uv=uv, uv_faces=uv_faces, texture=None, normal_map=None)
    return replace(rig, mesh=mesh, normal_maps={})


def is_mannequin(rig: Rig) -> bool:
    """Whether a rig is a mannequin, and so knows the plain place of every texel itself."""
    atlas = shared().atlas
    return rig.mesh.uv is not None and np.array_equal(rig.mesh.uv, atlas.uv)


def kinds_of(rig: Rig) -> np.ndarray:
    """What each vertex (V,) is a part of, told by the names of the regions."""
    kinds = np.full(len(rig.mesh.vertices), SKIN)
    for side in _globes(rig):
        kinds[side] = EYE
    for kind, words in _WORDS:
        for name, vertices in rig.regions.items():
            if any(word in name.lower().replace("_", "") for word in words):
                kinds[vertices] = kind
    return kinds


def _globes(rig: Rig) -> list[np.ndarray]:
    """The vertices of each eyeball."""
    globes = []
    for name, vertices in rig.regions.items():
        for side in (1, -1) if "eye" in name.lower() else ():
            own = vertices[side * rig.mesh.vertices[vertices, 0] >= 0]
            if globe_of(rig.mesh.vertices[own]) is not None:
                globes.append(own)
    return globes


def _values(rig: Rig, kind: int, vertices: np.ndarray) -> np.ndarray:
    """What the color of vertices (K,) of one kind depends on, (K, 9)."""
    if kind == SKIN:
        return plain_places(rig, vertices)
    values, places = np.zeros((len(vertices), 9)), rig.mesh.vertices[vertices]
    if kind == EYE:
        for side in (places[:, 0] >= 0, places[:, 0] < 0):
            values[side, :3] = _gaze(places[side])
    else:  # how far back
        values[:, 0] = (places[:, 2].max() - places[:, 2]) / max(float(np.ptp(places[:, 2])), 1e-6)
    return values


def _eye_chart(rig: Rig, kinds: np.ndarray) -> np.ndarray:
    """Texture coordinates (V, 2) of eyeballs, a disc by the angle from the gaze, so that shells over them agree."""
    chart = np.full((len(kinds), 2), np.nan)
    for side in (1, -1):
        own = np.flatnonzero((kinds == EYE) & (side * rig.mesh.vertices[:, 0] >= 0))
        if len(own):
            unit = _gaze(rig.mesh.vertices[own])
            angle = np.arccos(np.clip(unit[:, 2:], -1, 1))
            chart[own] = 0.5 + 0.499 * angle / np.pi * unit[:, :2] / np.maximum(np.sin(angle), 1e-9)
    return chart


def _shown(rig: Rig) -> np.ndarray:
    """Rows (F, 3) of the texture coordinates, without extent at the back of an eyeball: it would cover the front."""
    angle = 2 * np.linalg.norm(_eye_chart(rig, kinds_of(rig)) - 0.5, axis=1)  # NaN but on eyeballs
    assert rig.mesh.uv_faces is not None
    back = (angle[rig.mesh.faces] > BACK).any(1, keepdims=True)
    return np.where(back, rig.mesh.uv_faces[:, :1], rig.mesh.uv_faces)


def _gaze(points: np.ndarray) -> np.ndarray:
    """Directions (K, 3) on the mannequin's eyeball for an eyeball's points (K, 3): its iris keeps its size in mm."""
    center, radius = globe_of(points) or (points.mean(0), GLOBE_RADIUS)
    arms = points - center
    bulge = arms[(np.linalg.norm(arms, axis=1) > CORNEA * radius) & (arms[:, 2] > 0)]
    forward = bulge.mean(0) if len(bulge) else np.array([0.0, 0, 1])
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1, 0], forward)
    right /= np.linalg.norm(right)
    arms = arms @ np.stack([right, np.cross(forward, right), forward], 1)
    aside = np.linalg.norm(arms[:, :2], axis=1, keepdims=True)
    angle = np.minimum(np.arctan2(aside, arms[:, 2:]) * radius / GLOBE_RADIUS, np.pi)
    return np.concatenate([arms[:, :2] / np.maximum(aside, 1e-9) * np.sin(angle), np.cos(angle)], 1)


def _color(kind: int, values: np.ndarray, look: Look) -> np.ndarray:
    """Linear color (P, 3) of texels of one kind by what it depends on, (P, 9)."""
    if kind == SKIN:
        return paint_skin(values[:, :3], values[:, 3:], look)
    if kind == EYE:
        return paint_eye(values[:, :3], look.iris)
    back = values[:, :1]
    if kind == MOUTH:
        front = np.multiply(0.6, look.lips)
        return front + np.clip(4 * back, 0, 1) * (np.array(INSIDE) - front)
    plain = {TEETH: ENAMEL, GUMS: GUM, TONGUES: TONGUE, SOCKET: np.array(WET_RIM), UNSEEN: np.zeros(3)}[kind]
    return plain * (1 - 0.5 * back)
