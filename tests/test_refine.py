"""Refining a rig with examples: fixed points, dense optimality, recovered fields, and bad input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from blendcap import InputError, Mesh, Rig, mannequin, refine_rig
from blendcap.modeling.contacts import gaps
from blendcap.modeling.examples import refine
from blendcap.modeling.facial_rigging import local_shapes, make_surface, shapes_from_examples
from blendcap.modeling.fields import ROUGH, SCALES, SMOOTH, FieldProblem, _gain_precision, _System, fit_fields
from sheet import sheet_rig

METHODS = ("fields", "paper")


def some_weights(rig: Rig, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.3, 1, (count, len(rig.names))) * (rng.random((count, len(rig.names))) < 0.3)
    weights[:, rig.index("mouthClose")] = 0  # it only makes sense with the jaw
    return weights


def meshes(rig: Rig, weights: np.ndarray) -> list[Mesh]:
    return [rig.mesh.with_vertices(vertices) for vertices in rig.pose(weights)]


def somebody(rig: Rig) -> Rig:
    """The sheet with a gain that changes from left to right, and stronger smiles."""
    gain = 1 + 0.25 * np.tanh(rig.mesh.vertices[:, 0] / 40)
    gain = np.tile(gain, (len(rig.names), 1))
    for name in ("mouthSmileLeft", "mouthSmileRight"):
        gain[rig.index(name)] += 0.2
    gain[[rig.index(name) for name in ("eyeBlinkLeft", "eyeBlinkRight", "mouthClose")]] = 1  # what closes, closes
    return replace(rig, deltas=rig.deltas * gain[..., None].astype(np.float32))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("given", [True, False])
def test_examples_of_the_rig_itself_leave_it_unchanged(method, given):
    rig = sheet_rig()
    weights = some_weights(rig, 6)
    refined = refine(rig, meshes(rig, weights), weights if given else None, method=method)
    assert np.abs(refined.rig.deltas - rig.deltas).max() < 1e-3
    assert refined.max_kkt < 1e-9 and refined.residual < 1e-9


def test_the_local_solve_meets_the_dense_optimality_conditions_on_twenty_triangles():
    rng = np.random.default_rng(0)
    prior, seen = rng.normal(size=(20, 7, 9)), rng.normal(size=(20, 4, 9))
    weights, stiffness = rng.random((4, 7)), 0.1 + rng.random((20, 7))
    found = local_shapes(prior, seen, weights, stiffness)
    for f in range(20):
        dense = np.linalg.solve(weights.T @ weights + np.diag(stiffness[f]),
                                weights.T @ seen[f] + stiffness[f][:, None] * prior[f])  # fmt: skip
        np.testing.assert_allclose(found[f], dense, atol=1e-10)
        gradient = weights.T @ (weights @ found[f] - seen[f]) + stiffness[f][:, None] * (found[f] - prior[f])
        assert np.abs(gradient).max() < 1e-10


def test_known_weights_and_no_regularization_recover_the_true_shapes():
    rig = sheet_rig()
    true = somebody(rig)
    weights = np.eye(len(rig.names)) + 0.3 * some_weights(rig, len(rig.names), seed=2)
    surface = make_surface(rig.mesh.vertices, rig.mesh.faces)
    moved = true.pose(weights) - rig.mesh.vertices
    prior = rig.deltas.astype(np.float64)
    found = shapes_from_examples(surface, prior, moved, weights, 1e-9)
    off, was = (d - true.deltas - (d - true.deltas).mean(1, keepdims=True) for d in (found, rig.deltas))
    assert np.abs(off).max() < 1e-3  # but for a shift: gradients do not tell where the whole face is
    assert np.abs(was).max() > 0.1


def test_the_papers_rounds_lower_the_error_of_the_poses():
    rig = sheet_rig()
    weights = some_weights(rig, 8, seed=1)
    energies = refine(rig, meshes(somebody(rig), weights), weights, method="paper").energies
    assert energies["fit"][-1] < 0.8 * energies["fit"][0]
    assert energies["weights"][-1] < energies["weights"][0]


def test_fields_meet_the_dense_optimality_conditions():
    """The posterior mean by brute force: every unknown a column, noise and prior as dense covariances."""
    from blendcap.modeling import fields as module

    rng = np.random.default_rng(0)
    samples, count, kinds, poses = 6, 3, 2, 4
    problem = FieldProblem(rng.normal(size=(samples, count, 3)), rng.normal(size=(samples, kinds)), np.array([1, 0, 2]))
    moved, weights = rng.normal(size=(samples, poses, 3)), rng.random((poses, count))
    found = fit_fields(problem, moved, weights, scales=(1.0,))
    functions = np.column_stack([np.ones(samples), problem.waves])
    columns = np.einsum("jn,snc,sk->sjcnk", weights, problem.deltas, functions).reshape(samples * poses * 3, -1)
    noise = module.ROUGH**2 * np.eye(samples) + module.SMOOTH**2 * problem.waves @ problem.waves.T
    precision = np.kron(np.linalg.inv(noise), np.eye(poses * 3))
    whole = module.SHAPE_GAIN**2 * np.array([[1, 0.8, 0], [0.8, 1, 0], [0, 0, 1]])
    field = module.COMMON_GAIN**2 + module.OWN_GAIN**2 * np.eye(3)
    prior = np.zeros((count, kinds + 1, count, kinds + 1))
    for k in range(kinds + 1):
        prior[:, k, :, k] = np.linalg.inv(whole if k == 0 else field)
    missing = (moved - np.einsum("jn,snc->sjc", weights, problem.deltas)).ravel()
    system = columns.T @ precision @ columns + prior.reshape(columns.shape[1], -1)
    gains = np.linalg.solve(system, columns.T @ precision @ missing).reshape(count, kinds + 1)
    np.testing.assert_allclose(found.gains, gains, atol=1e-10)
    assert found.residual < 1e-9


def test_bends_meet_the_dense_optimality_conditions_under_the_square_of_the_scale():
    from blendcap.modeling import fields as module

    rng, scale = np.random.default_rng(4), 0.5
    problem = FieldProblem(9 * rng.normal(size=(6, 3, 3)), rng.normal(size=(6, 2)), np.array([1, 0, 2]))
    moved, weights = rng.normal(size=(6, 4, 3)), rng.random((4, 3))
    found = fit_fields(problem, moved, weights, scales=(scale,))
    gained = replace(found, bends=0 * found.bends).applied(problem.deltas, problem.waves)
    length = np.linalg.norm(problem.deltas, axis=2)
    columns = np.einsum("jn,sn,sk->sjnk", weights, length, problem.waves).reshape(24, -1)
    noise = np.kron(np.linalg.inv(ROUGH**2 * np.eye(6) + SMOOTH**2 * problem.waves @ problem.waves.T), np.eye(4))
    system = columns.T @ noise @ columns + np.eye(6) / (module.BEND * scale**2) ** 2
    missing = (moved - np.einsum("jn,snc->sjc", weights, gained)).reshape(24, 3)
    bends = np.linalg.solve(system, columns.T @ noise @ missing).reshape(3, 2, 3)
    np.testing.assert_allclose(found.bends, bends, atol=1e-10)
    assert np.abs(bends).max() > 1e-4


@pytest.mark.parametrize("scale", [0.25, 1.0])
def test_gains_for_any_weights_near_the_given_ones_are_those_of_the_dense_joint_system(scale):
    """Gains and errors of the weights as unknowns of one dense least-squares problem; and a shape keeps its gain though
    a stronger one was played more than asked for."""
    rng = np.random.default_rng(5)
    deltas, waves = rng.normal(size=(30, 4, 3)) * [[[1], [1], [1], [20]]], rng.normal(size=(30, 3))
    problem, error = FieldProblem(deltas, waves, np.array([1, 0, 2, 3])), 0.1
    weights = rng.uniform(0.5, 1, (5, 4)) * (rng.random((5, 4)) < 0.7)
    off = np.zeros_like(weights)
    off[:, 3] = 0.08 * (weights[:, 3] > 0)
    moved = np.einsum("snc,jn->sjc", deltas, weights + off)
    gains = fit_fields(problem, moved, weights, error, scales=(scale,)).gains
    noise = SMOOTH**2 * waves @ waves.T + ROUGH**2 * np.eye(30)
    root = np.linalg.cholesky(np.linalg.inv(noise)).T
    functions = np.column_stack([np.ones(30), waves])
    used = [(j, i) for j in range(5) for i in np.flatnonzero(weights[j])]
    gram, right = np.zeros((16 + len(used),) * 2), np.zeros(16 + len(used))
    for j, row in enumerate(weights):
        columns = np.zeros((30, 3, 16 + len(used)))
        columns[..., :16] = np.einsum("n,sk,snc->scnk", row, functions, deltas).reshape(30, 3, 16)
        for k, (example, i) in enumerate(used):
            columns[..., 16 + k] = deltas[:, i] * (example == j)
        flat = np.tensordot(root, columns, 1).reshape(90, -1)
        missing = np.tensordot(root, moved[:, j] - np.einsum("snc,n->sc", deltas, row), 1).ravel()
        gram, right = gram + flat.T @ flat, right + flat.T @ missing
    gram[:16, :16] += _gain_precision(problem) / scale**2
    gram[16:, 16:] += np.eye(len(used)) / error**2
    np.testing.assert_allclose(gains.ravel(), np.linalg.solve(gram, right)[:16], rtol=1e-7, atol=1e-10)
    fooled = fit_fields(problem, moved, weights, scales=(scale,)).gains
    assert np.abs(gains[:3]).max() < 0.5 * np.abs(fooled[:3]).max()


def test_the_chosen_scale_makes_the_examples_most_probable():
    """The probability by the examples' dense covariance: weight errors, gains and noise, as one Gaussian."""
    rng = np.random.default_rng(2)
    samples, count, poses, error = 12, 3, 5, 0.1
    problem = FieldProblem(9 * rng.normal(size=(samples, count, 3)), rng.normal(size=(samples, 2)), np.array([1, 0, 2]))
    weights = rng.uniform(0.3, 1, (poses, count))
    functions = np.column_stack([np.ones(samples), problem.waves])
    columns = np.einsum("jn,snc,sk->sjcnk", weights, problem.deltas, functions).reshape(samples * poses * 3, -1)
    errors = np.einsum("snc,ij->sjcin", problem.deltas, np.eye(poses)).reshape(samples * poses * 3, -1)
    noise = np.kron(ROUGH**2 * np.eye(samples) + SMOOTH**2 * problem.waves @ problem.waves.T, np.eye(poses * 3))
    fixed, prior = noise + error**2 * errors @ errors.T, np.linalg.inv(_gain_precision(problem))
    for drawn in (0.0, 1.0):
        own = columns @ np.linalg.cholesky(drawn**2 * prior + 1e-9 * np.eye(len(prior))) @ rng.normal(size=len(prior))
        off = own + np.linalg.cholesky(fixed) @ rng.normal(size=len(fixed))
        probable = {s: multivariate_normal.logpdf(off, cov=fixed + s**2 * columns @ prior @ columns.T) for s in SCALES}
        moved = off.reshape(samples, poses, 3) + np.einsum("jn,snc->sjc", weights, problem.deltas)
        missing = off.reshape(samples, poses, 3)
        system = _System(problem, problem.deltas, functions, missing, weights, _gain_precision(problem))
        system.free_weights(weights, error)
        found = np.array([system.evidence(s) for s in SCALES])
        dense = np.array(list(probable.values()))
        np.testing.assert_allclose(found - found[0], dense - dense[0], atol=1e-6)
        assert fit_fields(problem, moved, weights, error).scale == SCALES[dense.argmax()]
        assert (dense.argmax() >= 2) == (drawn == 1)


