import ezc3d
import numpy as np
import pytest

from blendcap import InputError, MarkerTake, read_markers, write_markers
from blendcap.synthetic.mislabels import mislabel


@pytest.fixture(scope="module")
def take():
    """Sixteen markers on a grid that sway together, with gaps."""
    rng = np.random.default_rng(0)
    rest = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), [0.0]), -1).reshape(-1, 3) * 20
    sway = 5 * np.sin(np.arange(600)[:, None, None] / [[[20, 33, 41]]]) + rng.normal(scale=0.1, size=(600, 16, 3))
    positions = rest + sway
    for marker in range(0, 16, 3):
        start = rng.integers(500)
        positions[start : start + 40, marker] = np.nan
    return MarkerTake(positions, tuple(f"m{i:02}" for i in range(16)), 119.88)


@pytest.fixture(scope="module")
def spoiled(take):
    return mislabel(take, seed=4, swaps=5, ghosts=8, loose=4)


def test_without_mistakes_the_take_is_the_take(take):
    same, truth = mislabel(take, seed=1)
    assert np.array_equal(same.positions, take.positions, equal_nan=True) and same.names == take.names
    assert truth.swaps == () and truth.loose == () and not truth.false.any()
    assert np.array_equal(truth.owner, np.where(take.missing, -1, np.arange(16)))


def test_every_position_is_its_owners(take, spoiled):
    wrong, truth = spoiled
    frame, label = np.nonzero(truth.owner >= 0)
    assert np.array_equal(wrong.positions[frame, label], take.positions[frame, truth.owner[frame, label]])
    assert np.array_equal(np.isnan(wrong.positions[..., 0]), (truth.owner < 0) & ~truth.false)


def test_labels_change_places_exactly_where_the_truth_says(take, spoiled):
    wrong, truth = spoiled
    assert len(truth.swaps) == 5
    changed = np.zeros((600, 16), dtype=bool)
    for one, two, start, stop in truth.swaps:
        a, b = take.names.index(one), take.names.index(two)
        assert np.array_equal(wrong.positions[start:stop, a], take.positions[start:stop, b])
        assert np.array_equal(wrong.positions[start:stop, b], take.positions[start:stop, a])
        assert 8 <= stop - start <= 60 and np.linalg.norm(take.positions[start, a] - take.positions[start, b]) < 45
        assert not changed[start:stop, [a, b]].any()
        changed[start:stop, [a, b]] = True
    off = np.any(wrong.positions[:, :16] != take.positions, axis=2) & ~take.missing
    assert np.array_equal(off, changed | truth.false[:, :16])


def test_ghosts_are_off_their_marker(take, spoiled):
    wrong, truth = spoiled
    false = truth.false[:, :16]
    away = np.linalg.norm(wrong.positions[:, :16][false] - take.positions[false], axis=1)
    assert away.min() > 5 and away.max() < 60
    starts = (np.diff(np.vstack([np.zeros(16), false]), axis=0) == 1).sum()
    assert 6 <= starts <= 8  # two may touch
    assert not (truth.false & (truth.owner >= 0)).any()


def test_loose_trajectories_have_no_label(spoiled):
    wrong, truth = spoiled
    assert wrong.names[16:] == truth.loose == ("*0", "*1", "*2", "*3")
    seen = ~wrong.missing[:, 16:]
    assert (seen.sum(0) >= 10).all() and (seen.sum(0) <= 120).all()
    assert (np.abs(np.diff(seen.astype(int), axis=0)).sum(0) <= 2).all()  # each in one piece


def test_a_seed_is_a_set_of_mistakes(take, spoiled):
    again, other = (mislabel(take, seed=s, swaps=5, ghosts=8, loose=4) for s in (4, 5))
    assert np.array_equal(again[0].positions, spoiled[0].positions, equal_nan=True)
    assert other[1].swaps != spoiled[1].swaps


def test_mistakes_survive_a_c3d_file(spoiled, tmp_path):
    wrong, truth = spoiled
    write_markers(tmp_path / "take.c3d", wrong)
    back = read_markers(tmp_path / "take.c3d")
    assert back.names == wrong.names and back.rate == pytest.approx(wrong.rate, rel=1e-6)
    assert np.array_equal(back.missing, wrong.missing)
    assert np.nanmax(np.abs(back.positions - wrong.positions)) < 1e-5  # float32
    assert ((truth.owner >= 0) & (truth.owner != np.arange(20))).sum() > 50
    peer = ezc3d.c3d(str(tmp_path / "take.c3d"))
    assert peer["parameters"]["POINT"]["UNITS"]["value"] == ["mm"]
    residuals = peer["data"]["meta_points"]["residuals"][0].T
    assert np.array_equal(residuals < 0, wrong.missing)


def test_bad_input_is_told_in_a_sentence(take):
    with pytest.raises(InputError, match="swaps must be 0 or more"):
        mislabel(take, seed=0, swaps=-1)
    short = MarkerTake(take.positions[:4], take.names, 60)
    with pytest.raises(InputError, match="no room"):
        mislabel(short, seed=0, swaps=1)
    with pytest.raises(InputError, match="no room"):
        mislabel(take, seed=0, ghosts=100_000)
