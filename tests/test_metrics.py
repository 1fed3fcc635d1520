import json
from dataclasses import replace

import numpy as np
import pytest

from blendcap import evaluate
from blendcap.data import Animation, InputError
from blendcap.synthetic.performer import make_performer
from sheet import sheet_rig

RATE = 60.0


@pytest.fixture(scope="module")
def rig():
    return sheet_rig()


@pytest.fixture(scope="module")
def truth(rig):
    """Slow motion of all shapes with four blinks of each eye, a different number of frames apart."""
    rng = np.random.default_rng(0)
    time = np.arange(600)[:, None] / RATE
    weights = 0.25 + 0.25 * np.sin(
        2 * np.pi * rng.uniform(0.1, 0.4, len(rig.names)) * time + rng.uniform(0, 6, len(rig.names))
    )
    for side, shift in (("Left", 0), ("Right", 3)):
        blink = sum(np.exp(-0.5 * ((np.arange(600) - peak - shift) / 4) ** 2) for peak in (60, 190, 350, 500))
        weights[:, rig.index(f"eyeBlink{side}")] = 0.95 * blink
    return Animation(weights, rig.names, RATE)


def changed(animation, rig, change):
    weights = animation.weights.copy()
    change(weights)
    return Animation(weights, rig.names, RATE)


def brute_force(rig, true_rig, answer, truth, vertices):
    difference = (rig.pose(answer.weights) - true_rig.pose(truth.weights))[:, vertices]
    return np.sqrt((difference**2).sum(2).mean(1)).mean()


def test_the_truth_itself_is_perfect(rig, truth):
    found = evaluate(truth, truth, rig)
    assert found.vertex_rmse_mm == found.weight_mae == found.lid_gap_error_mm == found.lip_gap_error_mm == 0
    assert found.roughness_ratio == 1 and found.blink_gain == pytest.approx(1) and found.leak == pytest.approx(0)
    assert found.blinks == 8 and found.frames == 600
    assert set(found.by_region_mm) == {"brows", "lids", "cheeks", "lips", "jaw"}


def test_vertex_errors_are_those_of_posed_vertices(rig, truth):
    rng = np.random.default_rng(1)
    answer = changed(truth, rig, lambda w: np.add(w, rng.normal(scale=0.1, size=w.shape), out=w))
    found = evaluate(answer, truth, rig)
    moving = rig.moving_vertices()
    assert found.vertex_rmse_mm == pytest.approx(brute_force(rig, rig, answer, truth, moving), rel=1e-5)
    for name, error in found.by_region_mm.items():
        vertices = np.intersect1d(rig.regions[name], moving)
        assert error == pytest.approx(brute_force(rig, rig, answer, truth, vertices), rel=1e-5)
    assert found.weight_mae == pytest.approx(np.abs(answer.weights - truth.weights).mean())


def test_the_inside_of_the_head_is_not_the_face(rig, truth):
    inner = np.arange(100, 500)
    hollow = replace(rig, regions={**rig.regions, "eyes": inner})
    answer = changed(truth, rig, lambda w: np.multiply(w, 0.8, out=w))
    found, moving = evaluate(answer, truth, hollow), rig.moving_vertices()
    outer = np.setdiff1d(moving, inner)
    assert found.vertex_rmse_mm == pytest.approx(brute_force(rig, rig, answer, truth, outer), rel=1e-5)
    eyes = np.intersect1d(moving, inner)
    assert found.by_region_mm["eyes"] == pytest.approx(brute_force(rig, rig, answer, truth, eyes), rel=1e-5)


def test_a_performer_is_compared_by_true_positions(rig, truth):
    shift = np.full(rig.mesh.vertices.shape, 0.3)
    performer = make_performer(rig, seed=1, identity=shift)
    acted = performer.act(truth)
    found = evaluate(truth, acted, rig, truth_rig=performer.rig)
    moving = rig.moving_vertices()
    assert found.vertex_rmse_mm == pytest.approx(brute_force(rig, performer.rig, truth, acted, moving), rel=1e-5)
    assert found.vertex_rmse_mm > 0.3
    assert found.weight_mae == 0 and found.roughness_ratio == 1


def test_gaps_are_those_of_posed_vertices(rig, truth):
    answer = changed(truth, rig, lambda w: np.multiply(w, 0.7, out=w))
    found = evaluate(answer, truth, rig)

    def gap(animation, name):
        posed = rig.pose(animation.weights)[:, rig.contacts[name]]
        return np.linalg.norm(posed[:, :, 0] - posed[:, :, 1], axis=2).mean(1)

    error = {name: np.abs(gap(answer, name) - gap(truth, name)).mean() for name in rig.contacts}
    assert found.lip_gap_error_mm == pytest.approx(error["lips"], rel=1e-5)
    assert found.lid_gap_error_mm == pytest.approx((error["lids_left"] + error["lids_right"]) / 2, rel=1e-5)


