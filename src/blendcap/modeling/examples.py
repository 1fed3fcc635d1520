"""Examples make a transferred rig personal: a few registered expressions of the actor refine every shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from blendcap.data import InputError, Mesh, Rig
from blendcap.data.checks import array
from blendcap.data.names import canonical
from blendcap.modeling.contacts import find_contacts
from blendcap.modeling.differences import Differences, Faces, surface_of
from blendcap.modeling.facial_rigging import make_surface, rig_from_examples, shapes_from_examples
from blendcap.modeling.fields import (
    SAMPLES,
    WEIGHT_ERROR,
    FieldProblem,
    fit_fields,
    smooth_functions,
    spread_out,
)
from blendcap.modeling.keeping import keep
from blendcap.modeling.parts import pieces
from blendcap.numerics.boxls import solve_box
from blendcap.numerics.geodesic import sewn_vertices

Method = Literal["fields", "paper"]

ROUNDS = 2  # shapes, weights, shapes
LOCAL = 0.1  # β of Eq. 28 around the fields: what a triangle alone may deviate
MOVES = 0.5  # mm: what a shape must move to be learned from


@dataclass(frozen=True, eq=False)
class Refinement:
    """A refined rig and what its making can prove.

    Parameters
    ----------
    rig : Rig
    weights : (J, N) float64
        Of the examples: as given or solved first, and then refined with the shapes.
    errors : (J,) float64
        What the rig lacks of each example under these weights, mm, root mean square over the vertices.
    energies : {term: (R,) float64}
        What each term costs after each round; those of "fields" are of the fields alone, before details and contact.
    max_kkt : float
        Largest optimality residual of the weights.
    residual : float
        Largest relative residual of the linear solves.
    """

    rig: Rig
    weights: np.ndarray
    errors: np.ndarray
    energies: dict[str, np.ndarray]
    max_kkt: float
    residual: float


def refine_rig(
    rig: Rig, example_meshes: Sequence[Mesh], weights: np.ndarray | None = None, *, method: Method = "fields"
) -> Rig:
    """Refine a transferred rig with a few expressions of the same person.

    Parameters
    ----------
    rig : Rig
        The person's rig, as `transfer_rig` makes it.
    example_meshes : sequence of J Mesh
        Expressions registered to the rig's topology, the head where the neutral's is.
    weights : (J, N) array, optional
        What the performer was asked for, as weights of the rig. Without them they are solved for first, and how strong
        each shape is cannot be told from how strongly it was used: give them if you can.
    method : "fields" or "paper"
        "fields" learns smooth personal fields (`blendcap.modeling.fields`), then details around them; "paper" is
        example-based facial rigging (Eq. 27 to 29).

    Raises
    ------
    InputError
        If there is no example, one has other vertices or triangles, or a weight is not a number.
    """
    return refine(rig, example_meshes, weights, method=method).rig


def refine(
    rig: Rig, example_meshes: Sequence[Mesh], weights: np.ndarray | None = None, *, method: Method = "fields"
) -> Refinement:
    """The same as `refine_rig`, with the certificate beside the rig."""
    if method not in ("fields", "paper"):
        raise InputError(f"There is no method {method!r} to refine a rig; choose fields or paper.")
    moved = _moved(rig, example_meshes)
    given = _first_weights(rig, moved) if weights is None else _checked(rig, weights, len(moved))
    error = 0.0 if weights is None else WEIGHT_ERROR  # solved weights have taken up what the shapes lack already
    if method == "paper":
        surface = make_surface(rig.mesh.vertices, rig.mesh.faces)
        made = rig_from_examples(surface, rig.deltas.astype(np.float64), moved, given, rig.bounds)
        refined = replace(rig, deltas=made.deltas)
        errors = _errors(refined, moved, made.weights)
        return Refinement(refined, made.weights, errors, made.energies, made.max_kkt, made.residual)
    return _with_fields(rig, moved, given, error)


def asked_for(rig: Rig, names: Sequence[str]) -> np.ndarray | None:
    """Weights (J, N) of examples that are all named after a shape of the rig, in any spelling; None otherwise."""
    place = {canonical(name): i for i, name in enumerate(rig.names)}
    rows = [place.get(canonical(name)) for name in names]
    if any(row is None for row in rows):
        return None
    weights = np.zeros((len(names), len(rig.names)))
    for j, row in enumerate(rows):
        weights[j, row] = 1
    return weights


def _moved(rig: Rig, meshes: Sequence[Mesh]) -> np.ndarray:
    """Examples less the neutral (J, V, 3), checked."""
    if not len(meshes):
        raise InputError("There is no example to learn from; give at least one expression besides the neutral.")
    for place, mesh in enumerate(meshes):
        if len(mesh.vertices) != len(rig.mesh.vertices) or not np.array_equal(mesh.faces, rig.mesh.faces):
            raise InputError(
                f"Example {place} has other vertices or triangles than the rig {rig.name!r}; "
                "register the rig's neutral to it first."
            )
    return np.stack([mesh.vertices for mesh in meshes]) - rig.mesh.vertices


def _checked(rig: Rig, weights, examples: int) -> np.ndarray:
    return array(weights, (examples, len(rig.names)), "The examples' weights", finite=True)


def _first_weights(rig: Rig, moved: np.ndarray) -> np.ndarray:
    """The weights (J, N) with which the rig comes nearest to the examples."""
    flat = rig.deltas.reshape(len(rig.names), -1).astype(np.float64)
    linear = -(moved.reshape(len(moved), -1) @ flat.T)
    return solve_box(flat @ flat.T, linear, lower=rig.bounds[:, 0], upper=rig.bounds[:, 1])[0]


def _with_fields(rig: Rig, moved: np.ndarray, given: np.ndarray, error: float) -> Refinement:
    moving = learned_from(rig)
    waves = smooth_functions(rig.mesh.vertices[moving])
    at = moving[spread_out(rig.mesh.vertices[moving], SAMPLES)]
    shapes = rig.deltas[:, at].astype(np.float64).transpose(1, 0, 2)
    problem = FieldProblem(shapes, waves(rig.mesh.vertices[at]), rig.mirror)
    seen, weights = moved[:, at].transpose(1, 0, 2), given
    costs: list[dict[str, float]] = []
    max_kkt = 0.0
    fields = fit_fields(problem, seen, weights, error)
    costs.append(fields.energies)
    for _ in range(ROUNDS - 1):
        weights, kkt = _weights(problem, fields.applied(shapes, problem.waves), seen, given, rig.bounds)
        fields = fit_fields(problem, seen, weights, scales=(fields.scale,))
        max_kkt = max(max_kkt, kkt)
        costs.append(fields.energies)
    change, local = _local(rig, moving, fields.applied, waves, moved, weights)
    energies = {name: np.array([cost[name] for cost in costs]) for name in costs[0]}
    deltas, kept = kept_shapes(rig, change)
    refined = replace(rig, deltas=deltas.astype(np.float32))
    residual = max(fields.residual, local, kept)
    return Refinement(refined, weights, _errors(refined, moved, weights), energies, max_kkt, residual)


def _errors(rig: Rig, moved: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Distances (J,) of the rig under weights (J, N) from examples less the neutral (J, V, 3), root mean squares."""
    return np.sqrt(((np.tensordot(weights, rig.deltas, axes=1) - moved) ** 2).sum(2).mean(1))


