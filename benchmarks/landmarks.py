"""Landmarks on people whom no detector was trained on: their textures, and scans of them with atlases of their own."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import blendcap
from blendcap.data import InputError, Mesh, SurfacePoints
from blendcap.modeling.landmark_names import FEATURES, LINES, line_names
from blendcap.modeling.landmarks import search_landmarks
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.scans import make_scan
from landmark_faces import UV_SIZE, Face, face, on_texture
from results import write_section

PEOPLE = range(1020, 1040)  # never seen in training, nor looked at before
ON_LINES = [name for line in LINES for name in line_names(line)]


def main() -> None:
    logging.getLogger("blendcap").setLevel(logging.ERROR)
    rng = np.random.default_rng(4)
    people = [face(seed, rng) for seed in PEOPLE]
    rows = [textures(people, method) for method in ("frontal", "uv")] + [prior_only(people)]
    text = "\n".join([
        f"{len(people)} mannequins with open, closed and half-closed lids and a little expression. Errors on the",
        "texture, in percent of its width (lines: of its width in mm), and in mm on the surface.",
        "",
        "| method | features within 2 % | features, mean % | mm | lines, mean % | mm | no face |",
        "|---|---|---|---|---|---|---|",
        *rows,
        "",
        "`uv` is the thesis' way. The last row always answers where features lie on average, which the layout that all",
        "mannequins share makes easy.",
        "",
        scans(),
    ])  # fmt: skip
    write_section("Landmarks", "python benchmarks/landmarks.py", text)
    print(text)


def textures(people: list[Face], method: str) -> str:
    features, lines, far, far_lines, lost = [], [], [], [], 0
    for person in people:
        try:
            points = search_landmarks(person.mesh, method=method).points
        except InputError:
            lost += 1
            continue
        width = texture_width(person)
        known = [name for name in FEATURES if name in points.names]
        off = on_texture(Face(person.mesh, points), known) - on_texture(person, known)
        features += [*np.linalg.norm(off, axis=1) / UV_SIZE * 100, *[np.inf] * (len(FEATURES) - len(known))]
        far += list(distances(points, person, known))
        known = [name for name in ON_LINES if name in points.names]
        far_lines += list(distances(points, person, known))
        lines += list(100 * distances(points, person, known) / width)
    shares = np.array(features)
    within = (shares <= 2).sum() / (len(people) * len(FEATURES))
    mean = [np.mean(np.array(values)[np.isfinite(values)]) for values in (features, far, lines, far_lines)]
    return f"| {method} | {within:.1%} | " + " | ".join(f"{value:.2f}" for value in mean) + f" | {lost} |"


def distances(points: SurfacePoints, person: Face, names) -> np.ndarray:
    """How far points lie from the truth, (M,), mm."""
    return np.linalg.norm(places(points, names, person.mesh) - places(person.points, names, person.mesh), axis=1)


def texture_width(person: Face) -> float:
    """The width of the texture in mm, by the features' triangles: a lid line may leave the skin's chart."""
    mesh, faces = person.mesh, person.points.select(list(FEATURES)).faces
    corners, flat = mesh.vertices[mesh.faces[faces]], np.asarray(mesh.uv)[np.asarray(mesh.uv_faces)[faces]]
    edges, chart = corners[:, 1:] - corners[:, :1], flat[:, 1:] - flat[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / np.abs(np.linalg.det(chart))
    return float(np.median(np.sqrt(areas)))


def prior_only(people: list[Face]) -> str:
    from blendcap.modeling.detectors import shipped

    model = shipped("uv").points
    off = np.concatenate([on_texture(person, model.names) - model.mean for person in people])
    shares = np.linalg.norm(off, axis=1) / UV_SIZE * 100
    return f"| always the mean | {np.mean(shares <= 2):.1%} | {shares.mean():.2f} | | | | |"


def scans() -> str:
    """Raw scans with noise, holes, hair, seams: the features that are among the 68 landmarks, mm."""
    rows = []
    numbered = {name: int(number) for name, number in FEATURES.items() if number}
    made = [make_scan(make_performer(blendcap.mannequin(seed), seed=seed), seed=seed) for seed in PEOPLE]
    for kind in ("texture and form", "form alone"):
        errors, lost = [], 0
        for scan in made:
            mesh = scan.mesh if kind == "texture and form" else Mesh(scan.mesh.vertices, scan.mesh.faces)
            try:
                points = search_landmarks(mesh).points
            except InputError:
                lost += 1
                continue
            known = [name for name in numbered if name in points.names]
            truth = scan.landmarks[[numbered[name] for name in known]]
            errors += list(np.linalg.norm(places(points, known, mesh) - truth, axis=1))
        values = np.array(errors)
        rows.append(
            f"| {kind} | {np.mean(values):.2f} | {np.percentile(values, 90):.2f} | {np.max(values):.1f} | {lost} |"
        )
    head = "| 20 raw scans of performers | features, mean mm | 90 % | worst | no face |\n|---|---|---|---|---|\n"
    return head + "\n".join(rows)


def places(points: SurfacePoints, names, mesh: Mesh) -> np.ndarray:
    return points.select(list(names)).positions(mesh)


if __name__ == "__main__":
    main()
