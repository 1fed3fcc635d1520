"""A raw scan is made ready: unit, orientation, size; and what is no scan of one head is refused in a sentence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.numerics.similarity import align
from blendcap.numerics.surfaces import face_normals, parts

UNITS = {"millimetres": 1.0, "centimetres": 10.0, "inches": 25.4, "decimetres": 100.0, "metres": 1000.0}
SHORT = {"mm": "millimetres", "cm": "centimetres", "in": "inches", "dm": "decimetres", "m": "metres"}
HEAD = (120.0, 650.0)  # mm: the longest side of a scan of a face, a head or a bust
TYPICAL = 280.0  # mm
BODY = 4.0  # a box with sides in this ratio is no face: a mask reaches 3.3, a standing body 5
SECOND = 0.5  # a second surface of this share of the first's area is a second face
SIZES = (0.8, 1.25)  # of a face beside the template's; beyond it the unit is wrong
HALF = (0.5, 2.0)  # of a face beside the template's: beyond it a unit that somebody stated is looked at again
LOOSE = 0.1  # share of vertices without a triangle: files that were cut short have more
MOST = 400_000  # triangles; a registration gains nothing from more


@dataclass(frozen=True, eq=False)
class ReadyScan:
    """A scan that registration can use.

    Parameters
    ----------
    mesh : Mesh
        mm, outward normals, no degenerate triangles, at most 400,000 of them.
    unit_mm : float
        What the file's numbers were multiplied by.
    notes : tuple of str
        What was found and changed, a sentence each.
    """

    mesh: Mesh
    unit_mm: float
    notes: tuple[str, ...]


def ready_scan(scan: Mesh, unit_mm: float | None = None) -> ReadyScan:
    """Make a raw scan ready for `register`.

    Parameters
    ----------
    scan : Mesh
        In any unit.
    unit_mm : float, optional
        How many mm one unit of the scan is; found from the size of a head if not given.

    Raises
    ------
    InputError
        If it is a body, holds two faces, was cut short, or has no size that a head has in any unit.
    """
    notes: list[str] = []
    vertices, faces, uv_faces = np.asarray(scan.vertices), scan.faces, scan.uv_faces
    whole = np.linalg.norm(face_normals(vertices, faces), axis=1) > 0
    if not whole.any():
        raise InputError("The scan has no triangle with an area; export a surface, not points or lines.")
    loose = 1 - len(np.unique(faces)) / len(vertices)
    if loose > LOOSE:
        raise InputError(
            f"{loose:.0%} of the scan's vertices belong to no triangle: the file was cut short, or holds loose points; "
            "export it again, without them."
        )
    if not whole.all():
        notes.append(f"{(~whole).sum():,} degenerate triangles are left out.")
        faces, uv_faces = faces[whole], None if uv_faces is None else uv_faces[whole]
    _refuse_what_is_no_head(vertices, faces)
    if unit_mm is None:
        unit_mm, word = _unit(vertices[np.unique(faces)])
        if word != "millimetres":
            notes.append(f"The scan is taken to be in {word}: only then is it as large as a head.")
    if _inward(vertices, faces):
        faces, uv_faces = faces[:, ::-1], None if uv_faces is None else uv_faces[:, ::-1]
        notes.append("The scan's triangles faced inwards and are turned round.")
    vertices = unit_mm * vertices
    if len(faces) > MOST:
        count = len(faces)
        vertices, faces = clustered(vertices, faces, MOST)
        notes.append(
            f"The scan's {count:,} triangles are joined to {len(faces):,} for the fit, its texture is not used."
        )
        return ReadyScan(Mesh(vertices, faces), unit_mm, tuple(notes))
    mesh = Mesh(vertices, faces, uv=scan.uv, uv_faces=uv_faces, texture=scan.texture)
    return ReadyScan(mesh, unit_mm, tuple(notes))


def unit_by_landmarks(pairs: tuple[SurfacePoints, np.ndarray] | None, template: Rig) -> tuple[float | None, str | None]:
    """The scan's unit in mm by pairs of landmarks, if there are enough, and what to say of it; see `unit_by_face`."""
    if pairs is None or len(pairs[1]) < 3:
        return None, None
    return unit_by_face(float(align(pairs[0].positions(template.mesh), pairs[1])[2]))


def unit_by_face(template_size: float) -> tuple[float, str | None]:
    """The unit of a scan in mm, from how large its face is against a template's in mm, and a sentence if it is not 1.

    Parameters
    ----------
    template_size : float
        Units of the scan that one mm of the template takes, by landmarks.
    """
    word = min(UNITS, key=lambda name: abs(np.log(UNITS[name] * template_size)))
    if not SIZES[0] < UNITS[word] * template_size < SIZES[1]:
        return 1 / template_size, (
            f"The scan's face has no face's size in any usual unit; it is scaled by {1 / template_size:.4g} to be as "
            "large as the template's. Say the unit if you know it."
        )
    said = f"The scan is taken to be in {word}: only then is its face as large as a face."
    return UNITS[word], None if word == "millimetres" else said