def _local(rig: Rig, moving: np.ndarray, applied, waves, moved: np.ndarray, weights: np.ndarray):
    """What is added to the shapes (N, V, 3): the fields, and around them what each triangle alone can tell (Eq. 27).

    With it comes the relative residual of the solve.
    """
    shapes = rig.deltas.astype(np.float64)
    old = shapes[:, moving].transpose(1, 0, 2)
    shapes[:, moving] = applied(old, waves(rig.mesh.vertices[moving])).transpose(1, 0, 2)
    surface = make_surface(rig.mesh.vertices, sewn_vertices(rig.mesh.vertices, rig.deltas)[rig.mesh.faces])
    new = shapes_from_examples(surface, shapes, moved, weights, LOCAL)
    change = np.zeros_like(shapes)
    change[:, moving] = new[:, moving] - rig.deltas[:, moving]
    return change, surface.factor.residual


def learned_from(rig: Rig) -> np.ndarray:
    """Vertices of the skin that some shape moves; eyeballs and teeth are solid and learn nothing."""
    skin = pieces(sewn_vertices(rig.mesh.vertices, rig.deltas)[rig.mesh.faces], len(rig.mesh.vertices))[0]
    moving = np.intersect1d(skin, rig.moving_vertices(MOVES))
    if len(moving) < 4:
        raise InputError(f"No shape of the rig {rig.name!r} moves its skin by more than {MOVES} mm; check its unit.")
    return moving


def _weights(problem: FieldProblem, shapes, seen, given, bounds) -> tuple[np.ndarray, float]:
    """The most probable weights (J, N) under the changed shapes, and their largest optimality residual."""
    pull = 1 / WEIGHT_ERROR**2
    gram = problem.gram(shapes, shapes) + pull * np.eye(len(bounds))
    weights, certificate = solve_box(0.5 * (gram + gram.T), -problem.gram(seen, shapes) - pull * given,
                                     lower=bounds[:, 0], upper=bounds[:, 1])  # fmt: skip
    return weights, certificate.max_kkt


def kept_shapes(rig: Rig, change: np.ndarray) -> tuple[np.ndarray, float]:
    """The changed shapes (N, V, 3) with the rig's own contact, clear eyeballs and solid bodies kept; the residual."""
    sewn = sewn_vertices(rig.mesh.vertices, rig.deltas)
    faces = sewn[rig.mesh.faces]
    parts = pieces(faces, len(rig.mesh.vertices))
    same = Faces(rig.mesh.vertices, rig.deltas.astype(np.float64), rig.mesh.vertices, faces, parts, 1.0)
    stiffness, areas = surface_of(rig.mesh.vertices, faces)
    solved = Differences(change, stiffness, areas, 0.0)
    deltas, residual = keep(rig, same, solved, sewn, dict(rig.contacts) or find_contacts(rig))
    return deltas[:, sewn], residual
