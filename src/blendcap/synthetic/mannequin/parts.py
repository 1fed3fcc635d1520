"""What moves with the skull, the jaw or the gaze and is no skin: eyeballs, caruncles, teeth, tongue.

Every part is a separate piece of the mesh. Its shapes are the displacements of a rigid motion at weight 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.numerics.easing import smoothstep
from blendcap.synthetic.mannequin import jaw
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS, Person
from blendcap.synthetic.mannequin.visemes import VISEMES

GAZE_ASIDE, GAZE_UP, GAZE_DOWN = np.radians((30.0, 22.0, 26.0))
CORNEA_RISE, CORNEA_ANGLE = 0.045, 0.42  # of the radius; radians
ARCH = 0.85  # of a half circle
CROWNS = (8.5, 6.6, 7.6, 7.0, 6.8, 10.2, 9.8)  # widths of the upper teeth from the midline back, mm
ROWS = 6  # of vertices from the gum over the front and the edge to the back
_PROFILE = (
    (0, -1.6, -1.6),
    (0.3, -0.45, -0.3),
    (0.8, -0.3, -0.3),
    (1.0, -1.3, -1.8),
    (1.0, -2.8, -7.6),
    (0.35, -6.0, -8.6),
)  # heights of a crown, and how far out it is there in front and at the molars, mm
_MOLAR = -4.6  # the middle of a molar, mm
LOWER_CROWNS = (5.3, 5.9, 6.9, 7.1, 7.2, 11.0, 10.5)


@dataclass(frozen=True, eq=False)
class Part:
    """One piece.

    Parameters
    ----------
    kind : str
        eye, caruncle, upper_teeth, lower_teeth or tongue.
    vertices : (V, 3) float64
        mm.
    quads : (Q, 4) int64
    local : (V, 3) float64
        What its color depends on: the direction from its center (eye, caruncle, tongue) or, for teeth, the distance
        along the arch from the midline in mm, the height (0 gum, 1 edge) and the depth of the gap between crowns.
    chart : (Q, 4, 2) float64
        Texture coordinates of the corners in the part's own cell, 0 to 1.
    """

    kind: str
    vertices: np.ndarray
    quads: np.ndarray
    local: np.ndarray
    chart: np.ndarray

    def mirrored(self) -> Part:
        """The piece on the other side; its colors mirror too."""
        flip = np.array([-1.0, 1.0, 1.0])
        return Part(self.kind, self.vertices * flip, self.quads[:, ::-1], self.local, self.chart[:, ::-1])


def make_parts(person: Person) -> list[Part]:
    """Left eye, right eye, left caruncle, right caruncle, upper teeth, lower teeth, tongue."""
    eye, caruncle = _eye(person), _caruncle(person)
    return [eye, eye.mirrored(), caruncle, caruncle.mirrored(), _teeth(person, upper=True), _teeth(person, upper=False),
            _tongue(person)]  # fmt: skip


def dental_arch(parts: list[Part]) -> np.ndarray:
    """The front of the upper teeth (A, 3), mm, from the midline to the last molar on the left."""
    teeth = next(part for part in parts if part.kind == "upper_teeth")
    front = teeth.vertices.reshape(ROWS, -1, 3)[2]
    return front[len(front) // 2 :]


def part_shapes(parts: list[Part], person: Person) -> dict[str, np.ndarray]:
    """Displacements (V, 3) of all parts' vertices, stacked in order, by shape; only the shapes that move a part."""
    vertices = np.concatenate([part.vertices for part in parts])
    owner = np.repeat(np.arange(len(parts)), [len(part.vertices) for part in parts])
    kinds = np.array([part.kind for part in parts])[owner]
    below, tongue = np.isin(kinds, ("lower_teeth", "tongue"))[:, None], (kinds == "tongue")[:, None]
    still = np.zeros_like(vertices)
    hinge = jaw.hinge_of(person)

    def fallen(share: float) -> np.ndarray:
        return jaw.opened(vertices, share, hinge)

    aside, out = np.array([jaw.SIDEWAYS, 0, 0]), _stuck_out(vertices)
    with_jaw = {
        "jawOpen": fallen(1.0),
        "jawStretch": fallen(jaw.STRETCHED) - fallen(1.0),
        "jawForward": np.array([0, -jaw.SINK, jaw.FORWARD]),
        "jawBack": np.array([0, -0.3 * jaw.SINK, jaw.BACK]),
        "jawLeft": aside,
        "jawRight": -aside,
    }
    with_jaw |= {name: fallen(viseme.jaw) for name, viseme in VISEMES.items()}
    shapes = {name: np.where(below, moved, still) for name, moved in with_jaw.items()}
    for name, viseme in VISEMES.items():
        shapes[name] = shapes[name] + np.where(tongue, viseme.tongue * out, still)
    for name, moved in {"tongueOut": out, **_tongue_tip(vertices)}.items():
        shapes[name] = np.where(tongue, moved, still)
    return shapes | _gazes(vertices, owner, person)


