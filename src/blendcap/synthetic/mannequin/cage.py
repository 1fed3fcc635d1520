"""The control cage: authored half, mirrored; quads with edge loops round eyes, mouth, nostrils and ears."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from blendcap.synthetic.mannequin import points

EYE_RINGS = ("sock", "margin", "edge", "crease", "sulcus", "orbit")
MOUTH_RINGS = ("bag", "lining", "inner", "seam", "crest", "border", "around", "fold")
EAR_RINGS = ("root", "back", "helix", "scapha", "antihelix", "concha")
SHARP = 10.0  # as good as infinite: more than any number of levels


@dataclass(frozen=True, eq=False)
class Cage:
    """A symmetric quad cage whose left half was authored by name.

    Parameters
    ----------
    names : (H,) str
        The authored points; the first H points of the cage.
    half : (H, 3) float64
        Where the surface passes, mm.
    twin : (H,) int64
        The mirror image of each authored point: itself on the midline, else one of the points after H.
    quads : (Q, 4) int64
        Counter-clockwise seen from outside.
    sharpness : {(int, int): float}
        Creased edges by their ends, lower first (DeRose et al. 1998).
    corners : (K,) int64
        Points that stay where the cage has them.
    """

    names: tuple[str, ...]
    half: np.ndarray
    twin: np.ndarray
    quads: np.ndarray
    sharpness: dict[tuple[int, int], float]
    corners: np.ndarray

    @property
    def size(self) -> int:
        """How many points the whole cage has."""
        return int(self.twin.max()) + 1

    @property
    def twins(self) -> np.ndarray:
        """The mirror image (N,) of each point of the whole cage."""
        every = np.arange(self.size)
        every[self.twin] = np.arange(len(self.twin))
        every[: len(self.twin)] = self.twin
        return every

    def index(self, names: Sequence[str]) -> np.ndarray:
        """Places of authored points, by name."""
        return np.array([self._places[name] for name in names], dtype=np.int64)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def mirrored(self, left: np.ndarray, *, vectors: bool = True) -> np.ndarray:
        """Values (H, ...) of the authored half on the whole cage; vectors and positions turn their x."""
        whole = np.empty((self.size, *left.shape[1:]))
        whole[self.twin] = left * np.array([-1.0, 1.0, 1.0]) if vectors else left
        whole[: len(left)] = left
        if vectors:
            whole[self.twin[self.twin == np.arange(len(left))], 0] = 0.0
        return whole


def ring(name: str, places: Sequence[int] | int) -> list[str]:
    """Names of the points of a ring: the given places, or the first so many."""
    return [f"{name}.{k}" for k in (range(places) if isinstance(places, int) else places)]


@lru_cache(maxsize=1)
def head_cage() -> Cage:
    """The cage of a head and neck."""
    table = _authored()
    names, half = tuple(table), np.array(list(table.values()))
    place = {name: i for i, name in enumerate(names)}
    aside = half[:, 0] > 1e-9
    twin = np.where(aside, len(half) + np.cumsum(aside) - 1, np.arange(len(half)))
    left = np.array([[place[corner] for corner in quad] for quad in _quads()])
    left = _outward(_oriented(left), half)
    sharpness = {}
    for first, second, value in _creases():
        a, b = place[first], place[second]
        for i, j in ((a, b), (twin[a], twin[b])):
            sharpness[(min(int(i), int(j)), max(int(i), int(j)))] = value
    corners = np.array([place[name] for name in ("margin.0", "margin.6", "seam.4")])
    return Cage(names, half, twin, np.concatenate([left, twin[left[:, ::-1]]]), sharpness,
                np.concatenate([corners, twin[corners]]))  # fmt: skip


def _authored() -> dict[str, tuple[float, float, float]]:
    table = {}
    for block in (points.EYE, points.MOUTH, points.NOSE, points.SHELL, points.NECK, points.EAR):
        name, count = "", 0
        for word in block.split():
            if word.endswith(":"):
                name, count = word[:-1], 0
                continue
            key, _, text = word.rpartition("=")
            if not key:
                key, count = f"{name}.{count}", count + 1
            x, y, z = (float(number) for number in text.split(","))
            table[key] = (x, y, z)
    return table


def _words(text: str) -> list[str]:
    return text.split()


def _strip(first: Sequence[str], second: Sequence[str], *, closed: bool = False) -> list[tuple[str, ...]]:
    """Quads between two rows of points."""
    ends = range(len(first) if closed else len(first) - 1)
    n = len(first)
    return [(first[i], first[(i + 1) % n], second[(i + 1) % n], second[i]) for i in ends]


def _rings(names: Sequence[str], count: int, *, closed: bool) -> list[tuple[str, ...]]:
    rows = [ring(name, count) for name in names]
    return [quad for a, b in pairwise(rows) for quad in _strip(a, b, closed=closed)]


def _quads() -> list[tuple[str, ...]]:
    return [*_eye_and_mouth(), *_nose(), *_shell(), *_chin_and_neck(), *_ear()]


def _eye_and_mouth() -> list[tuple[str, ...]]:
    b = ring("bag", 9)
    floor = [(b[0], b[1], "mi", "mc"), (b[1], b[2], b[3], "mi"), (b[3], b[4], b[5], "mi"), (b[5], b[6], b[7], "mi"),
             (b[7], b[8], "mc", "mi")]  # fmt: skip
    return _rings(EYE_RINGS, 12, closed=True) + _rings(MOUTH_RINGS, 9, closed=False) + floor


def _nose() -> list[tuple[str, ...]]:
    a, b, c, d, e, f = ring("nostril", 6)
    v = ring("vestibule", 6)
    column = _words("G1 C1 B1 S1 T1")
    return [
        *_strip(_words("N0 N1 N2 N3 N4"), column),
        *_strip(column, ["orbit.1", "orbit.0", "orbit.11", "K1", "W1"]),
        ("N4", "T1", a, "N4b"), ("N4b", a, f, "N5"), ("N5", f, e, "N6"), ("T1", "W1", b, a), ("W1", "W2", c, b),
        ("W2", "W3", d, c), ("W1", "K1", "K2", "W2"), ("W2", "K2", "fold.3", "W3"),
        *_strip(["N6", e, d, "W3"], ring("fold", 4)),
        *_strip(ring("nostril", 6), v, closed=True),
        (v[0], v[1], v[2], v[5]), (v[5], v[2], v[3], v[4]),
    ]  # fmt: skip


def _shell() -> list[tuple[str, ...]]:
    p = _words("K1 P10 P9 P8 P7 P6 P5 H4 H3 H2")
    q = _words("K2 Q10 Q9 Q8 Q7 Q6 Q5 b4 b3 b2 b0")
    r = _words("R10 R9 R8 R7 R6 R5 c4 c3 c2 c0")
    s = _words("S10 S9 S8 S7 S6 S5 d4 d3 d2 d0")
    u = _words("U7 U6 U5 U4 U3 U2 U0")
    ear = {("R7", "R6"), ("R6", "R5")}
    return [
        *_strip(ring("orbit", range(11, 1, -1)), p),
        ("orbit.2", "H2", "G1", "orbit.1"), ("N0", "G1", "H2", "a0"),
        *_strip([*p, "a0"], q), ("K2", "Q10", "fold.4", "fold.3"), ("Q10", "R10", "fold.5", "fold.4"),
        *_strip(q[1:], r),
        *(quad for quad in _strip(r, s) if quad[:2] not in ear),
        *_strip(s[3:], u), *_strip(u[:5], _words("V7 V6 V5 V4 V3")), ("U3", "U2", "U0", "V3"),
    ]  # fmt: skip


def _chin_and_neck() -> list[tuple[str, ...]]:
    collar = ["M88", "M87", "S8", "S7", "U7", "V7"]
    return [
        ("fold.5", "R10", "S10", "fold.6"), ("fold.6", "S10", "M67", "fold.7"), ("fold.7", "M67", "M68", "fold.8"),
        ("S10", "S9", "M77", "M67"), ("M67", "M77", "M78", "M68"), ("S9", "S8", "M87", "M77"),
        ("M77", "M87", "M88", "M78"),
        *_strip(collar, ring("neck1", 6)), *_rings(("neck1", "neck2", "neck3"), 6, closed=False),
    ]  # fmt: skip


def _ear() -> list[tuple[str, ...]]:
    hole = _words("R7 R6 R5 S5 S6 S7")
    c = ring("concha", 6)
    return [*_strip(hole, ring("root", 6), closed=True), *_rings(EAR_RINGS, 6, closed=True),
            (c[0], c[1], c[4], c[5]), (c[1], c[2], c[3], c[4])]  # fmt: skip


def _creases() -> list[tuple[str, str, float]]:
    """The lid margin, the lip seam and the floor of the mouth are sharp; lid edge and vermilion border half so."""
    closed = [(name, k, (k + 1) % 12, value) for name, value in (("margin", SHARP), ("edge", 0.7)) for k in range(12)]
    opened = [
        (name, k, k + 1, value) for name, value in (("bag", 2.0), ("seam", SHARP), ("border", 0.5)) for k in range(8)
    ]
    return [(f"{name}.{a}", f"{name}.{b}", value) for name, a, b, value in closed + opened]


def _oriented(quads: np.ndarray) -> np.ndarray:
    """The same quads, all turned the way of the first: neighbours run along their shared edge in opposite ways."""
    turned = [list(map(int, quad)) for quad in quads]
    sides: dict[frozenset[int], list[int]] = {}
    for number, quad in enumerate(turned):
        for a, b in zip(quad, quad[1:] + quad[:1], strict=True):
            sides.setdefault(frozenset((a, b)), []).append(number)
    reached, front = {0}, [0]
    while front:
        quad = turned[front.pop()]
        for a, b in zip(quad, quad[1:] + quad[:1], strict=True):
            for other in sides[frozenset((a, b))]:
                if other in reached:
                    continue
                their = turned[other]
                if (a, b) in zip(their, their[1:] + their[:1], strict=True):
                    their.reverse()
                reached.add(other)
                front.append(other)
    return np.array(turned)


def _outward(quads: np.ndarray, half: np.ndarray) -> np.ndarray:
    """The quads turned so that the half head encloses a positive volume (the plane x = 0 adds none)."""
    a, b, c, d = (half[quads[:, k]] for k in range(4))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) + np.einsum("ij,ij->", a, np.cross(c, d))
    return quads if volume > 0 else quads[:, ::-1]
