"""Colors for a rig that brings none: by the names of its regions."""

from __future__ import annotations

import numpy as np

from blendcap.data import Rig
from blendcap.data.anatomy import clear_vertices

SKIN = np.array([0.80, 0.64, 0.56])  # sRGB, as all colors here
SCLERA, IRIS, PUPIL = np.array([0.90, 0.88, 0.86]), np.array([0.36, 0.42, 0.44]), np.array([0.05, 0.05, 0.06])
PALETTE = {  # a word in the region's name, in the order of painting
    "socket": np.array([0.45, 0.20, 0.19]),
    "tongue": np.array([0.72, 0.40, 0.39]),
    "gums": np.array([0.72, 0.42, 0.41]),
    "teeth": np.array([0.90, 0.87, 0.80]),
    "hair": np.array([0.28, 0.21, 0.17]),
}
IRIS_ANGLE, PUPIL_ANGLE = 0.50, 0.20  # rad from the axis of the eye


def default_colors(rig: Rig) -> np.ndarray | None:
    """A color (V, 3), sRGB 0 to 1, for each vertex, NaN where nothing should be drawn; None if the rig has a texture.

    Skin where nothing else is known; teeth, tongue, lashes and the like by the names of the rig's regions. A region
    with "eye" in its name that is one or two globes gets an iris and a pupil that look forward.
    """
    if rig.mesh.texture is not None:
        return None
    colors = np.tile(SKIN, (len(rig.mesh.vertices), 1))
    for name, vertices in rig.regions.items():
        if "eye" in name.lower():
            for side in (vertices[rig.mesh.vertices[vertices, 0] >= 0], vertices[rig.mesh.vertices[vertices, 0] < 0]):
                _paint_eyeball(colors, rig.mesh.vertices, side)
    for word, color in PALETTE.items():
        for name, vertices in rig.regions.items():
            if word in name.lower().replace("_", ""):
                colors[vertices] = color
    colors[clear_vertices(rig)] = np.nan
    return colors


def globe_of(points: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Center (3,) and radius of the globe that points (K, 3) lie on; None if they lie on none, as lids and lashes."""
    if len(points) < 50:
        return None
    design = np.column_stack([2 * points, np.ones(len(points))])  # |p|^2 = 2 c.p + (r^2 - |c|^2)
    center = np.linalg.lstsq(design, (points**2).sum(1), rcond=None)[0][:3]
    radii = np.linalg.norm(points - center, axis=1)
    radius = float(radii.mean())
    if radii.std() > 0.12 * radius or np.ptp(points, axis=0).min() < radius:
        return None
    return center, radius


def _paint_eyeball(colors: np.ndarray, positions: np.ndarray, vertices: np.ndarray) -> None:
    """Paint `vertices` (K,) as an eye if they lie on a globe; lids and lashes do not, and keep their color."""
    globe = globe_of(positions[vertices])
    if globe is None:
        return
    arms = positions[vertices] - globe[0]
    angle = np.arccos(np.clip(arms[:, 2] / np.maximum(np.linalg.norm(arms, axis=1), 1e-9), -1, 1))[:, None]
    iris = _step(IRIS_ANGLE, angle)
    rim = 0.55 + 0.45 * _step(IRIS_ANGLE - 0.10, angle)
    color = SCLERA * (1 - iris) + IRIS * rim * iris
    pupil = _step(PUPIL_ANGLE, angle)
    colors[vertices] = color * (1 - pupil) + PUPIL * pupil


def _step(edge: float, angle: np.ndarray) -> np.ndarray:
    """1 inside an angle, 0 outside, with a soft edge."""
    return np.clip(0.5 + (edge - angle) / 0.08, 0, 1)