def _gazes(vertices: np.ndarray, owner: np.ndarray, person: Person) -> dict[str, np.ndarray]:
    """What each gaze adds to the vertices (V, 3): both eyes are the first two parts."""
    shapes = {}
    for eye, side, sign in ((0, "Left", 1), (1, "Right", -1)):
        center = person.globe * [sign, 1, 1]
        for name, yaw, pitch in (("Up", 0, GAZE_UP), ("Down", 0, -GAZE_DOWN), ("In", -sign * GAZE_ASIDE, 0),
                                 ("Out", sign * GAZE_ASIDE, 0)):  # fmt: skip
            turned = (vertices - center) @ (_turn(yaw, pitch) - np.eye(3)).T
            shapes[f"eyeLook{name}{side}"] = np.where((owner == eye)[:, None], turned, 0.0)
    return shapes


def _turn(yaw: float, pitch: float) -> np.ndarray:
    """Rotation (3, 3) that takes the gaze +z to the left (yaw > 0) and up (pitch > 0), radians."""
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]])
    return about_y @ about_x


def ball(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere of quads: a cube of cells x cells a side, blown up; its last side, the back, looks to -z."""
    ticks = np.tan(np.linspace(-1, 1, cells + 1) * np.pi / 4)
    a, b = (grid.ravel() for grid in np.meshgrid(ticks, ticks, indexing="ij"))
    one = np.ones_like(a)
    sides = [(a, b, one), (one, b, -a), (-one, b, a), (a, one, -b), (a, -one, b), (-a, b, -one)]
    points = np.concatenate([np.stack(side, 1) for side in sides])
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    quad = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], -1).reshape(-1, 4)
    quads = np.concatenate([quad + side * (cells + 1) ** 2 for side in range(6)])
    _, first, number = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    points = points[first]
    return points / np.linalg.norm(points, axis=1, keepdims=True), number.ravel()[quads]


def _eye(person: Person) -> Part:
    directions, quads = ball(14)
    angle = np.arccos(np.clip(directions[:, 2], -1, 1))
    radius = GLOBE_RADIUS * (1 + CORNEA_RISE * np.exp(-((angle / CORNEA_ANGLE) ** 4)))
    return Part("eye", person.globe + radius[:, None] * directions, quads, directions, _eye_chart(directions, quads))


def _flat(spots: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Corners (Q, 4, 2) of a chart of spots (V, 2) from -1 to 1."""
    return (0.5 + 0.5 * spots)[quads]


def _eye_chart(directions: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """The front and the sides on a disc by their angle from the gaze; the back in a corner of the square."""
    angle = np.arccos(np.clip(directions[:, 2], -1, 1))
    around = directions[:, :2] / np.maximum(np.linalg.norm(directions[:, :2], axis=1, keepdims=True), 1e-9)
    facing = directions[quads].mean(1)
    back = (np.abs(facing).argmax(1) == 2) & (facing[:, 2] < 0)
    disc, corner = _flat(around * (angle / (0.75 * np.pi))[:, None], quads), 0.075 + 0.095 * directions[quads][:, :, :2]
    return np.where(back[:, None, None], corner, disc)


def _caruncle(person: Person) -> Part:
    """The pink corner that fills the inner canthus."""
    directions, quads = ball(5)
    place = directions * [4.4, 4.0, 4.0] + person.globe + [-13.9, -1.2, 4.9]
    return Part("caruncle", place, quads, directions, _flat(directions[:, :2], quads))


def _tongue(person: Person) -> Part:
    directions, quads = ball(10)
    shape = directions * [17, 9, 29]
    shape[:, 1] -= 1.8 * np.exp(-((shape[:, 0] / 4) ** 2)) * (shape[:, 1] > 0)
    shape[:, 1] *= 1 - 0.45 * smoothstep(5, 28, shape[:, 2])
    place = person.moved(shape + np.array([0, -75, 60.5]))
    return Part("tongue", place, quads, directions, _flat(directions[:, [0, 2]], quads))


def _stuck_out(vertices: np.ndarray) -> np.ndarray:
    front = smoothstep(50, 84, vertices[:, 2])
    return front[:, None] * np.array([0, 2.0, 34.0]) - np.stack(
        [0 * front, 9 * smoothstep(72, 90, vertices[:, 2]), 0 * front], 1
    )


def _tongue_tip(vertices: np.ndarray) -> dict[str, np.ndarray]:
    """The tip of the tongue up, down and aside."""
    front = smoothstep(48, 88, vertices[:, 2])[:, None] ** 1.5
    ways = {"Up": (0, 9.0, -3.0), "Down": (0, -5.0, -1.0), "Left": (9.0, 0, -2.0), "Right": (-9.0, 0, -2.0)}
    return {f"tongue{way}": front * np.array(step) for way, step in ways.items()}


def _teeth(person: Person, *, upper: bool) -> Part:
    """A row of crowns: an arch of columns, from the gum over the front to the edge and back inside."""
    columns = 113
    turn = np.linspace(-1, 1, columns) * np.pi / 2 * ARCH
    size = 1.0 if upper else 0.9
    x, z = size * 25.8 * np.sin(turn), 49.9 + (42.5 if upper else 40.0) * np.cos(turn) - (0 if upper else 1.5)
    along = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    along -= along[columns // 2]
    borders = np.cumsum((0, *(CROWNS if upper else LOWER_CROWNS)))
    gap = np.exp(-((np.abs(np.abs(along)[:, None] - borders).min(1) / 0.7) ** 2))
    outward = np.stack([-np.gradient(z, along), 0 * x, np.gradient(x, along)], 1)
    gum, edge = (-56.5 - 0.003 * x**2, -67.0) if upper else (-75.5 + 0.007 * x**2, -66.0)  # molars are lower crowns
    table = smoothstep(12, 26, np.abs(along))  # incisors end in an edge, molars in a table
    full = np.sqrt(1 - (1 - np.clip((along[-1] - np.abs(along)) / 4.0, 0, 1)) ** 2)  # the last molar is round
    rows, local = [], []
    for height, front, molar in _PROFILE:
        rounded = gap * (1.2 if upper else -1.2) * (height > 0.7)
        rise = (0.0035 if upper else -0.0025) * x**2
        y = gum + height * (edge + rise + rounded - gum)
        depth = front + table * (molar - front) - 0.6 * gap
        rows.append(np.stack([x, y, z], 1) + outward * (_MOLAR + full * (depth - _MOLAR))[:, None])
        local.append(np.stack([along, np.full(columns, float(height)), gap], 1))
    first = (np.arange(ROWS - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    quads = np.stack([first, first + columns, first + columns + 1, first + 1], 1)
    vertices = person.moved(np.concatenate(rows))
    kind = "upper_teeth" if upper else "lower_teeth"
    spots = np.stack([np.tile(turn, ROWS), np.repeat(np.linspace(-1, 1, ROWS), columns)], 1) / [ARCH * np.pi / 2, 1]
    quads = quads if upper else quads[:, ::-1]
    return Part(kind, vertices, quads, np.concatenate(local), _flat(spots, quads))
