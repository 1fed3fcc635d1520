"""Small faces with a known truth: a mask with a nose, and scans of it with another net of triangles."""

import numpy as np

from blendcap.data import Mesh, SurfacePoints


def sheet(columns, rows, jitter=0.0, seed=0):
    """Parameters (V, 2) in [-1, 1]² and triangles of a sheet."""
    u, v = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
    rng, step = np.random.default_rng(seed), 2 / columns
    inner = (np.abs(u) < 1) & (np.abs(v) < 1)
    u = u + jitter * step * rng.uniform(-1, 1, u.shape) * inner
    v = v + jitter * step * rng.uniform(-1, 1, v.shape) * inner
    number = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = (x.ravel() for x in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    return np.stack([u.ravel(), v.ravel()], 1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def mask(parameters, width=70.0, nose=20.0, chin=0.0):
    """Positions (V, 3), mm, of parameters on a face of this width, with this nose."""
    u, v = parameters.T
    depth = 60 * (1 - 0.5 * u**2 - 0.3 * v**2) + nose * np.exp(-((u / 0.2) ** 2) - (v / 0.3) ** 2)
    depth += 6 * np.exp(-(((np.abs(u) - 0.45) / 0.15) ** 2) - ((v - 0.4) / 0.12) ** 2)
    return np.stack([width * u, 95 * v + chin * np.minimum(v, 0) ** 2, depth], 1)


def template(columns=21, rows=25):
    parameters, faces = sheet(columns, rows)
    return Mesh(mask(parameters), faces), parameters


def scan(seed=1, noise=0.0, hole=None, **shape):
    """A finer, uneven scan of a mask of another shape; `hole` = (u, v, radius) is cut out."""
    parameters, faces = sheet(49, 57, jitter=0.3, seed=seed)
    vertices = mask(parameters, **shape)
    vertices[:, 2] += noise * np.random.default_rng(seed).normal(size=len(vertices))
    if hole is not None:
        away = np.hypot(parameters[:, 0] - hole[0], parameters[:, 1] - hole[1]) > hole[2]
        faces = faces[away[faces].all(1)]
    order = np.random.default_rng(seed).permutation(len(vertices))
    return Mesh(vertices[order], np.argsort(order)[faces])


def landmarks(mesh, parameters, **shape):
    """Twelve points of the template, and where they are on the mask of another shape."""
    wanted = np.array([[0, 0], [0, 0.5], [-0.45, 0.4], [0.45, 0.4], [-0.3, -0.5], [0.3, -0.5], [0, -0.6], [0, 0.9],
                       [0, -0.95], [-0.8, 0], [0.8, 0], [0, -0.3]])  # fmt: skip
    rows = np.array([np.argmin(((parameters - w) ** 2).sum(1)) for w in wanted])
    points = SurfacePoints.at_vertices([f"p{i}" for i in range(len(rows))], rows, mesh)
    return points, mask(parameters[rows], **shape)
