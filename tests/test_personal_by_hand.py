"""Refining by a take against arithmetic by hand: the ridge of docs/rigging.md, what is kept, what the answer says."""

from dataclasses import replace

import numpy as np
import pytest

import blendcap
from blendcap import Animation, Rig, SolveSettings
from blendcap.markers import personal
from blendcap.modeling.bends import Bends, bent
from blendcap.modeling.contacts import gaps
from blendcap.modeling.examples import learned_from
from blendcap.modeling.fields import smooth_functions
from blendcap.solving.answer import Answer
from blendcap.solving.rows import marker_rows
from stage import Scene, full_rig, motion, scene, small_rig
from test_personal import KEEP, tracked

FEW = ("browInnerUp", "eyeBlinkLeft", "jawOpen", "mouthSmileLeft")
OFF = 1  # of these, at rest all the time
WAVES, HELMET, FRAMES, HERTZ = 4, 6, 96, 12.0


@pytest.fixture(scope="module")
def slipping() -> Scene:
    """Someone else, whose helmet slips and of whose markers one slid off."""
    whole = scene(motion(), strength=1.0, noise=0.1, slip=(1.5, 1.0), occlusion=0.02)
    positions = whole.take.positions.copy()
    positions[100:200, 3] += 12.0
    return replace(whole, take=replace(whole.take, positions=positions))


@pytest.fixture
def heard(slipping, monkeypatch):
    """The skin, shapes, places and helmet of its points, and an answer of random numbers with another rig's rows."""
    monkeypatch.setattr(personal, "WAVES", WAVES)
    monkeypatch.setattr("blendcap.modeling.bends.TOLERANCE", 1e-10)
    rig, rng = small_rig().select(FEW), np.random.default_rng(0)
    tracks = tracked(slipping)
    skin = personal._Skin.of(rig, slipping.binding, tracks)
    both = (slipping.binding.points, tracks.points)
    deltas = np.hstack([rig.sample(points)[1] for points in both])
    places = np.concatenate([points.positions(rig.mesh) for points in both])
    axes = np.tile(np.eye(3), (len(places), 1, 1))
    tracked_ones = np.arange(len(places)) >= len(both[0].names)
    axes[tracked_ones] = rng.normal(size=(tracked_ones.sum(), 3, 3)) * [[1], [1], [0]]
    helmet = rng.normal(size=(HELMET, len(places), 3))
    unknowns = np.hstack([rng.uniform(size=(FRAMES, len(FEW))), rng.normal(size=(FRAMES, HELMET))])
    unknowns[:, OFF] = 0
    turned = 0.3 * deltas[..., [1, 2, 0]] + deltas
    moved = np.tensordot(unknowns, np.concatenate([turned, helmet]), axes=1)
    moved += rng.normal(size=moved.shape)
    moved[rng.random(moved.shape[:2]) < 0.2] = np.nan
    rows = marker_rows(1.2 * deltas, helmet, moved, rig.bounds, -1.0, axes)
    trusted = rng.uniform(0.2, 1.0, len(places))
    answer = Answer(rows, unknowns, {}, None, 0.3, np.zeros(len(FEW), dtype=bool), trusted)
    return skin, deltas, places, helmet, axes, answer


def by_hand(rig: Rig, deltas, places, helmet, axes, answer: Answer):
    """The ridge of docs/rigging.md as one tall matrix: coefficients, scale, and the part that is foretold."""
    functions = smooth_functions(rig.mesh.vertices[learned_from(rig)], 0.1, WAVES)(places)
    weights, sure = answer.unknowns[:, : len(FEW)], answer.trusted / 3.0
    known = np.tensordot(answer.unknowns, np.concatenate([deltas, helmet]), axes=1)
    left = answer.rows.targets - np.einsum("pij,tpj->tpi", axes, known)
    length = np.linalg.norm(deltas, axis=2)
    columns = np.einsum("p,tn,np,pk,pij->tpinkj", sure, weights, length, functions, axes, optimize=True)
    left = sure[:, None] * left
    seen, block = ~answer.rows.missing, np.arange(FRAMES) // 24 % 2  # two seconds each, by turns

    def ridge(frames: np.ndarray, scale: float) -> np.ndarray:
        tall = columns[frames][seen[frames]].reshape(-1, len(FEW) * WAVES * 3)
        told = left[frames][seen[frames]].ravel()
        return np.linalg.solve(tall.T @ tall + np.eye(tall.shape[1]) / scale**2, tall.T @ told)

    def lacking(frames: np.ndarray, bends: np.ndarray) -> float:
        missed = left[frames] - columns[frames].reshape(*left[frames].shape, -1) @ bends
        return float((missed[seen[frames]] ** 2).sum())

    every, halves = np.arange(FRAMES), [np.flatnonzero(block == k) for k in (0, 1)]
    costs = {s: sum(lacking(halves[k], ridge(halves[1 - k], s)) for k in (0, 1)) for s in (0.05, 0.1, 0.2)}
    best = min(costs, key=costs.__getitem__)
    bends = ridge(every, best)
    return bends.reshape(len(FEW), WAVES, 3), best, 1 - costs[best] / lacking(every, 0 * bends)


