"""A small rig for tests: a bent sheet with a mouth slit, lids, and shapes that behave like those of a face."""

import numpy as np

from blendcap.data import Mesh, Rig
from blendcap.data.names import mirror_map

STEP, HALF = 4.0, 60.0  # mm
SLIT_Y, SLIT_HALF = -20.0, 24.0  # the mouth: a row of vertices that exists twice, without a gap


def sheet_mesh(bend: float = 0.002) -> tuple[Mesh, np.ndarray]:
    """The sheet z = -bend x², and its lip pairs (P, 2): above and below the slit, at the same place."""
    line = np.arange(-HALF, HALF + 1e-9, STEP)
    count = len(line)
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    number = np.arange(count * count).reshape(count, count)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    upper = np.flatnonzero((np.abs(y - SLIT_Y) < 1e-9) & (np.abs(x) < SLIT_HALF))
    lower = count * count + np.arange(len(upper))
    below = y[faces].mean(1) < SLIT_Y
    copy = np.arange(count * count)
    copy[upper] = lower
    faces[below] = copy[faces[below]]
    x, y = np.concatenate([x, x[upper]]), np.concatenate([y, y[upper]])
    return Mesh(np.stack([x, y, -bend * x**2], 1), faces), np.stack([upper, lower], 1)


def sheet_rig() -> Rig:
    mesh, lips = sheet_mesh()
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    lower_lip = np.isin(np.arange(len(x)), lips[:, 1]) | (y < SLIT_Y)

    def blob(cx, cy, width, direction):
        return np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * width**2))[:, None] * np.array(direction, dtype=float)

    jaw = np.exp(-(x**2) / 900) * lower_lip * np.exp((y - SLIT_Y) / 60)
    lids, shapes = {}, {}
    for side, sign in (("Left", 1), ("Right", -1)):
        rows = [np.flatnonzero((x == sign * c) & (y == 32)) for c in (24, 28)]
        upper = np.concatenate(rows)
        under = np.concatenate([np.flatnonzero((x == sign * c) & (y == 24)) for c in (24, 28)])
        lids[f"lids_{side.lower()}"] = np.stack([upper, under], 1)
        blink = np.zeros((len(x), 3))
        blink[(np.abs(y - 32) < 1) & (np.abs(x - sign * 26) < 7), 1] = -8
        shapes[f"eyeBlink{side}"] = blink
        shapes[f"browOuterUp{side}"] = blob(sign * 30, 48, 9, (0, 5, 1))
        shapes[f"mouthSmile{side}"] = blob(sign * 24, SLIT_Y, 12, (sign * 4, 5, -1))
    shapes["jawOpen"] = jaw[:, None] * np.array([0, -16.0, -3.0])
    shapes["jawLeft"] = jaw[:, None] * np.array([6.0, 0, 0])
    shapes["jawRight"] = jaw[:, None] * np.array([-6.0, 0, 0])
    shapes["mouthClose"] = jaw[:, None] * (np.exp(-((y - SLIT_Y) ** 2) / 50))[:, None] * np.array([0, 14.0, 2.0])
    shapes["browInnerUp"] = blob(0, 48, 12, (0, 6, 1))
    shapes["mouthPucker"] = blob(0, SLIT_Y, 14, (0, 0, 5)) - np.stack(
        [0.15 * x * blob(0, SLIT_Y, 14, (1, 0, 0))[:, 0], 0 * x, 0 * x], 1
    )
    names = tuple(shapes)
    regions = {
        "brows": np.flatnonzero(y > 40),
        "lids": np.flatnonzero((y > 20) & (y <= 40)),
        "cheeks": np.flatnonzero((y > -8) & (y <= 20)),
        "lips": np.flatnonzero((y > -32) & (y <= -8)),
        "jaw": np.flatnonzero(y <= -32),
    }
    deltas = np.stack(list(shapes.values())).astype(np.float32)
    combinations = {"mouthClose": ("jawOpen",)}
    return Rig(mesh, deltas, names, mirror=mirror_map(names), combinations=combinations, regions=regions,
               contacts={"lips": lips, **lids}, name="sheet")  # fmt: skip
