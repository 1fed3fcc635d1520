"""What stands before the scanner: the skin of a rig without its clear layers, with hair and cloth as one mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter

from blendcap.data import Mesh, Rig
from blendcap.rendering import default_colors
from blendcap.rendering.appearance import SKIN

COLORS = {"hair": (0.25, 0.17, 0.11), "cloth": (0.24, 0.29, 0.38)}  # sRGB
STRAND, WEAVE = (0.9, 9.0), (0.6, 0.6)  # texels: how far a fleck of color runs across and along
STRIP = 96  # rows of the texture for each
SPREAD = 240.0  # mm that the strip is long


def drawable(rig: Rig, posed: Mesh) -> tuple[Mesh, np.ndarray, np.ndarray | None]:
    """The posed mesh without layers that are clear as glass, the rows of its faces, and colors if it has no texture."""
    colors = default_colors(replace(rig, mesh=Mesh(rig.mesh.vertices, rig.mesh.faces)))
    colors = np.tile(SKIN, (len(posed.vertices), 1)) if colors is None else colors
    clear = np.asarray(np.isnan(colors).any(1))
    rows = np.flatnonzero(~clear[posed.faces].any(1))
    uv_faces = None if posed.uv_faces is None else posed.uv_faces[rows]
    mesh = Mesh(posed.vertices, posed.faces[rows], uv=posed.uv, uv_faces=uv_faces, texture=posed.texture)
    return mesh, rows, colors if posed.texture is None else None


def set_stage(
    skin: Mesh, colors: np.ndarray | None, clutter: list[tuple[str, Mesh]], rng: np.random.Generator
) -> tuple[Mesh, np.ndarray | None]:
    """The skin and the clutter as one mesh, the skin first, textured; with its colors (V, 3) if the skin has those."""
    pieces = [skin, *(mesh for _, mesh in clutter)]
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    vertices = np.concatenate([piece.vertices for piece in pieces])
    faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)])
    if colors is not None:
        flecked = [_flecked(kind, len(mesh.vertices), rng) for kind, mesh in clutter]
        return Mesh(vertices, faces), np.concatenate([colors, *flecked])
    if skin.uv is None or skin.uv_faces is None or skin.texture is None or not clutter:
        return skin, None
    strips = np.concatenate([_strip(kind, skin.texture.shape[1], rng) for kind in COLORS])
    texture = np.concatenate([_rgb(skin.texture), strips])
    share = len(skin.texture) / len(texture)
    rows, tables, start = [skin.uv_faces], [skin.uv * [1, share] + [0, 1 - share]], len(skin.uv)
    for kind, mesh in clutter:
        rows.append(mesh.faces + start)
        tables.append(_on_strip(mesh.vertices, list(COLORS).index(kind), 1 - share))
        start += len(mesh.vertices)
    return Mesh(vertices, faces, uv=np.concatenate(tables), uv_faces=np.concatenate(rows), texture=texture), None


def _on_strip(vertices: np.ndarray, place: int, height: float) -> np.ndarray:
    """Texture coordinates (V, 2) on one of the strips at the foot of the texture, laid on from the front."""
    across = 0.5 + (vertices[:, 0] - vertices[:, 2] / 3) / SPREAD / 2
    along = np.abs((vertices[:, 1] / 60.0) % 2 - 1)  # there and back, so that it has no seam
    strip = height / len(COLORS)
    return np.stack([np.clip(across, 0, 1), height - strip * (place + 0.05 + 0.9 * along)], axis=1)


def _strip(kind: str, width: int, rng: np.random.Generator) -> np.ndarray:
    """A patch of texture (STRIP, width, 3) uint8: strands of hair, or threads of cloth."""
    flecks = gaussian_filter(rng.normal(size=(STRIP, width)), (STRAND if kind == "hair" else WEAVE)[::-1], mode="wrap")
    shade = 1 + 0.3 * flecks / flecks.std()
    return np.clip(255 * np.array(COLORS[kind]) * shade[..., None], 0, 255).astype(np.uint8)


def _flecked(kind: str, count: int, rng: np.random.Generator) -> np.ndarray:
    return np.clip(np.array(COLORS[kind]) * (1 + 0.2 * rng.normal(size=(count, 1))), 0, 1)


def _rgb(image: np.ndarray) -> np.ndarray:
    return image[..., :3] if image.shape[2] >= 3 else np.repeat(image[..., :1], 3, axis=2)