def test_blink_gain_is_the_slope_and_noise_cannot_inflate_it(rig, truth):
    lids = [rig.index("eyeBlinkLeft"), rig.index("eyeBlinkRight")]

    def damp(weights):
        weights[:, lids] *= 0.6

    def shake(weights):
        weights[:, lids] = 0.6 * weights[:, lids] + np.random.default_rng(0).normal(scale=0.3, size=(len(weights), 2))

    assert evaluate(changed(truth, rig, damp), truth, rig).blink_gain == pytest.approx(0.6, abs=0.02)
    assert evaluate(changed(truth, rig, shake), truth, rig).blink_gain == pytest.approx(0.6, abs=0.1)


def test_without_blinks_there_is_no_gain(rig, truth):
    def stare(weights):
        weights[:, rig.index("eyeBlinkLeft")] = weights[:, rig.index("eyeBlinkRight")] = 0
        weights[200:400, rig.index("eyeBlinkLeft")] = 1  # closed for long: no blink

    still = changed(truth, rig, stare)
    found = evaluate(still, still, rig)
    assert np.isnan(found.blink_gain) and found.blinks == 0
    assert found.as_dict()["blink_gain"] is None


def test_leak_is_the_share_that_goes_to_the_other_side(rig, truth):
    def mix(share):
        def change(weights):
            weights[:] = (1 - share) * weights + share * weights[:, rig.mirror]

        return evaluate(changed(truth, rig, change), truth, rig).leak

    assert [mix(s) for s in (-0.1, 0, 0.1, 0.5, 1)] == pytest.approx([-0.2, 0, 0.2, 1, 2])


def test_roughness_and_sparsity(rig, truth):
    flat = Animation(np.tile(truth.weights[:1], (600, 1)), rig.names, RATE)
    assert evaluate(flat, truth, rig).roughness_ratio == pytest.approx(0, abs=1e-25)
    assert np.isnan(evaluate(flat, flat, rig).roughness_ratio)
    few = changed(truth, rig, lambda w: w.__setitem__((slice(None), slice(3, None)), 0.01))
    found = evaluate(few, truth, rig)
    assert found.sparsity == pytest.approx((truth.weights[:, :3] > 0.02).sum(1).mean())
    noise = np.random.default_rng(0).normal(scale=0.01, size=(600, len(rig.names)))
    shaken = changed(truth, rig, lambda w: np.add(w, noise, out=w))
    assert evaluate(shaken, flat, rig).roughness == pytest.approx(6 * 0.01**2, rel=0.1)  # 1 + 4 + 1


def test_shapes_are_matched_by_name_and_absent_ones_are_zero(rig, truth):
    order = np.random.default_rng(0).permutation(len(rig.names))
    shuffled = Animation(truth.weights[:, order], [rig.names[i] for i in order], RATE)
    assert evaluate(shuffled, truth, rig).vertex_rmse_mm == pytest.approx(0, abs=1e-9)
    some = truth.select(rig.names[:4])
    padded = changed(truth, rig, lambda w: w.__setitem__((slice(None), slice(4, None)), 0))
    assert evaluate(some, truth, rig) == evaluate(padded, truth, rig)


def test_json_has_the_promised_names(rig, truth):
    plain = json.loads(json.dumps(evaluate(truth, truth, rig).as_dict(), allow_nan=False))
    assert {"vertex_rmse_mm", "by_region_mm", "weight_mae", "roughness_ratio", "sparsity"} <= set(plain)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (lambda t: Animation(t.weights[:-1], t.names, RATE), "599 frames, but the truth has 600"),
        (lambda t: Animation(t.weights, t.names, 30), "30 frames a second, but the truth at 60"),
        (lambda t: Animation(t.weights, ["frown", *t.names[1:]], RATE), "shape 'frown' that the rig 'sheet' lacks"),
        (lambda t: Animation(np.where(np.arange(600)[:, None] == 5, np.nan, t.weights), t.names, RATE), "in frame 5"),
    ],
)
def test_what_cannot_be_compared_is_refused(rig, truth, answer, says):
    with pytest.raises(InputError, match=says):
        evaluate(answer(truth), truth, rig)


def test_rigs_must_share_their_vertices(rig, truth):
    from blendcap.data import Mesh, Rig

    other = Rig(Mesh(rig.mesh.vertices[:3], np.array([[0, 1, 2]])), rig.deltas[:, :3], rig.names)
    with pytest.raises(InputError, match="share their vertices"):
        evaluate(truth, truth, rig, truth_rig=other)
