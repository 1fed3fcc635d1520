"""A blendshape rig: a neutral face and what each named shape adds to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from blendcap.data import checks
from blendcap.data.errors import InputError
from blendcap.data.mesh import Mesh
from blendcap.data.surface import SurfacePoints


@dataclass(frozen=True, eq=False)
class Rig:
    """A linear (delta) blendshape rig.

    Parameters
    ----------
    mesh : Mesh
        The neutral face, mm.
    deltas : (N, V, 3) float32
        What each shape adds to the neutral at weight 1, mm.
    names : (N,) str
        One name a shape, each used once.
    bounds : (N, 2) float64, optional
        Lowest and highest weight; 0 and 1 if not given.
    mirror : (N,) int64, optional
        For each shape the shape that does the same on the other side (itself if it has no side).
    combinations : {corrective: (driver, ...)}, optional
        Shapes that make sense only together with others.
    points : {name: SurfacePoints}, optional
        Landmark embeddings and marker sets that come with the rig.
    regions : {name: (K,) int64}, optional
        Vertices of each region of the face.
    contacts : {name: (P, 2) int64}, optional
        Vertex pairs that meet when the lips or lids are closed.
    normal_maps : {shape name: (H, W, 3) uint8}, optional
        What a shape at weight 1 adds to the surface's normals: wrinkles (see `Mesh.normal_map` for the form and
        `rendering.blended_slopes` for the sum). All are as large as each other, and as the mesh's own.
    name : str
        What to call the rig.

    Raises
    ------
    InputError
        If a shape, an index or a name is wrong, or a delta is not finite.
    """

    mesh: Mesh
    deltas: np.ndarray
    names: tuple[str, ...]
    bounds: np.ndarray = checks.FILLED
    mirror: np.ndarray = checks.FILLED
    combinations: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    points: Mapping[str, SurfacePoints] = field(default_factory=dict)
    regions: Mapping[str, np.ndarray] = field(default_factory=dict)
    contacts: Mapping[str, np.ndarray] = field(default_factory=dict)
    normal_maps: Mapping[str, np.ndarray] = field(default_factory=dict)
    name: str = "rig"

    def __post_init__(self):
        put, count, vertices = object.__setattr__, len(self.names), len(self.mesh.vertices)
        put(self, "names", checks.names(self.names, "The rig's shape names"))
        shape = (count, vertices, 3)
        put(self, "deltas", checks.array(self.deltas, shape, "The rig's deltas", dtype=np.float32, finite=True))
        put(self, "bounds", self._checked_bounds())
        if self.mirror is None:
            put(self, "mirror", checks.array(np.arange(count), (count,), "mirror", dtype=np.int64))
        else:
            put(self, "mirror", checks.indices(self.mirror, count, (count,), "The rig's mirror map", "shape"))
            if not np.array_equal(self.mirror[self.mirror], np.arange(count)):
                raise InputError("The rig's mirror map must be its own inverse: left to right and right to left.")
        for corrective, drivers in self.combinations.items():
            for name in (corrective, *drivers):
                self.index(name)
        pairs = (checks.ANY, 2)
        put(self, "regions", {k: checks.indices(v, vertices, (checks.ANY,), f"The region {k!r}", "vertex")
                              for k, v in self.regions.items()})  # fmt: skip
        put(self, "contacts", {k: checks.indices(v, vertices, pairs, f"The contact {k!r}", "vertex")
                               for k, v in self.contacts.items()})  # fmt: skip
        put(self, "normal_maps", self._checked_normal_maps())

    def _checked_normal_maps(self) -> dict[str, np.ndarray]:
        size = None if self.mesh.normal_map is None else self.mesh.normal_map.shape
        maps = {}
        for name, values in self.normal_maps.items():
            self.index(name)
            maps[name] = checks.normal_map(values, f"The normal map of the shape {name!r}")
            size = size or maps[name].shape
            if maps[name].shape != size:
                raise InputError(
                    f"The normal map of the shape {name!r} is {maps[name].shape[1]} x {maps[name].shape[0]}, but "
                    f"another one of the rig is {size[1]} x {size[0]}; bring them all to one size."
                )
        return maps

    def _checked_bounds(self) -> np.ndarray:
        if self.bounds is None:
            return checks.array(np.tile([0.0, 1.0], (len(self.names), 1)), (len(self.names), 2), "bounds")
        bounds = checks.array(self.bounds, (len(self.names), 2), "The rig's bounds", finite=True)
        if (bounds[:, 0] > bounds[:, 1]).any():
            worst = self.names[int((bounds[:, 0] > bounds[:, 1]).argmax())]
            raise InputError(f"The lowest weight of shape {worst!r} is above its highest; swap its bounds.")
        return bounds

    def index(self, name: str) -> int:
        """The place of a shape, by name.

        Raises
        ------
        InputError
            If there is no such shape.
        """
        try:
            return self.names.index(name)
        except ValueError:
            known = ", ".join(self.names[:6])
            raise InputError(f"The rig {self.name!r} has no shape named {name!r}; it has {known} ...") from None

    def pose(self, weights: np.ndarray) -> np.ndarray:
        """Vertices under weights (N,) or (T, N): (V, 3) or (T, V, 3), mm.

        Raises
        ------
        InputError
            If there are not as many weights as shapes.
        """
        weights = np.asarray(weights, dtype=np.float64)
        if weights.ndim not in (1, 2) or weights.shape[-1] != len(self.names):
            raise InputError(f"The rig has {len(self.names)} shapes, but the weights have the shape {weights.shape}.")
        flat = self.deltas.reshape(len(self.names), -1)
        moved = weights.astype(np.float32) @ flat
        return self.mesh.vertices + moved.reshape(*weights.shape[:-1], -1, 3).astype(np.float64)

    def sample(self, points: SurfacePoints) -> tuple[np.ndarray, np.ndarray]:
        """Rest positions (M, 3) and deltas (N, M, 3) at points on the surface, mm, float64.

        Raises
        ------
        InputError
            If the points belong to another mesh.
        """
        matrix = points.matrix(self.mesh)
        touched = np.unique(matrix.indices)
        local = self.deltas[:, touched].astype(np.float64)
        deltas = np.einsum("mv,nvk->nmk", matrix[:, touched].toarray(), local, optimize=True)
        return np.asarray(matrix @ self.mesh.vertices), deltas

    def select(self, names) -> Rig:
        """The rig with only these shapes, in this order.

        Raises
        ------
        InputError
            If it lacks one.
        """
        names = tuple(names)
        rows = np.array([self.index(n) for n in names], dtype=np.int64)
        place = {int(row): i for i, row in enumerate(rows)}
        mirror = np.array([place.get(int(self.mirror[r]), i) for i, r in enumerate(rows)], dtype=np.int64)
        combinations = {k: v for k, v in self.combinations.items() if {k, *v} <= set(names)}
        normal_maps = {k: v for k, v in self.normal_maps.items() if k in names}
        return replace(self, deltas=self.deltas[rows], names=names, bounds=self.bounds[rows], mirror=mirror,
                       combinations=combinations, normal_maps=normal_maps)  # fmt: skip

    def moving_vertices(self, threshold: float = 0.5) -> np.ndarray:
        """Vertices (K,) that any shape moves by more than `threshold` mm at weight 1: the moving face."""
        largest = np.zeros(len(self.mesh.vertices), dtype=np.float32)
        for delta in self.deltas:
            np.maximum(largest, np.einsum("vk,vk->v", delta, delta), out=largest)
        return np.flatnonzero(largest > threshold**2)


def landmarks68(rig: Rig) -> SurfacePoints:
    """The rig's points "landmarks68": the 68 landmarks of iBUG, named "0" to "67".

    Raises
    ------
    InputError
        If it has none, or not all.
    """
    names = [str(number) for number in range(68)]
    points = rig.points.get("landmarks68")
    lacking = names if points is None else [name for name in names if name not in points.names]
    if points is None or lacking:
        which = "points 'landmarks68'" if points is None else f"point {lacking[0]!r} in 'landmarks68'"
        raise InputError(
            f"The rig {rig.name!r} has no {which}; write the vertex numbers of the 68 landmarks into landmarks68.json, "
            '{"0": 1234, "1": 1250, ..., "67": 4321}, and give them to it: '
            "blendcap rig convert RIG OUT.glb --points landmarks68.json."
        )
    return points.select(names)
