"""Certificates are of the answer that is returned: wrong solves show, and energies are those of the answer."""

from dataclasses import replace

import numpy as np
import pytest

import masks
from blendcap.data import InputError, Mesh
from blendcap.modeling import affine, closing, differences, examples, facial_rigging, fields
from blendcap.modeling.differences import Differences, hang
from blendcap.modeling.examples import refine
from blendcap.modeling.facial_rigging import make_surface, own_weights
from blendcap.modeling.registration import register
from blendcap.modeling.schedule import SCHEDULES, Schedule
from blendcap.modeling.transfer import transfer
from sheet import sheet_rig
from spoil import spoil_factors

RIG = sheet_rig()
FACE = RIG.mesh.with_vertices(RIG.mesh.vertices * [1.1, 0.95, 1] + 3 * np.sin(RIG.mesh.vertices[:, [1, 2, 0]] / 30))
WRONG, RIGHT = 1e-8, 1e-9


def some_examples(count=6):
    rng = np.random.default_rng(0)
    weights = rng.uniform(0.3, 1, (count, len(RIG.names))) * (rng.random((count, len(RIG.names))) < 0.3)
    stronger = replace(RIG, deltas=1.2 * RIG.deltas)
    return [RIG.mesh.with_vertices(vertices) for vertices in stronger.pose(weights)], weights


@pytest.mark.parametrize(("method", "module"), [("paper", differences), ("contact", differences), ("contact", closing)])
def test_a_wrong_solve_shows_in_the_residual_of_transfer(monkeypatch, method, module):
    assert transfer(RIG, FACE, method=method).residual < RIGHT
    spoil_factors(monkeypatch, module)
    assert transfer(RIG, FACE, method=method).residual > WRONG


def test_wrong_pulls_on_contact_pairs_show_in_the_residual_of_transfer(monkeypatch):
    real = np.linalg.solve
    monkeypatch.setattr(closing.np.linalg, "solve", lambda matrix, right: 1.01 * real(matrix, right))
    assert transfer(RIG, FACE).residual > 1e-4


def test_a_wrong_solve_shows_where_a_piece_hangs_on_the_skin(monkeypatch):
    face = make_surface(RIG.mesh.vertices, RIG.mesh.faces)
    stiffness = (face.weighted @ face.gradient).tocsc()
    piece, field = np.arange(50), RIG.deltas.astype(np.float64)
    solved = Differences(field.copy(), stiffness, np.ones(len(stiffness.indptr) - 1), 0.0)
    assert hang(solved, field.copy(), piece, piece + 50) < RIGHT
    spoil_factors(monkeypatch, differences)
    assert hang(solved, field.copy(), piece, piece + 50) > WRONG


@pytest.mark.parametrize(("method", "module"),
                         [("paper", facial_rigging), ("fields", facial_rigging), ("fields", closing)])  # fmt: skip
def test_a_wrong_solve_shows_in_the_residual_of_refined_shapes(monkeypatch, method, module):
    meshes, weights = some_examples()
    assert refine(RIG, meshes, weights, method=method).residual < RIGHT
    spoil_factors(monkeypatch, module)
    assert refine(RIG, meshes, weights, method=method).residual > WRONG


def test_wrong_fields_show_in_the_residual_of_refined_shapes(monkeypatch):
    meshes, weights = some_examples()
    real = fields.cho_solve
    monkeypatch.setattr(fields, "cho_solve", lambda factor, right: 1.001 * real(factor, right))
    assert refine(RIG, meshes, weights).residual > 1e-5


@pytest.mark.parametrize(("method", "module"), [("paper", facial_rigging), ("fields", examples)])
def test_the_worst_weights_of_all_rounds_are_reported(monkeypatch, method, module):
    meshes, weights = some_examples()
    real, certificates = module.solve_box, []

    def first_is_bad(*args, **options):
        answer, certificate = real(*args, **options)
        certificates.append(certificate)
        return answer, replace(certificate, max_kkt=float(len(certificates) == 1))

    monkeypatch.setattr(module, "solve_box", first_is_bad)
    assert refine(RIG, meshes, weights, method=method).max_kkt == pytest.approx(1)


