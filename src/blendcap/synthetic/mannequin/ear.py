"""The auricle, sculpted on the fine surface: six points round are enough for where the ear is, not for its folds.

Every fine vertex of the ear has a place on it: round (the angle) and inwards (0 at the root, 2 at the outer edge, 5 in
the concha). The outline is a closed curve about the ear canal; across it run helix, scapha, antihelix and concha.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin.cage import EAR_RINGS, Cage
from blendcap.synthetic.mannequin.subdivision import Surface, refined

CANAL = np.array([-8.0, -8.0])  # y and z of the middle of the concha, mm
TILT = np.radians(14.0)  # the ear leans back
_TURNED = (0.0, -15.0, -23.0, -18.0, -12.0, -27.0, 0.0)  # of the cage's columns, degrees from even steps
_OUTLINE = {0: 20.0, 30: 25.5, 60: 30.0, 90: 30.0, 120: 23.5, 150: 14.0, 180: 10.0, 210: 12.0, 240: 24.0, 265: 33.0,
            285: 32.0, 310: 25.0, 335: 20.5, 360: 20.0}  # fmt: skip


def sculpted_ears(cage: Cage, surface: Surface) -> np.ndarray:
    """What the sculpture adds to the fine surface (V, 3), mm, on both sides; 0 off the ears."""
    plain = surface.through(cage.mirrored(cage.half))
    vertices, column, depth = _places(cage, surface)
    around = 255 - 60 * column + CubicSpline(np.arange(7), _TURNED, bc_type="periodic")(column)  # 0 back, 90 up
    within = np.clip((depth - 2) / 4, 0, 1)  # 0 at the edge, 3/4 in the concha
    target = _relief(np.radians(around), within)
    behind = np.clip(2 - depth, 0, 1)  # the back of the ear: a shell of some thickness, nearer to the head
    target[:, 0] -= 4.0 * smoothstep(0, 0.7, behind)
    target[:, 1:] += 0.10 * behind[:, None] * (CANAL - target[:, 1:])
    added = np.zeros_like(plain)
    added[vertices] = smoothstep(0, 1, depth)[:, None] * (target - plain[vertices])
    _fill_concha(cage, surface, plain, added)
    return added + surface.reflected(added)


def _places(cage: Cage, surface: Surface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fine vertices of the left ear's rings, the column (0 to 6, cyclic) and the ring (0 to 5) that they lie on."""
    half = len(cage.quads) // 2
    names = [[cage.names[corner] for corner in quad] for quad in cage.quads[:half]]
    rings = [[EAR_RINGS.index(head) if (head := name.partition(".")[0]) in EAR_RINGS else -1 for name in quad]
             for quad in names]  # fmt: skip
    chosen = [i for i, ring in enumerate(rings) if min(ring) >= 0 and min(ring) < max(ring)]
    corners = np.array([[(float(name.partition(".")[2]), ring) for name, ring in zip(names[i], rings[i], strict=True)]
                        for i in chosen])  # fmt: skip
    wraps = np.ptp(corners[:, :, 0], axis=1) > 1
    corners[:, :, 0] += 6 * (wraps[:, None] & (corners[:, :, 0] == 0))
    fine = refined(corners).reshape(-1, 2)
    quads = surface.quads.reshape(len(cage.quads), -1, 4)[chosen].ravel()
    vertices, first = np.unique(quads, return_index=True)
    return vertices, fine[first, 0], fine[first, 1]


def _relief(angle: np.ndarray, within: np.ndarray) -> np.ndarray:
    """Places (P, 3), mm, of the ear's outer face by angle, rad, and by the way from the edge (0) to the canal (1)."""
    degrees = np.mod(np.degrees(angle), 360)
    outline = CubicSpline(list(_OUTLINE), list(_OUTLINE.values()), bc_type="periodic")
    radius = outline(degrees) * (1 - within)
    up, back = radius * np.sin(angle), radius * np.cos(angle)
    y = CANAL[0] + np.cos(TILT) * up + np.sin(TILT) * -back * 0.5
    z = CANAL[1] - back - np.sin(TILT) * up
    lobe = np.exp(-(((degrees - 270) / 32) ** 2))
    front = np.exp(-(((degrees - 178) / 42) ** 2))
    tragus = np.exp(-(((degrees - 190) / 24) ** 2))

    def ridge(middle, width):
        return np.exp(-(((within - middle) / width) ** 2))

    rim = (1 - lobe) * (1 - front)
    height = 3.0 * rim * ridge(0.05, 0.07) - 2.2 * rim * ridge(0.19, 0.07)
    height += 3.0 * (1 - front) * (1 - 0.7 * lobe) * ridge(0.38, 0.09)
    height -= (5.0 + 5.0 * smoothstep(-12, -4, z)) * smoothstep(0.42, 0.72, within)  # deepest before the canal
    height += 3.5 * tragus * ridge(0.10, 0.22) - 1.5 * lobe * smoothstep(0.3, 0.0, within)
    x = 80.5 - 0.34 * (z - CANAL[1]) + 0.10 * (y - CANAL[0]) + height
    return np.stack([x, y, z - 3.0 * tragus * ridge(0.15, 0.2)], 1)


def _fill_concha(cage: Cage, surface: Surface, plain: np.ndarray, added: np.ndarray) -> None:
    """The floor of the concha is stretched between the corners of the ring round it."""
    ring = [i for i, name in enumerate(cage.names) if name.startswith("concha.")]
    quads = [i for i, quad in enumerate(cage.quads[: len(cage.quads) // 2]) if set(quad) <= set(ring)]
    floor, first = np.unique(surface.quads.reshape(len(cage.quads), -1)[quads], return_index=True)
    inside = (added[floor] == 0).all(1)
    stretched = refined((plain + added)[cage.quads[quads]]).reshape(-1, 3)[first]
    added[floor[inside]] = (stretched - plain[floor])[inside]