def test_a_personal_gain_is_learned_and_helps_on_expressions_never_seen():
    rig = sheet_rig()
    true = somebody(rig)
    weights, unseen = some_weights(rig, 20, seed=3), some_weights(rig, 30, seed=4)
    noise = np.random.default_rng(5).normal(scale=0.05, size=(20, len(rig.mesh.vertices), 3))
    examples = [rig.mesh.with_vertices(v) for v in true.pose(weights) + noise]
    refined = refine_rig(rig, examples, weights)
    error = [np.linalg.norm(r.pose(unseen) - true.pose(unseen), axis=2).mean() for r in (rig, refined)]
    assert error[1] < 0.6 * error[0]


def test_contact_is_kept():
    rig = mannequin(shapes=52)
    weights = some_weights(rig, 3, seed=6)
    weights[:, rig.index("eyeBlinkLeft")] = [0.9, 0.4, 0]
    stretched = rig.pose(weights) + 0.2 * (rig.pose(weights) - rig.mesh.vertices)
    refined = refine_rig(rig, [rig.mesh.with_vertices(v) for v in stretched], weights)
    closed = np.zeros(len(rig.names))
    closed[rig.index("eyeBlinkLeft")] = 1
    assert gaps(refined.pose(closed), rig.contacts["lids_left"]).max() < 0.05
    eyes = rig.regions["eyes"]
    assert not (refined.deltas - rig.deltas)[rig.index("eyeBlinkLeft"), eyes].any()