def test_the_papers_energies_are_those_of_the_returned_shapes_and_weights():
    meshes, weights = some_examples()
    made = refine(RIG, meshes, weights, method="paper")
    surface = make_surface(RIG.mesh.vertices, RIG.mesh.faces)

    def gradients(motions):  # (F, n, 9)
        stacked = [(surface.gradient @ motion).reshape(-1, 9) for motion in np.asarray(motions, np.float64)]
        return np.stack(stacked, axis=1)

    seen = gradients([mesh.vertices - RIG.mesh.vertices for mesh in meshes])
    old, new = gradients(RIG.deltas), gradients(made.rig.deltas)
    fit = surface.areas @ ((np.einsum("jn,fnk->fjk", made.weights, new) - seen) ** 2).sum((1, 2))
    regular = surface.areas @ (own_weights(old) * ((new - old) ** 2).sum(2)).sum(1)
    assert made.energies["fit"][-1] == pytest.approx(fit, rel=1e-4)
    assert made.energies["regularization"][-1] == pytest.approx(facial_rigging.BETA[1] * regular, rel=1e-4)


@pytest.mark.parametrize("method", ["fields", "paper"])
def test_the_errors_of_the_examples_are_those_of_the_returned_rig(method):
    meshes, weights = some_examples()
    made = refine(RIG, meshes, weights, method=method)
    for mesh, error, row, asked in zip(meshes, made.errors, made.weights, weights, strict=True):
        away, before = (np.linalg.norm(r.pose(w) - mesh.vertices, axis=1) for r, w in ((made.rig, row), (RIG, asked)))
        assert error == pytest.approx(np.sqrt((away**2).mean()), rel=1e-6)
        assert error <= 0.6 * np.sqrt((before**2).mean())


def test_what_a_shape_deforms_may_change_and_the_rest_is_held():
    """w of Eq. 28: ((1 + 0) / 0.1)² where a shape does nothing, 1 where it does much, falling between."""
    sizes = np.linspace(0, 50, 100)
    weights = own_weights(sizes[:, None, None] * np.full(9, 1 / 3))[:, 0]
    assert weights[0] == pytest.approx(100) and weights[-1] == pytest.approx((51 / 50.1) ** 2)
    assert (np.diff(weights) < 0).all()


def test_a_wrong_solve_shows_at_every_level_of_registration(monkeypatch):
    template, parameters = masks.template()
    scan, pairs = masks.scan(width=78.0), masks.landmarks(template, parameters, width=78.0)
    assert max(level.residual for level in register(template, scan, pairs).levels) < RIGHT
    spoil_factors(monkeypatch, affine)
    assert min(level.residual for level in register(template, scan, pairs, backend="splu").levels) > WRONG


def test_a_level_that_is_cut_short_has_not_converged():
    template, parameters = masks.template()
    hasty = replace(SCHEDULES["even"], stiffness=(2.6,), landmarks=(2.0,), steps=1)
    for width, converged in ((78.0, False), (70.0, True)):  # another face, and the template itself
        scan = masks.scan(width=width) if not converged else template
        (level,) = register(template, scan, masks.landmarks(template, parameters, width=width), method=hasty).levels
        assert level.converged == converged and level.steps == 1
        assert (level.change > 0.02) != converged


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stiffness": (1.0,)}, "1 levels of stiffness and 5 of landmarks"),
        ({"stiffness": (), "landmarks": ()}, "at least one level"),
        ({"stiffness": "soft"}, "stiffness of a schedule must be an array of numbers"),
        ({"stiffness": (5, 4, 3, 2, 0)}, "stiffness of a schedule must be a number, at least"),
        ({"landmarks": (5, 4, 3, 2, -1)}, "landmarks of a schedule must be a number, at least 0"),
        ({"landmarks": (5, 4, 3, 2, np.nan)}, "NaN"),
        ({"steps": 0}, "steps of a schedule must be a whole number, at least 1, but is 0"),
        ({"steps": 2.5}, "whole number"),
        ({"memory": -1}, "memory of a schedule must be a whole number, at least 0"),
        ({"tolerance": np.inf}, "tolerance of a schedule must be a number, within"),
        ({"tolerance": "small"}, "tolerance"),
        ({"reach": np.nan}, "reach"),
        ({"cosine": 2}, "cosine"),
    ],
)
def test_a_schedule_that_cannot_be_followed_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        Schedule(**change)


def test_what_has_no_shapes_or_no_triangles_is_refused_in_a_sentence():
    still = replace(RIG, deltas=0 * RIG.deltas)
    bare = replace(RIG, deltas=RIG.deltas[:0], names=(), bounds=RIG.bounds[:0], mirror=RIG.mirror[:0], combinations={})
    for rig in (still, bare):
        for method in ("contact", "paper"):
            with pytest.raises(InputError, match="no shape that moves a vertex"):
                transfer(rig, FACE, method=method)
    points = Mesh(RIG.mesh.vertices, np.zeros((0, 3), np.int64))
    with pytest.raises(InputError, match="The template has no triangles"):
        register(points, RIG.mesh)