def test_what_is_learned_is_the_ridge_of_what_the_given_rig_lacks(heard):
    skin, *given, answer = heard
    found = skin.learned(answer, HERTZ, None)
    bends, scale, foretold = by_hand(skin.rig, *given, answer)
    np.testing.assert_allclose(found.coefficients, bends, atol=1e-4 * np.abs(bends).max())
    assert found.scale == scale and 0.05 < foretold < 0.95
    assert found.foretold == pytest.approx(foretold, abs=1e-4)
    assert skin.learned(answer, HERTZ, 0.05).scale == 0.05


def test_what_is_off_stays_and_what_is_on_changes_as_told(heard):
    skin, *_, answer = heard
    found = skin.learned(answer, HERTZ, None)
    refined, residual = skin.applied(found)
    rig, moving = skin.rig, learned_from(skin.rig)
    assert residual < 1e-4
    np.testing.assert_allclose(refined.deltas[OFF], rig.deltas[OFF], atol=1e-4)
    old = rig.deltas[:, moving].transpose(1, 0, 2).astype(np.float64)
    functions = smooth_functions(rig.mesh.vertices[moving], 0.1, WAVES)(rig.mesh.vertices[moving])
    told = bent(old, functions, found.coefficients).transpose(1, 0, 2)
    row = rig.index("browInnerUp")  # far from all contact
    assert np.abs(told[row]).max() > 0.3
    np.testing.assert_allclose((refined.deltas - rig.deltas)[row, moving], told[row], atol=0.02)


def test_contact_and_solid_bodies_are_kept_however_much_is_learned(slipping):
    rig = small_rig()
    skin = personal._Skin.of(rig, slipping.binding, None)
    wild = 0.3 * np.random.default_rng(0).normal(size=(len(rig.names), skin.waves.shape[1], 3))
    refined, _ = skin.applied(Bends(wild, 0.2, 0.5, 0.0))
    row, pairs = rig.index("eyeBlinkLeft"), rig.contacts["lids_left"]
    shut, now = (gaps(part.mesh.vertices + part.deltas[row], pairs) for part in (rig, refined))
    bare = rig.deltas[row].astype(np.float64)
    told = bent(bare[skin.moving, None], skin.waves, wild[row : row + 1])
    bare[skin.moving] += told[:, 0]
    assert gaps(rig.mesh.vertices + bare, pairs).max() > shut.max() + 1.0 > now.max() + 0.9
    solid = np.setdiff1d(np.arange(len(rig.mesh.vertices)), learned_from(rig))
    eyes = np.intersect1d(solid, rig.regions["eyes"]) if "eyes" in rig.regions else solid
    np.testing.assert_allclose(refined.deltas[:, eyes], rig.deltas[:, eyes], atol=1e-3)


@pytest.fixture(scope="module")
def said(slipping):
    """Sliders to 100, tracks and curves that begin a second late, two rounds."""
    rig = replace(small_rig(), deltas=small_rig().deltas / 100, bounds=100 * small_rig().bounds)
    true = slipping.truth.animation
    curves = Animation(true.weights[24:], true.names, true.rate, confidence=np.ones_like(true.weights[24:]))
    inputs = {"patches": curves, "patches_offset": 1.0, "tracks": tracked(slipping), "settings": KEEP}
    found = blendcap.refine_from_take(rig, slipping.take, slipping.binding, rounds=2, **inputs)
    return found, blendcap.solve(found.rig, slipping.take, slipping.binding, **inputs)


def test_its_solution_is_that_of_a_solve_on_the_refined_rig(said):
    found, again = said
    np.testing.assert_allclose(found.solution.animation.weights, again.animation.weights, atol=0.02)  # of 100
    np.testing.assert_allclose(found.solution.conflict, again.conflict, atol=1e-3)
    np.testing.assert_allclose(found.solution.track_rms, again.track_rms, atol=1e-4)


