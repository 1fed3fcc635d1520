"""Named points that ride on a surface: a marker set and a landmark embedding are both this."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from blendcap.data import checks
from blendcap.data.errors import InputError
from blendcap.data.mesh import Mesh


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points given by triangle and barycentric coordinates.

    Parameters
    ----------
    names : (M,) str
        One name a point, each used once.
    faces : (M,) int64
        The triangle that each point lies on.
    barycentric : (M, 3) float64
        Weights of the triangle's corners; each row sums to 1.

    Raises
    ------
    InputError
        If the lengths differ, a row does not sum to 1 or a number is not finite.
    """

    names: tuple[str, ...]
    faces: np.ndarray
    barycentric: np.ndarray

    def __post_init__(self):
        put = object.__setattr__
        put(self, "names", checks.names(self.names, "The points' names"))
        count = len(self.names)
        put(self, "faces", checks.indices(self.faces, 2**62, (count,), "The points' faces", "face"))
        put(self, "barycentric", checks.array(self.barycentric, (count, 3), "The points' barycentric", finite=True))
        off = np.abs(self.barycentric.sum(1) - 1)
        if count and off.max() > 1e-6:
            worst = int(off.argmax())
            raise InputError(
                f"The barycentric weights of point {self.names[worst]!r} sum to {self.barycentric[worst].sum():.6g}; "
                "they must sum to 1."
            )

    def matrix(self, mesh: Mesh) -> sparse.csr_matrix:
        """Sparse (M, V) that takes values at the mesh's vertices to the points.

        Raises
        ------
        InputError
            If a point names a face that the mesh does not have.
        """
        if len(self.faces) and self.faces.max() >= len(mesh.faces):
            worst = int(self.faces.argmax())
            raise InputError(
                f"The point {self.names[worst]!r} lies on face {self.faces[worst]}, but the mesh has "
                f"{len(mesh.faces)} faces; the points belong to another mesh."
            )
        rows = np.repeat(np.arange(len(self.faces)), 3)
        columns = mesh.faces[self.faces].ravel()
        shape = (len(self.faces), len(mesh.vertices))
        return sparse.csr_matrix((self.barycentric.ravel(), (rows, columns)), shape=shape)

    def positions(self, mesh: Mesh) -> np.ndarray:
        """Where the points lie on the mesh, (M, 3), mm.

        Raises
        ------
        InputError
            If the points belong to another mesh.
        """
        return np.asarray(self.matrix(mesh) @ mesh.vertices)

    def select(self, names) -> SurfacePoints:
        """The points of these names, in this order.

        Raises
        ------
        InputError
            If there is none of a name.
        """
        place = {name: i for i, name in enumerate(self.names)}
        missing = [name for name in names if name not in place]
        if missing:
            raise InputError(f"There is no point named {missing[0]!r}; there are {', '.join(self.names[:8])} ...")
        rows = [place[name] for name in names]
        return SurfacePoints(tuple(names), self.faces[rows], self.barycentric[rows])

    @classmethod
    def at_vertices(cls, names, vertices, mesh: Mesh) -> SurfacePoints:
        """Points that sit exactly on vertices (M,) of the mesh.

        Raises
        ------
        InputError
            If a vertex is not there or belongs to no face.
        """
        vertices = checks.indices(vertices, len(mesh.vertices), (len(names),), "The points' vertices", "vertex")
        used = mesh.faces.ravel()
        first = np.full(len(mesh.vertices), -1)
        first[used[::-1]] = np.arange(len(used))[::-1]  # the first corner of the face list that uses each vertex
        corner = first[vertices]
        if (corner < 0).any():
            lost = int(vertices[int((corner < 0).argmax())])
            raise InputError(f"Vertex {lost} belongs to no face of the mesh; choose one on the surface.")
        barycentric = np.zeros((len(vertices), 3))
        barycentric[np.arange(len(vertices)), corner % 3] = 1
        return cls(tuple(names), corner // 3, barycentric)