def check_unit(stated: str, scan: Mesh, pairs: tuple[SurfacePoints, np.ndarray] | None, template: Rig) -> str | None:
    """Refuse a unit that is plainly not the scan's; a sentence where the size is odd and no unit mends it.

    Parameters
    ----------
    stated : str
        mm, cm, in, dm or m.
    scan : Mesh
        In mm, if the unit is right.
    pairs : (SurfacePoints (L), (L, 3) float64) or None
        Landmarks on the template and on the scan, mm. Without them only the size of the whole scan tells.
    template : Rig

    Raises
    ------
    InputError
        If the face, or without landmarks the scan, is less than half or more than twice as large as it may be, and
        is not in another unit.
    """
    if pairs is None:
        size, fits, what = float(np.ptp(scan.vertices[np.unique(scan.faces)], axis=0).max()), HEAD, "mm long"
        if HEAD[0] * HALF[0] <= size <= HEAD[1] * HALF[1]:
            return None
    else:
        size, fits = float(align(pairs[0].positions(template.mesh), pairs[1])[2]), SIZES
        what = "times as large as the template's"
        if HALF[0] <= size <= HALF[1]:
            return None
    word = SHORT[stated]
    said = f"With the scan in {word} its {'head' if pairs is None else 'face'} is {size:.4g} {what}"
    better = [short for short, own in SHORT.items() if fits[0] < size * UNITS[own] / UNITS[word] < fits[1]]
    if better:
        raise InputError(f"{said}, in {SHORT[better[0]]} it has the size of one; say --unit {better[0]}.")
    return f"{said}; leave the unit out to have it scaled."


def resized(scan: ReadyScan, size: float) -> ReadyScan:
    """The scan in the size of the template, and a sentence, if its face came out as large as no face; else itself.

    Parameters
    ----------
    size : float
        Of the registered face, in sizes of the template's. Only for a unit that was guessed from the whole scan.
    """
    if SIZES[0] < size < SIZES[1]:
        return scan
    unit_mm = scan.unit_mm / size
    said = (
        f"The face came out {size:.2f} times as large as the template's, so the unit was wrong: the scan is scaled by "
        f"{unit_mm:.4g} to be as large. Say the unit if you know it, or give landmarks."
    )
    return ReadyScan(scan.mesh.with_vertices(scan.mesh.vertices / size), unit_mm, (*scan.notes, said))


def clustered(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a mesh whose vertices are joined in cells of a grid, until at most `most` faces are left.

    One pass over the mesh for each try, so that millions of triangles take seconds and little memory.
    """
    area = 0.5 * np.linalg.norm(face_normals(vertices, faces), axis=1).sum()
    cell = np.sqrt(area / most)  # two triangles a cell of the surface, and a border for the roughness
    low = vertices.min(0)
    while True:
        place = np.floor((vertices - low) / cell).astype(np.int64)
        spans = place.max(0) + 1
        key = (place[:, 0] * spans[1] + place[:, 1]) * spans[2] + place[:, 2]
        _, joined, count = np.unique(key, return_inverse=True, return_counts=True)
        corners = joined.ravel()[faces]
        keep = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
        if keep.sum() <= most:
            break
        cell *= 1.1 * np.sqrt(keep.sum() / most)
    middle = np.stack([np.bincount(joined.ravel(), vertices[:, k], len(count)) for k in range(3)], 1) / count[:, None]
    corners = corners[keep]
    first = np.argmin(corners, axis=1)[:, None]  # the same triangle twice is one; its turn is kept
    turned = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
    used, faces = np.unique(np.unique(turned, axis=0), return_inverse=True)
    return middle[used], faces.reshape(-1, 3)


def _refuse_what_is_no_head(vertices: np.ndarray, faces: np.ndarray) -> None:
    part = parts(faces, len(vertices))[faces[:, 0]]
    area = np.bincount(part, np.linalg.norm(face_normals(vertices, faces), axis=1))
    first, second = np.argsort(area)[::-1][:2] if np.count_nonzero(area) > 1 else (int(np.argmax(area)), None)
    boxes = [_box(vertices, faces, part == p) for p in (first, second) if p is not None]
    if second is not None and area[second] > SECOND * area[first] and _apart(*boxes):
        raise InputError(
            "The scan holds two separate surfaces of about the same size, side by side, as of two faces; "
            "save each to a file of its own."
        )
    sides = np.ptp(boxes[0], axis=0)
    if sides.max() > BODY * sides.min() and sides.min() > 0:
        raise InputError(
            f"The scan is {sides.max() / sides.min():.1f} times as long as deep, as a whole body is; "
            "cut it to the head and neck."
        )


def _box(vertices, faces, chosen) -> np.ndarray:
    corners = vertices[np.unique(faces[chosen])]
    return np.stack([corners.min(0), corners.max(0)])


def _apart(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(((one[1] < other[0]) | (other[1] < one[0])).any())


def _unit(vertices: np.ndarray) -> tuple[float, str]:
    """The unit in which a scan has the size of a head; millimetres wherever they will do."""
    size = float(np.ptp(vertices, axis=0).max())
    fits = {word: unit for word, unit in UNITS.items() if HEAD[0] <= size * unit <= HEAD[1]}
    if "millimetres" in fits:
        return 1.0, "millimetres"
    if not fits:
        raise InputError(
            f"The scan's longest side is {size:.4g}, which is no head in mm, cm, inches, dm or m; "
            "cut away what is not the head, or say the unit."
        )
    word = min(fits, key=lambda name: abs(np.log(size * fits[name] / TYPICAL)))
    return fits[word], word


def _inward(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether a surface around the middle of its points faces them."""
    normals, middle = face_normals(vertices, faces), vertices[faces].mean(1)
    center = np.median(middle, axis=0)
    center = (center + (middle.min(0) + middle.max(0)) / 2) / 2
    return bool(((middle - center) * normals).sum() < 0)