def test_a_second_round_adds_to_the_first(slipping, said):
    found, _ = said
    rms = found.rms
    assert len(rms) == 3 and rms[2] < rms[1] < rms[0]
    length = np.linalg.norm(100 * found.rig.deltas - small_rig().deltas, axis=2)
    np.testing.assert_allclose(found.change, length, atol=1e-4)
    assert 0 < found.residual < 1e-3


def test_what_is_lacking_counts_markers_as_far_as_they_are_trusted(slipping):
    solved = slipping.solve(head="keep")
    found = blendcap.refine_from_take(small_rig(), slipping.take, slipping.binding, settings=KEEP, rounds=1)
    for rms, of in ((found.rms[0], solved), (found.rms[1], found.solution)):
        trusted = np.array([of.trusted[name] for name in of.marker_names])
        assert trusted.min() < 0.9
        seen = np.isfinite(of.residuals).sum(0)
        squared = np.nansum((trusted * of.residuals) ** 2) / (3 * trusted**2 @ seen)
        assert rms == pytest.approx(np.sqrt(squared), rel=1e-6)


def test_one_scale_is_chosen_and_what_is_foretold_is_of_the_first_round(slipping, monkeypatch):
    tried = []

    def spied(points, parts, scales):
        found = fit(points, parts, scales)
        tried.append((scales, found))
        return found

    fit = personal.fit_bends
    monkeypatch.setattr(personal, "fit_bends", spied)
    found = blendcap.refine_from_take(small_rig(), slipping.take, slipping.binding, settings=KEEP, rounds=2)
    assert [scales for scales, _ in tried] == [(0.05, 0.1, 0.2), (tried[0][1].scale,)]
    assert found.foretold == tried[0][1].foretold != tried[1][1].foretold
    assert found.residual >= max(one.residual for _, one in tried)


def test_what_changed_too_much_is_said_in_the_end(slipping, monkeypatch, caplog):
    monkeypatch.setattr(personal, "MUCH", 1e-3)
    blendcap.refine_from_take(small_rig(), slipping.take, slipping.binding, settings=KEEP, rounds=1)
    assert caplog.text.count("differ by: browDownLeft, ") == 1


def test_rigs_and_settings_are_minded(slipping):
    locked = small_rig().bounds.copy()
    locked[3] = 0.0
    rig = replace(small_rig(), bounds=locked)
    with pytest.raises(blendcap.InputError, match="leave it one value"):
        blendcap.refine_from_take(rig, slipping.take, slipping.binding)
    nearly = replace(slipping.take, positions=slipping.take.positions[: round(7.9 * slipping.take.rate)])
    with pytest.raises(blendcap.InputError, match=r"lasts 7\.9 s"):
        blendcap.refine_from_take(small_rig(), nearly, slipping.binding)
    none = SolveSettings(head="keep", helmet="none")
    found = blendcap.refine_from_take(small_rig(), slipping.take, slipping.binding, settings=none, rounds=1)
    assert found.solution.helmet is None


def test_tracks_are_asked_of_no_shape_that_chiefly_moves_what_lies_behind_the_skin(slipping):
    rig = full_rig().select(("jawOpen", "tongueOut"))
    binding, tracks = slipping.binding, tracked(slipping)
    markers = len(binding.points.names)
    length = np.linalg.norm(personal._Skin.of(rig, binding, tracks).deltas, axis=2)
    plain = np.linalg.norm(rig.sample(tracks.points)[1], axis=2)
    assert plain[1].max() > 1.0 and not length[markers:, 1].any()
    np.testing.assert_array_equal(length[markers:, 0], plain[0])
    np.testing.assert_array_equal(length[:markers].T, np.linalg.norm(rig.sample(binding.points)[1], axis=2))


def test_what_a_tongue_does_to_the_skin_is_not_learned_by_the_lips(slipping):
    rig = full_rig().select(("jawOpen", "tongueOut"))
    binding, tracks = slipping.binding, tracked(slipping)
    skin = personal._Skin.of(rig, binding, tracks)
    both = np.hstack([rig.sample(points)[1] for points in (binding.points, tracks.points)])
    unknowns = np.random.default_rng(0).uniform(size=(FRAMES, 2))
    axes = np.tile(np.eye(3), (both.shape[1], 1, 1))
    rows = marker_rows(
        both, np.empty((0, *both.shape[1:])), np.tensordot(unknowns, both, axes=1), rig.bounds, -1.0, axes
    )
    answer = Answer(rows, unknowns, {}, None, 0.3, np.zeros(2, dtype=bool), np.ones(both.shape[1]))
    assert np.abs(skin.learned(answer, HERTZ, 0.2).coefficients).max() < 1e-9