def test_one_example_is_enough_to_learn_something():
    rig = sheet_rig()
    weights = np.zeros((1, len(rig.names)))
    weights[0, rig.index("mouthSmileLeft")] = 1
    true = somebody(rig)
    refined = refine_rig(rig, meshes(true, weights), weights)
    at = rig.index("mouthSmileLeft")
    before, after = (np.abs(r.deltas[at] - true.deltas[at]).max() for r in (rig, refined))
    assert after < 0.8 * before


def test_bad_input_is_refused_in_a_sentence():
    rig = sheet_rig()
    weights = some_weights(rig, 2)
    examples = meshes(rig, weights)
    with pytest.raises(InputError, match="at least one expression"):
        refine_rig(rig, [])
    with pytest.raises(InputError, match="Example 1 has other vertices or triangles"):
        refine_rig(rig, [examples[0], Mesh(rig.mesh.vertices[:-1], rig.mesh.faces[:50])])
    with pytest.raises(InputError, match="weights must have the shape"):
        refine_rig(rig, examples, weights[:1])
    with pytest.raises(InputError, match="weights holds a NaN"):
        refine_rig(rig, examples, weights * np.nan)
    with pytest.raises(InputError, match="choose fields or paper"):
        refine_rig(rig, examples, weights, method="best")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="check its unit"):
        refine_rig(replace(rig, deltas=rig.deltas * 1e-3), examples, weights)
