"""The points that join a scan to a rig: twelve features, and lines along lips and lids."""

from __future__ import annotations

import numpy as np

from blendcap.data import InputError, Mesh, Rig, SurfacePoints

FEATURES = {  # the twelve of the thesis, and where they are among the 68 landmarks
    "nose_tip": "30",
    "between_eyes": "27",
    "eye_outer_right": "36",
    "eye_inner_right": "39",
    "eye_inner_left": "42",
    "eye_outer_left": "45",
    "cheek_left": "",
    "cheek_right": "",
    "lip_corner_right": "48",
    "lip_corner_left": "54",
    "lip_top": "51",
    "lip_bottom": "57",
}
LINES = ("lips_upper", "lips_lower", "lids_upper_left", "lids_lower_left", "lids_upper_right", "lids_lower_right")
ENDS = {  # each line runs from the subject's right to the left
    "lips": ("lip_corner_right", "lip_corner_left"),
    "lids_left": ("eye_inner_left", "eye_outer_left"),
    "lids_right": ("eye_outer_right", "eye_inner_right"),
}
ON_A_LINE = 9  # points of each line, evenly spaced between the corners


def contact_of(line: str) -> tuple[str, int]:
    """The contact whose vertices lie on a line, and which of each pair: 0 above, 1 below."""
    return line.replace("_upper", "").replace("_lower", ""), int("lower" in line)


def line_names(line: str) -> list[str]:
    """Names of the points of a line, from the subject's right."""
    return [f"{line}_{k + 1}" for k in range(ON_A_LINE)]


def rig_landmarks(rig: Rig) -> SurfacePoints:
    """The points of a rig that `find_landmarks` finds on a scan, by the same names, from what the rig knows.

    Features come from its points "landmarks68" and "markers50" (the cheeks; left out where a rig lacks them), lines
    from its contacts.

    Raises
    ------
    InputError
        If the rig has neither landmarks nor contacts.
    """
    parts = []
    if "landmarks68" in rig.points:
        own = {name: number for name, number in FEATURES.items() if number}
        found = rig.points["landmarks68"].select(list(own.values()))
        parts.append(SurfacePoints(tuple(own), found.faces, found.barycentric))
    if {"cheek_left", "cheek_right"} <= set(rig.points["markers50"].names if "markers50" in rig.points else ()):
        parts.append(rig.points["markers50"].select(["cheek_left", "cheek_right"]))
    for line in LINES:
        contact = contact_of(line)[0]
        if contact in rig.contacts and len(rig.contacts[contact]) > 1:
            parts.append(_on_line(rig, line))
    if not parts:
        raise InputError(
            f"The rig {rig.name!r} knows neither 68 landmarks nor contacts; give it landmarks: "
            "blendcap rig convert RIG OUT.glb --points landmarks68.json."
        )
    names = tuple(name for part in parts for name in part.names)
    return SurfacePoints(
        names, np.concatenate([p.faces for p in parts]), np.concatenate([p.barycentric for p in parts])
    )


def _on_line(rig: Rig, line: str) -> SurfacePoints:
    """Points evenly spaced on the chain of a contact, from corner to corner where the rig knows the corners."""
    contact, side = contact_of(line)
    chain = rig.contacts[contact][:, side]
    chain = chain[np.argsort(rig.mesh.vertices[chain, 0], kind="stable")]
    places = rig.mesh.vertices[chain]
    if "landmarks68" in rig.points:
        corners = rig.points["landmarks68"].select([FEATURES[end] for end in ENDS[contact]]).positions(rig.mesh)
        places = np.concatenate([corners[:1], places, corners[1:]])
    _, at = along(places)
    if len(places) > len(chain):
        at = np.clip(at - 1, 0, len(chain) - 1)
    return _between(rig.mesh, line_names(line), chain, at)


def along(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evenly spaced points (ON_A_LINE, D) inside a line of points (P, D), and their places in it, 0 to P - 1."""
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    length = np.concatenate([[0], np.cumsum(steps)])
    wanted = np.linspace(0, length[-1], ON_A_LINE + 2)[1:-1]
    at = np.interp(wanted, length, np.arange(len(places)))
    low = np.minimum(at.astype(int), len(places) - 2)
    share = (at - low)[:, None]
    return places[low] * (1 - share) + places[low + 1] * share, at


def _between(mesh: Mesh, names: list[str], chain: np.ndarray, at: np.ndarray) -> SurfacePoints:
    """Points on the edges of a chain of vertices; where two neighbors share no triangle, at the nearer one."""
    low = np.minimum(at.astype(int), len(chain) - 2)
    share = at - low
    faces, weights = np.empty(len(names), dtype=np.int64), np.zeros((len(names), 3))
    for k, (a, b, t) in enumerate(zip(chain[low], chain[low + 1], share, strict=True)):
        both = np.flatnonzero((mesh.faces == a).any(1) & (mesh.faces == b).any(1))
        if not len(both):
            a, b, t = (a, a, 0.0) if t < 0.5 else (b, b, 0.0)  # noqa: PLW2901
            both = np.flatnonzero((mesh.faces == a).any(1))
        faces[k] = both[0]
        weights[k, mesh.faces[both[0]] == a] = 1 - t
        weights[k, mesh.faces[both[0]] == b] += t
    return SurfacePoints(tuple(names), faces, weights)
