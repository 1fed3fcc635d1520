from dataclasses import replace

import numpy as np
import pytest

from blendcap.data import Animation, InputError
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points
from sheet import sheet_rig


@pytest.fixture(scope="module")
def rig():
    return sheet_rig()


@pytest.fixture(scope="module")
def performer(rig):
    return make_performer(rig, seed=4)


def gains(rig, performer):
    """(N, V): how much more each vertex moves, NaN where it hardly moves."""
    own = np.linalg.norm(rig.deltas, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.linalg.norm(performer.rig.deltas[: len(own)], axis=2) / own
    return np.where(own > 1e-3, ratio, np.nan)


def test_without_strength_the_performer_is_the_rig(rig):
    same = make_performer(rig, seed=1, strength=0.0)
    count = len(rig.names)
    assert np.array_equal(same.rig.deltas[:count], rig.deltas)
    assert not same.rig.deltas[count:].any()
    assert same.names == rig.names


def test_a_seed_is_a_person(rig, performer):
    assert np.array_equal(make_performer(rig, seed=4).rig.deltas, performer.rig.deltas)
    assert not np.allclose(make_performer(rig, seed=5).rig.deltas[:13], performer.rig.deltas[:13])


def test_gains_are_personal_smooth_and_about_a_sixth(rig):
    spread = []
    for seed in range(8):
        gain = gains(rig, make_performer(rig, seed=seed))
        spread.append(np.nanstd(np.log(gain)))
        edges = rig.mesh.faces[:, :2]
        assert np.nanmax(np.abs(np.diff(np.log(gain)[:, edges], axis=2))) < 0.06  # from vertex to vertex
        energy = np.where(np.isnan(gain), 0, (rig.deltas**2).sum(2))
        closing = [rig.index(n) for n in ("eyeBlinkLeft", "eyeBlinkRight")]
        energy[closing] = 0
        assert (np.nan_to_num(np.log(gain)) * energy).sum() / energy.sum() == pytest.approx(0, abs=0.06)
    assert 0.08 < np.mean(spread) < 0.22


def test_left_and_right_gains_are_alike(rig):
    pair = [rig.index("mouthSmileLeft"), rig.index("mouthSmileRight")]
    mean = [np.nanmean(np.log(gains(rig, make_performer(rig, seed=s)))[pair], axis=1) for s in range(80)]
    assert np.corrcoef(np.transpose(mean))[0, 1] > 0.45
    assert np.std(np.diff(mean)) < 0.135  # strangers: 0.16


def test_everybody_can_close_the_eyes(rig):
    for seed in range(3):
        performer = make_performer(rig, seed=seed)
        for name in ("eyeBlinkLeft", "eyeBlinkRight"):
            assert np.array_equal(performer.rig.deltas[rig.index(name)], rig.deltas[rig.index(name)])


def test_correctives_need_both_drivers(rig, performer):
    count = len(rig.names)
    assert len(performer.drivers) > 4
    linear = performer.rig.select(rig.names)
    for k, (i, j) in enumerate(performer.drivers):
        weights = np.zeros((3, count))
        weights[0, i] = weights[1, j] = 0.8
        weights[2, [i, j]] = 0.8
        posed = performer.pose(weights) - linear.pose(weights)
        assert np.abs(posed[:2]).max() < 1e-5
        assert np.allclose(posed[2], 0.64 * performer.rig.deltas[count + k], atol=1e-5)


def test_correctives_are_a_tenth_to_a_quarter_of_the_smaller_driver(rig, performer):
    size = np.linalg.norm(performer.rig.deltas, axis=2).max(1)
    template = np.linalg.norm(rig.deltas, axis=2).max(1)
    share = size[len(rig.names) :] / template[performer.drivers].min(1)
    assert share.min() > 0.0999 and share.max() < 0.2501


def test_correctives_do_not_move_what_one_driver_leaves(rig, performer):
    for k, (i, j) in enumerate(performer.drivers):
        still = (np.linalg.norm(rig.deltas[[i, j]], axis=2) == 0).any(0)
        assert not performer.rig.deltas[len(rig.names) + k][still].any()


def test_samples_ride_on_the_posed_skin(rig, performer):
    points = choose_points(rig, 12)
    weights = np.random.default_rng(0).uniform(size=(4, len(rig.names)))
    posed = performer.pose(weights)
    direct = np.stack([points.matrix(rig.mesh) @ frame for frame in posed])
    assert np.allclose(performer.sample(points, weights), direct, atol=1e-4)


def test_an_identity_moves_the_neutral(rig):
    shift = np.random.default_rng(1).normal(size=rig.mesh.vertices.shape)
    performer = make_performer(rig, seed=2, identity=shift)
    assert np.allclose(performer.pose(np.zeros(len(rig.names))), rig.mesh.vertices + shift)


def test_acting_matches_shapes_by_name(rig, performer):
    animation = Animation(np.array([[0.3, 0.7]]), ("jawOpen", "mouthPucker"), 30)
    acted = performer.act(animation)
    assert acted.names == performer.rig.names
    assert acted.weights[0, rig.index("mouthPucker")] == 0.7
    assert acted.weights[0, : len(rig.names)].sum() == 1.0
    with pytest.raises(InputError, match="no shape 'frown'"):
        performer.act(Animation(np.ones((1, 1)), ("frown",), 30))


def test_correctives_do_not_bend_eyes(rig):
    eyes = np.arange(100, 500)
    with_eyes = replace(rig, regions={**rig.regions, "eyes": eyes})
    performer = make_performer(with_eyes, seed=4)
    correctives = performer.rig.deltas[len(rig.names) :]
    assert len(correctives) and correctives.any()
    assert not correctives[:, eyes].any()


def test_skin_resists_between_rest_and_full(rig):
    performer = make_performer(rig, seed=4, resistance=1.0)
    count = len(rig.names)
    level = np.linspace(0, 1, 21)
    felt = performer.expand(np.repeat(level[:, None], count, axis=1))[:, :count]
    assert (np.diff(felt, axis=0) > 0).all()  # more is always more
    assert np.array_equal(felt[0], np.zeros(count)) and np.array_equal(felt[-1], np.ones(count))
    ahead = felt[10] - 0.5
    assert 0.03 < ahead.mean() < 0.09 and ahead.std() > 0.01 and np.abs(ahead).max() <= 0.25 * 0.8
    outside = performer.expand(np.full(count, 1.2))[:count]
    assert np.allclose(outside, 1.2)


def test_without_resistance_the_skin_is_linear(rig, performer):
    weights = np.random.default_rng(0).uniform(size=(5, len(rig.names)))
    assert np.array_equal(performer.expand(weights)[:, : len(rig.names)], weights)
    bent = make_performer(rig, seed=4, resistance=1.0)
    assert np.array_equal(bent.rig.deltas, performer.rig.deltas)  # the same person otherwise
    assert np.array_equal(make_performer(rig, seed=4, resistance=1.0).resistance, bent.resistance)
    strong = make_performer(rig, seed=4, resistance=50.0).resistance
    assert np.abs(strong).max() < 1


def test_left_and_right_resist_alike(rig):
    pair = [rig.index("mouthSmileLeft"), rig.index("mouthSmileRight")]
    both = np.array([make_performer(rig, seed=s, resistance=0.5).resistance[pair] for s in range(60)])
    assert np.corrcoef(both.T)[0, 1] > 0.5


def test_correctives_follow_the_skin(rig):
    performer = make_performer(rig, seed=4, resistance=1.0)
    weights = np.random.default_rng(1).uniform(size=len(rig.names))
    expanded = performer.expand(weights)
    felt, correctives = expanded[: len(weights)], expanded[len(weights) :]
    felt[rig.index("jawOpen")] = max(felt[rig.index("jawOpen")] - felt[rig.index("mouthClose")], 0)
    assert np.allclose(correctives, felt[performer.drivers].prod(1))


def test_bad_resistance_is_refused(rig):
    with pytest.raises(InputError, match="resistance must be 0 or more"):
        make_performer(rig, seed=0, resistance=-1)
