"""The public solve on faces whose weights are known, and the traps that a marker solve falls into."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import blendcap
from blendcap import Animation, InputError, SolveSettings, SurfacePoints
from blendcap.solving.shares import full_weights, in_shares
from blendcap.synthetic.performances import range_of_motion
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import make_take
from sheet import sheet_rig
from stage import CLEAN, SHAPES, Scene, markers, motion, oracle, posed, roughness, scene, small_rig, talk

METHODS = ("learned", "paper", "live")
EXACT = {"method": "paper", "beta": 0.0, "gamma": 1e-9}
TYPICAL = {"noise": 0.2, "slip": (1.0, 1.0), "occlusion": 0.05}


def rmse(weights) -> float:
    return float(np.sqrt((weights**2).mean()))


@pytest.fixture(scope="module")
def clean() -> Scene:
    return scene(motion())


@pytest.fixture(scope="module")
def typical() -> Scene:
    """Speech of a performer who is not the rig, with everything that goes wrong."""
    return scene(talk(), strength=1.0, seed=1, noise=0.2, slip=(2.0, 2.0), occlusion=0.05)


@pytest.fixture(scope="module")
def solved(typical) -> dict[str, blendcap.Solution]:
    return {method: typical.solve(method=method) for method in METHODS}


# Truth recovered


@pytest.mark.parametrize("helmet", ["rigid", "paper", "none"])
def test_a_perfect_take_gives_its_weights_back(clean, helmet):
    solution = clean.solve(**EXACT, helmet=helmet)
    assert np.abs(clean.off(solution)).max() < 1e-6
    assert solution.rms.max() < 1e-6 and solution.animation.names == SHAPES and solution.animation.rate == 24
    assert solution.animation.head is None
    assert solution.helmet is None if helmet == "none" else np.abs(solution.helmet).max() < 1e-6


def test_the_learned_solve_is_close_on_a_perfect_take(clean):
    assert rmse(clean.off(clean.solve(model_error=0.0))) < 0.01
    assert rmse(clean.off(clean.solve())) < 0.04  # believes that the rig errs by 0.06 mm
    assert rmse(clean.off(clean.solve(method="live"))) < 0.04


def test_the_certificate_can_be_computed_anew(typical):
    """Residuals of Eq. 3 from the returned weights alone: no marker missing, no helmet."""
    whole = replace(typical.take, positions=typical.truth.positions)
    solution = typical.solve(whole, method="paper", beta=0.5, gamma=0.01, helmet="none", head="keep")
    surface, deltas = typical.rig.sample(typical.binding.points)
    columns = deltas.reshape(len(SHAPES), -1).T
    targets = typical.binding.to_rig(whole.positions) - surface - typical.binding.offsets
    a = solution.animation.weights
    gradient = (a @ columns.T - targets.reshape(len(a), -1)) @ columns + 0.01 * a + 0.25
    residual = np.abs(a - np.clip(a - gradient / ((columns**2).sum(0) + 0.01), 0, 1)).max()
    assert residual < 1e-9 and solution.certificate.max_kkt < 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_every_method_certifies_its_optimum(solved, method):
    certificate = solved[method].certificate
    assert certificate.max_kkt < 1e-9 and certificate.converged
    assert len(certificate.residuals) == len(solved[method].rms)


def test_an_answer_tells_what_it_did_to_every_marker(typical, solved):
    for solution in solved.values():
        apart = np.linalg.norm(solution.targets - solution.fitted, axis=2)
        assert np.allclose(apart, solution.residuals, atol=1e-9, equal_nan=True)
        assert np.array_equal(np.isnan(solution.residuals), np.isnan(solution.targets[..., 0]))
        assert np.allclose(solution.rms, np.sqrt(np.nanmean(solution.residuals**2, axis=1)))
        surface, deltas = typical.rig.sample(typical.binding.points)
        posed = surface + typical.binding.offsets + np.tensordot(solution.animation.weights, deltas, 1)
        assert np.allclose(solution.fitted, posed)
        assert solution.energies["markers"] == pytest.approx(np.nansum(solution.residuals**2, axis=1))
        assert (solution.animation.confidence >= 0).all() and (solution.animation.confidence <= 1).all()


# What must not matter


def in_other_weights(rig, scale):
    """The same rig with weights that are so many times as large (N,)."""
    return replace(rig, deltas=rig.deltas / scale[:, None, None], bounds=np.sort(rig.bounds * scale[:, None]))


@pytest.mark.parametrize("method", METHODS)
def test_the_unit_of_the_weights_does_not_matter(typical, solved, method):
    """Sliders to 100, to 2, to -0.5: the weights are as many times as large, and nothing else is different."""
    scale = np.resize([100.0, 2.0, -0.5, 1.0], len(SHAPES))
    other = blendcap.solve(
        in_other_weights(typical.rig, scale), typical.take, typical.binding, settings=SolveSettings(method=method)
    )
    np.testing.assert_allclose(other.animation.weights / scale, solved[method].animation.weights, atol=1e-5)
    np.testing.assert_allclose(other.residuals, solved[method].residuals, atol=1e-4)
    np.testing.assert_allclose(other.animation.confidence, solved[method].animation.confidence, atol=1e-6)
    assert other.unseen == pytest.approx(solved[method].unseen) and other.held == solved[method].held


@pytest.mark.parametrize(
    ("bounds", "full"),
    [((0, 1), 1), ((-1, 1), 1), ((-50, 100), 100), ((0, 0.5), 0.5), ((-2, 0), -2), ((-2, -1), -2), ((0, 0), 1)],
)
def test_a_full_shape_is_one_at_its_bound(bounds, full):
    rig = replace(sheet_rig(), bounds=np.tile(np.array(bounds, float), (len(sheet_rig().names), 1)))
    assert (full_weights(rig) == full).all()
    np.testing.assert_allclose(in_shares(rig).deltas, full * rig.deltas)
    np.testing.assert_allclose(in_shares(rig).bounds, np.sort(rig.bounds / full))
    assert (in_shares(rig) is rig) == (full == 1)


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_shapes_does_not_matter(typical, solved, method):
    order = [SHAPES[i] for i in np.random.default_rng(0).permutation(len(SHAPES))]
    settings = SolveSettings(method=method)
    permuted = blendcap.solve(typical.rig.select(order), typical.take, typical.binding, settings=settings)
    assert permuted.animation.names == tuple(order)
    assert np.abs(permuted.animation.select(SHAPES).weights - solved[method].animation.weights).max() < 1e-6


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_markers_does_not_matter(typical, solved, method):
    names = [typical.take.names[i] for i in np.random.default_rng(1).permutation(len(typical.take.names))]
    rows = [typical.take.names.index(name) for name in names]
    bound = typical.binding
    binding = replace(bound, points=bound.points.select(names), offsets=bound.offsets[rows])
    settings = SolveSettings(method=method)
    for take, either in ((typical.take.select(names[::-1]), bound), (typical.take, binding)):
        again = blendcap.solve(typical.rig, take, either, settings=settings)
        assert np.abs(again.animation.weights - solved[method].animation.weights).max() < 1e-6


@pytest.mark.parametrize("method", METHODS)
def test_the_space_of_the_take_does_not_matter(typical, method):
    turn = Rotation.from_rotvec([1.4, -0.1, 2.0]).as_matrix()
    positions = typical.take.positions.copy()
    positions[:10] = positions[0]  # see test_binding: the median of a noisy neutral turns a little with the axes
    here = replace(typical.take, positions=positions)
    there = replace(here, positions=positions @ turn.T * 0.8 + (300, -40, 1000))
    answers = []
    for take in (here, there):
        binding = blendcap.bind(typical.rig, take, typical.truth.points, method="given")
        settings = SolveSettings(method=method, head="keep", longest_gap=0.0)
        answers.append(blendcap.solve(typical.rig, take, binding, settings=settings))
    one, other = answers
    assert np.abs(one.animation.weights - other.animation.weights).max() < 1e-5
    assert np.allclose(one.residuals, other.residuals, atol=1e-5, equal_nan=True)


@pytest.fixture(scope="module")
def mirrored():
    """A rig that is its own mirror image, a take, and the take that a mirror would show."""
    rig = sheet_rig()
    vertices = rig.mesh.vertices
    left = np.flatnonzero((vertices[:, 0] > 1) & (vertices[:, 0] % 12 == 0) & (vertices[:, 1] % 16 == 0))
    flip = vertices * (-1, 1, 1)
    # the lower lip has the same places as the upper one; what also moves alike is the mirror image
    jaw = rig.deltas[rig.index("jawOpen")]
    far = np.linalg.norm(flip[left][:, None] - vertices, axis=2) + np.linalg.norm(jaw[left][:, None] - jaw, axis=2)
    names = [f"L{v}" for v in left] + [f"R{v}" for v in left]
    points = SurfacePoints.at_vertices(names, np.r_[left, far.argmin(1)], rig.mesh)
    take, _ = make_take(make_performer(rig, seed=1), range_of_motion(rig, 24.0), points, seed=2, noise=0.1,
                        misplacement=0.0, slip=(1.0, 1.0), occlusion=0.05)  # fmt: skip
    swapped = take.select(names[len(left) :] + names[: len(left)])
    return rig, points, take, replace(swapped, positions=swapped.positions * (-1, 1, 1), names=names)


@pytest.mark.parametrize("method", METHODS)
def test_a_mirrored_take_gives_mirrored_weights(mirrored, method):
    rig, points, *takes = mirrored
    weights = []
    for take in takes:
        binding = blendcap.bind(rig, take, points, method="given")
        weights.append(blendcap.solve(rig, take, binding, settings=SolveSettings(method=method)).animation.weights)
    assert np.abs(weights[0] - weights[0][:, rig.mirror]).max() > 0.3
    assert np.abs(weights[1] - weights[0][:, rig.mirror]).max() < 1e-4


@pytest.mark.parametrize("method", METHODS)
def test_the_same_input_gives_the_same_answer(typical, solved, method):
    again = typical.solve(method=method)
    assert np.array_equal(again.animation.weights, solved[method].animation.weights)
    assert np.array_equal(again.residuals, solved[method].residuals, equal_nan=True)


def test_live_cannot_see_the_future(typical, solved):
    cut = 95
    positions = typical.take.positions.copy()
    positions[cut:] = positions[cut - 10] + 2.0
    settings = {"method": "live", "head": "keep", "noise": 0.2, "longest_gap": 0.0}
    changed = typical.solve(replace(typical.take, positions=positions), **settings).animation.weights
    true = typical.solve(**settings).animation.weights
    assert np.array_equal(changed[:cut], true[:cut])
    assert np.abs(changed[cut:] - true[cut:]).max() > 0.1


# The default against the papers' Eq. 3


def test_the_default_beats_equation_3(typical, solved):
    best = oracle(typical)
    assert typical.error(solved["learned"]) < 0.85 * typical.error(best)
    moves = replace(solved["learned"], animation=typical.truth.animation)  # as rough as the truth, which blinks
    assert abs(roughness(solved["learned"]) - roughness(moves)) < 0.05 * roughness(best)
    assert typical.error(solved["live"]) < 1.1 * typical.error(best)  # which knows the truth, as live does not


@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_a_quiet_clean_take_is_not_over_smoothed(strength):
    quiet = replace(talk(), weights=0.25 * talk().weights)
    case = scene(quiet, strength=strength, seed=2, noise=0.03, slip=(1.0, 1.0))
    assert case.error(case.solve()) < 1.03 * case.error(oracle(case))


# Traps


def with_lids() -> SurfacePoints:
    """The markers, and one in the middle of each upper lid."""
    rig, points = small_rig(), markers()
    lids = []
    for name in ("eyeBlinkLeft", "eyeBlinkRight"):
        size = np.linalg.norm(rig.deltas[rig.index(name)], axis=1)
        lid = np.intersect1d(np.flatnonzero(size > 0.5 * size.max()), rig.regions["lids"])
        lids.append(lid[np.linalg.norm(rig.mesh.vertices[lid] - rig.mesh.vertices[lid].mean(0), axis=1).argmin()])
    lid_points = SurfacePoints.at_vertices(["lidLeft", "lidRight"], lids, rig.mesh)
    return SurfacePoints(points.names + lid_points.names, np.r_[points.faces, lid_points.faces],
                         np.concatenate([points.barycentric, lid_points.barycentric]))  # fmt: skip


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_wink_is_not_a_blink(side):
    """The prior ties the lids together; markers on them say otherwise."""
    case = scene(
        posed(**{f"eyeBlink{side}": 0.8}), points=with_lids(), strength=1.0, seed=3, noise=0.2, slip=(1.0, 1.0)
    )
    solution = case.solve()
    own = SHAPES.index(f"eyeBlink{side}")
    assert solution.animation.weights[:, case.rig.mirror[own]].max() < 0.1
    assert np.abs(case.off(solution)[:, own]).max() < 0.1


def test_a_blink_seen_on_one_lid_closes_both():
    """Nothing that the right lid moves has a marker, so it goes with the left one; held at rest, it would stay open."""
    points, right = with_lids(), SHAPES.index("eyeBlinkRight")
    size = np.linalg.norm(small_rig().sample(points)[1][right], axis=1)
    seen = points.select([name for name, moves in zip(points.names, size, strict=True) if moves < 0.05])
    blink = posed(seconds=2.0, eyeBlinkLeft=0.8, eyeBlinkRight=0.8)
    case = scene(blink, points=seen, strength=1.0, seed=3, noise=0.2, slip=(1.0, 1.0))
    solution = case.solve()
    assert solution.unseen["eyeBlinkRight"] > 3.0
    assert np.abs(case.off(solution)[:, [right, SHAPES.index("eyeBlinkLeft")]]).max() < 0.12


@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_half_a_smile_stays_on_its_side(strength):
    case = scene(posed(mouthSmileLeft=0.8), strength=strength, seed=3, **TYPICAL)
    solution = case.solve()
    left, right = SHAPES.index("mouthSmileLeft"), SHAPES.index("mouthSmileRight")
    assert solution.animation.weights[:, right].max() < 0.05
    assert np.abs(case.off(solution)[:, left]).max() < 0.1


@pytest.mark.parametrize("head", ["auto", "keep"])
def test_a_helmet_that_slips_far_does_not_move_the_face(head):
    still, slipping = (scene(talk(), seed=4, noise=0.1, slip=(size, size)) for size in (0.0, 6.0))
    one, other = still.solve(head=head), slipping.solve(head=head)
    loss = 1.15 if head == "auto" else 2.5
    assert slipping.error(other) < loss * still.error(one)
    assert slipping.error(other) < 0.8 * slipping.error(slipping.solve(head=head, method="paper"))
    if head == "keep":  # all of the slip is the helmet's
        assert np.abs(other.helmet - slipping.truth.slip)[:, :3].max() < 0.5
        assert np.abs(other.helmet - slipping.truth.slip)[:, 3:].max() < np.deg2rad(1.0)


def test_occlusion_costs_little():
    whole, gappy = (scene(talk(), seed=5, noise=0.2, occlusion=part) for part in (0.0, 0.3))
    assert gappy.take.missing.mean() > 0.25
    for method, factor in (("learned", 1.4), ("live", 1.4)):
        one, other = whole.solve(method=method), gappy.solve(method=method)
        assert gappy.error(other) < factor * whole.error(one)
        assert np.isfinite(other.animation.weights).all() and np.isfinite(other.rms).all()


@pytest.mark.parametrize("method", METHODS)
def test_frames_without_any_marker_are_bridged(typical, solved, method):
    positions = typical.take.positions.copy()
    positions[100:118] = np.nan
    solution = typical.solve(replace(typical.take, positions=positions), method=method)
    weights = solution.animation.weights
    assert np.isfinite(weights).all() and solution.certificate.max_kkt < 1e-9
    assert np.isnan(solution.rms[100:118]).all() and np.isfinite(np.delete(solution.rms, np.s_[100:118])).all()
    far = np.r_[0:60, 170:200]
    assert np.abs(weights - solved[method].animation.weights)[far].max() < 0.1
    if method == "learned":  # it knows both ends
        assert np.abs(np.diff(weights[98:120], axis=0)).max() < 0.2


def test_short_gaps_are_filled_and_long_ones_are_not(typical):
    positions = np.where(typical.take.missing[..., None], 0.0, typical.truth.positions)
    positions[50:52, 3] = np.nan
    positions[80:95, 4] = np.nan
    missing = np.isnan(typical.solve(replace(typical.take, positions=positions)).residuals)
    assert not missing[50:52, 3].any() and missing[80:95, 4].all() and missing.sum() == 15


def test_the_heads_motion_is_returned_and_not_acted():
    still, nodding = (scene(talk(), seed=6, noise=0.2, **head) for head in ({}, {"head": (20.0, 10.0)}))
    solution = nodding.solve()
    assert still.solve().animation.head is None
    assert nodding.error(solution) < 1.25 * still.error(still.solve())
    true, found = nodding.truth.animation.head, solution.animation.head
    face = nodding.rig.mesh.vertices[::50]
    where = [face @ h[:, :3, :3].transpose(0, 2, 1) + h[:, None, :3, 3] for h in (true, found)]
    assert np.linalg.norm(where[0] - face, axis=2).max() > 20
    assert np.linalg.norm(where[1] - where[0], axis=2).mean() < 0.5


def test_head_motion_that_is_hardly_there_is_removed_if_that_is_asked_for(typical):
    """What the stable markers do here is noise and play: left alone by default, followed on request."""
    free = {"method": "paper", "helmet": "none", "longest_gap": 0.0}
    kept, asked = (typical.solve(head=head, stable=typical.take.names, **free) for head in ("auto", "remove"))
    assert kept.animation.head is None
    assert (np.abs(asked.animation.head - np.eye(4)).max((1, 2)) > 1e-6).mean() > 0.9


def test_head_motion_in_another_space_is_returned_in_the_rigs():
    nodding = scene(talk(), seed=6, noise=0.05, head=(20.0, 10.0))
    turn = Rotation.from_rotvec([1.4, -0.1, 2.0]).as_matrix()
    there = replace(nodding.take, positions=nodding.take.positions @ turn.T * 0.5 + (300, -40, 1000))
    binding = blendcap.bind(nodding.rig, there, nodding.truth.points, method="given")
    found = blendcap.solve(nodding.rig, there, binding).animation.head
    assert np.abs(found[:, :3, :3] - nodding.truth.animation.head[:, :3, :3]).max() < 0.02
    assert np.abs(found[:, :3, 3] - nodding.truth.animation.head[:, :3, 3]).mean() < 1.0


def test_what_markers_cannot_see_is_named_and_rests(caplog):
    from stage import full_rig

    rig = full_rig().select((*SHAPES, "eyeLookInRight", "eyeLookUpRight"))
    take, truth = make_take(make_performer(rig, seed=1), talk(), markers(), seed=1, **{**CLEAN, "noise": 0.2})
    moved = np.linalg.norm(rig.sample(truth.points)[1][-2:], axis=2).max(0)
    away = [name for name, far in zip(truth.points.names, moved, strict=True) if far < 0.3]  # from the lids
    binding = blendcap.bind(rig, take, truth.points.select(away), method="given")
    solution = blendcap.solve(rig, take, binding)
    assert {"eyeLookInRight", "eyeLookUpRight"} <= set(solution.unseen)
    assert "eyeLookInRight" in caplog.text and "cannot tell" in caplog.text
    for name in solution.unseen:
        column = rig.index(name)
        assert solution.animation.confidence[:, column].max() < 0.8
        if name in solution.held:
            assert solution.animation.weights[:, column].max() < 0.05
    assert not {"jawOpen", "mouthSmileLeft", "browInnerUp"} & set(solution.unseen)


class TestRefusals:
    def test_a_marker_that_is_not_there(self, typical):
        with pytest.raises(InputError, match="no marker 'm00'"):
            typical.solve(typical.take.select(typical.take.names[1:]))

    def test_a_marker_that_is_never_seen(self, typical):
        positions = typical.take.positions.copy()
        positions[:, 7] = np.nan
        with pytest.raises(InputError, match="'m07' is missing in every frame"):
            typical.solve(replace(typical.take, positions=positions))

    def test_a_binding_to_another_rig(self, typical):
        with pytest.raises(InputError, match="another mesh"):
            blendcap.solve(sheet_rig(), typical.take, typical.binding)


def test_a_take_of_one_frame_is_solved(clean):
    peak = 120
    for method in METHODS:
        one = replace(clean.take, positions=clean.take.positions[peak : peak + 1])
        solution = clean.solve(one, method=method, noise=0.05)
        assert solution.animation.weights.shape == (1, len(SHAPES))
        assert np.isfinite(solution.animation.weights).all() and solution.certificate.max_kkt < 1e-9
        assert solution.rms[0] < 0.5


def test_extra_markers_are_ignored(typical, solved):
    extra = np.concatenate([np.zeros((len(typical.take.positions), 1, 3)), typical.take.positions], axis=1)
    more = replace(typical.take, positions=extra, names=("stray", *typical.take.names))
    assert np.array_equal(typical.solve(more).animation.weights, solved["learned"].animation.weights)
    assert solved["learned"].marker_names == typical.take.names
    assert isinstance(solved["learned"].animation, Animation)


def test_a_rig_without_room_to_move_is_refused():
    with pytest.raises(InputError, match="no shapes"):
        blendcap.solve(replace(small_rig().select([]), combinations={}), None, None)  # pyright: ignore
    rig = small_rig()
    bounds = rig.bounds.copy()
    bounds[3] = 0
    with pytest.raises(InputError, match=f"shape '{rig.names[3]}' leave it one value"):
        blendcap.solve(replace(rig, bounds=bounds), None, None)  # pyright: ignore


def test_frames_without_any_marker_have_no_confidence(typical):
    positions = typical.take.positions.copy()
    positions[60:90] = np.nan
    take = replace(typical.take, positions=positions)
    confidence = blendcap.solve(
        typical.rig, take, typical.binding, settings=SolveSettings(head="keep")
    ).animation.confidence
    assert not confidence[60:90].any() and (confidence[:60] > 0).any()
