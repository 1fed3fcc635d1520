"""The counting of the hybrid benchmark: what is told early or late, and what is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import blendcap


@pytest.fixture
def counts(benchmark_module):
    return benchmark_module("hybrid_counts")


def test_near_reaches_so_many_frames_and_does_not_wrap_around(counts):
    flags = np.zeros((9, 2), dtype=bool)
    flags[[0, 8], [0, 1]] = True
    near = counts.near(flags, 2)
    np.testing.assert_array_equal(near[:, 0], np.arange(9) <= 2)
    np.testing.assert_array_equal(near[:, 1], np.arange(9) >= 6)
    np.testing.assert_array_equal(counts.near(flags, 0), flags)


def test_hits_are_precision_and_recall_with_and_without_tolerance(counts):
    true = np.repeat([False, True, False], [4, 3, 4])
    late = np.roll(true, 1)
    assert counts.hits(late, true) == "0.67, 0.67 (1.00, 1.00)"
    assert counts.hits(true, true) == "1.00, 1.00 (1.00, 1.00)"
    first, last = np.arange(11) == 0, np.arange(11) == 10
    assert counts.hits(first, last) == "0.00, 0.00 (0.00, 0.00)"


def test_closings_are_counted_whole(counts):
    true = np.ones((40, 2))
    true[5:9], true[20:30, 0], true[36:] = 0.1, 0.2, 0.3  # three: both eyes blink, the right one winks; then a doubt
    said = np.ones_like(true)
    said[10:12, 0], said[8:18, 1], said[32:34, 1], said[37] = 0.1, 0.1, 0.1, 0.1
    assert counts.blinks(true, true) == "1.00, 1.00 (3)"
    assert counts.blinks(said, true) == "0.67, 0.67 (3)"  # told once where nothing was, and the wink is not told
    assert counts.blinks(np.ones_like(true), true) == "0.00, 0.00 (3)"


def test_a_closing_stands_for_one_closing(counts):
    true = np.ones((60, 2))
    true[5:9], true[20:24], true[40:44] = 0.1, 0.1, 0.1
    assert counts.blinks(np.zeros_like(true), true) == "1.00, 0.33 (6)"  # always shut
    split = true.copy()
    split[22] = 1.0
    assert counts.blinks(split, true) == "0.75, 1.00 (6)"  # two told in one


def test_a_lid_that_lingers_half_shut_does_not_blink_twice(counts):
    true = np.ones((60, 2))
    true[5:30], true[16:18], true[40:44] = 0.2, 0.4, 0.1  # 0.4 is neither shut nor plainly open
    said = np.ones_like(true)
    said[5:30], said[40:44] = 0.2, 0.1
    assert counts.blinks(said, true) == "1.00, 1.00 (4)" == counts.blinks(true, said)
    true[16:18] = 0.6
    assert counts.blinks(said, true) == "1.00, 0.67 (6)"


def test_shut_lids_are_judged_where_the_truth_is_plain(counts):
    true = np.array([0.1, 0.2, 0.3, 0.4, 0.9, 1.0])[:, None] * [1, 1]
    assert counts.shut(true, true) == "1.00, 1.00 (1.00, 1.00)"
    late = np.array([0.1, 0.5, 0.4, 0.3, 0.9, 0.3])[:, None] * [1, 1]
    assert counts.shut(late, true) == "0.50, 0.50 (0.33, 0.33)"


def test_a_closing_is_squeezed_as_a_whole_or_not_at_all(benchmark_module):
    hybrid, hump = benchmark_module("hybrid"), np.sin(np.linspace(0, np.pi, 21))
    blink = np.concatenate([hump, np.zeros(5)] * 4)
    squint = np.concatenate([0.2 * hump, np.zeros(5), 0.6 * hump**3, np.zeros(5)] * 2)  # squeezing shows late
    kind = np.repeat([False, True, False, True], 26) & (blink > hybrid.FAINT)
    np.testing.assert_array_equal(hybrid.squeezed(squint, blink), kind)
    np.testing.assert_array_equal(hybrid.squeezed(3 * squint, blink), kind)  # the two kinds part where they part
    one = np.concatenate([hump, np.zeros(5)])
    assert not hybrid.squeezed(0.2 * one, one).any() and hybrid.squeezed(0.6 * one, one).any()  # one closing alone
    uneven = np.repeat([0.9, 1.1, 1.0, 0.95], 26) * blink  # one kind
    assert not hybrid.squeezed(0.2 * uneven, blink).any()
    assert hybrid.squeezed(0.7 * uneven, blink)[blink > hybrid.FAINT].all()


def test_every_gain_is_of_ways_that_are_run(benchmark_module):
    solves = benchmark_module("hybrid_solves")
    for _, ours, theirs in solves.PAIRS:
        assert any({ours, theirs} <= set(runs) for runs in (solves.RUNS, solves.LAYOUTS))
    solved = set(solves.RUNS + solves.LAYOUTS) - set(solves.UNSOLVED)
    assert all(layout in solves.MARKERS and way in solves.WAYS for layout, _, way in solved)
    assert set(solves.BRIEF) < set(solves.RUNS)


def test_kept_frames_are_made_once_and_read_as_they_were(benchmark_module, tmp_path):
    film = benchmark_module("hybrid_data")
    pictures = np.random.default_rng(0).integers(0, 255, (2, 3, 4, 5), dtype=np.uint8)
    shots = [SimpleNamespace(size=(5, 4), count=3, frames=lambda v=view: iter(pictures[v])) for view in (0, 1)]
    path = tmp_path / "film.frames.npy"
    np.testing.assert_array_equal(film._kept(path, lambda: shots), pictures)
    np.testing.assert_array_equal(film._kept(path, lambda: []), pictures)  # not made anew
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    dark = film._spoilt(pictures, lambda view, number, picture: picture * (view + number > 0))
    told = np.array([list(frames) for frames in dark])
    np.testing.assert_array_equal(told[0, 0], 0)
    np.testing.assert_array_equal(told.reshape(6, 4, 5)[1:], pictures.reshape(6, 4, 5)[1:])


def test_other_markers_are_worn_in_the_same_slipping_helmet(benchmark_module):
    film = benchmark_module("hybrid_data")
    own, rig = film.face("mannequin", 1), film.given("mannequin", 1)
    performer = film.make_performer(own, seed=1)
    weights = np.zeros((30, len(own.names)))
    weights[:, 0] = np.linspace(0, 1, 30)
    acted = film.Animation(weights, own.names, 24.0)
    take, truth = film.make_take(performer, acted, film.choose_points(own, 40, seed=1), seed=1)
    filmed = SimpleNamespace(rig=rig, own=own, acted=acted, take=take, truth=truth, seed=1)
    other, told, _ = film.worn(filmed, 20, False)
    np.testing.assert_array_equal(told.slip, truth.slip)
    rest, deltas = performer.rig.sample(told.points)
    still = rest + np.tensordot(performer.expand(truth.animation.weights), deltas, axes=1)
    slipped = film.slip_matrices(truth)
    expected = np.einsum("tij,tkj->tki", slipped[:, :3, :3], still) + slipped[:, None, :3, 3]
    np.testing.assert_allclose(told.positions, expected, atol=1e-9)
    assert np.nanstd(other.positions - told.positions) < 0.25 and np.abs(truth.slip).max() > 1.0


def test_lids_of_made_up_people_meet_and_lie_on_their_eyeballs(benchmark_module, data):
    data("rigs/ict_facekit.npz")  # skips where there is none
    film = benchmark_module("hybrid_data")
    template, person = film.face("ICT", 0), film.face("ICT", 111)
    for side, shape in (("left", "eyeBlink_L"), ("right", "eyeBlink_R")):
        gap, sunk = [], []
        for rig in (template, person):
            upper, lower = rig.contacts[f"lids_{side}"].T
            shut = rig.mesh.vertices + rig.deltas[rig.index(shape)]
            gap.append(np.linalg.norm(shut[upper] - shut[lower], axis=1).mean())
            eye = rig.mesh.vertices[rig.regions[f"eyeball_{side}"]]
            center, radius = eye.mean(0), np.linalg.norm(eye - eye.mean(0), axis=1).max()
            at = [way * shut + (1 - way) * rig.mesh.vertices for way in (0.0, 0.5, 1.0)]
            sunk.append([(np.linalg.norm(v[[*upper, *lower]] - center, axis=1) / radius).min() for v in at])
        assert gap[1] < 1.1 * gap[0] < 0.8  # with the modes as they are it is 2.1 mm
        np.testing.assert_array_less(np.array(sunk[0]) - 0.03, sunk[1])  # of the radius; as they are it is 0.05


def lids_at(counts, rig, **weights):
    """The gap of the left lids under weights."""
    amounts = [[weights.get(name, 0.0) for name in rig.names]]
    return counts.gaps(rig, blendcap.Animation(np.array(amounts), rig.names, 24.0))[0, 0]


def test_lids_that_pass_each_other_are_not_open_again(counts):
    rig = blendcap.mannequin(3, shapes=52)
    for amount in (0.0, 0.5, 1.0, 1.5):
        assert lids_at(counts, rig, eyeBlinkLeft=amount) == pytest.approx(max(1 - amount, 0), abs=1e-6)
    assert lids_at(counts, rig, eyeBlinkRight=1.0) == pytest.approx(1, abs=0.01)


def test_where_lids_pass_each_other_hides_no_place_where_they_are_open(counts):
    rig = blendcap.mannequin(3, shapes=52)
    upper, lower = rig.contacts["lids_left"].T
    deltas, blink = rig.deltas.copy(), rig.deltas[rig.index("eyeBlinkLeft")]
    half = np.concatenate([upper[::2], lower[::2]])
    across = blink[upper] - blink[lower]
    deltas[rig.index("browDownLeft")] = deltas[rig.index("browDownRight")] = 0
    deltas[rig.index("browDownLeft"), half] = 1.9 * blink[half]
    deltas[rig.index("browDownRight"), upper] = 3 * np.cross(across, [1.0, 0, 0])
    rig = replace(rig, deltas=deltas)
    way = np.linalg.norm(across, axis=1)
    open_part = 1 - way[np.isin(upper, half)].sum() / way.sum()
    assert lids_at(counts, rig, browDownLeft=1.0) == pytest.approx(open_part, abs=0.02)
    assert lids_at(counts, rig, browDownRight=1.0) == pytest.approx(1, abs=1e-6)  # across the way


def test_gains_are_taken_of_films_that_both_ways_solved(benchmark_module):
    solves = benchmark_module("hybrid_solves")
    alone, curves, best = (("50", "learned", "markers only"), ("50", "learned", "curves"), solves.UNSOLVED[1])
    errors = {
        alone: {(1, 0): [1.0, 2.0], (1, 1): [4.0, 2.0], (2, 0): [1.0, 1.0]},
        curves: {(1, 0): [0.5, 2.0], (1, 1): [1.0, 2.0], (2, 0): [1.0, 0.5]},
        best: {(1, 0): [0.1, 0.2], (2, 0): [0.3, 0.1]},
    }
    rows = solves._gains("mannequin", "performance", errors)
    assert [row.split(" | ")[2:] for row in rows] == [
        ["curves (the papers' idea)", "3", "-42% (-75% to +0%)", "-17% (-50% to +0%) |"],
        ["best weights, unsolved", "2", "-80% (-90% to -70%)", "-90% (-90% to -90%) |"],
    ]
