"""Blinks of a lid that frames hardly see, told from its noise."""

import numpy as np
import pytest

from blendcap.data import InputError
from blendcap.solving.curves import Curves
from blendcap.solving.events import CALM, _blink, hidden, lid_events, step_chances, told_by_frames
from blendcap.solving.rows import marker_rows

NOISE = 0.17  # of a weight in one frame


def blinking(peaks, frames, rate, depth=0.95, rest=0.25):
    lid = np.full(frames, rest)
    shape = _blink(0.09, 0.2, rate)
    for peak in peaks:
        begin = peak - round(0.09 * rate) + 1
        lid[begin : begin + len(shape)] = rest + (depth - rest) * shape
    return lid


def told(lid, seed, noise=NOISE):
    rng = np.random.default_rng(seed)
    return lid + noise * rng.normal(size=lid.shape), np.full(lid.shape, noise**-2)


@pytest.mark.parametrize("rate", [30.0, 60.0, 120.0])
def test_blinks_stand_out_of_noise(rate):
    """Twelve blinks to three quarters of the way in a minute: eleven are found, and hardly any moment besides."""
    frames = round(60 * rate)
    peaks = np.linspace(2 * rate, frames - 2 * rate, 12).astype(int)
    lid = blinking(peaks, frames, rate)
    moving = np.abs(np.diff(lid, prepend=lid[0])) > 0
    found = missed = false = 0
    for seed in range(3):
        chance, calm = step_chances(*told(lid, seed), rate)
        found += sum(chance[p - 2 : p + 3].max() > 0.5 for p in peaks)
        near = np.convolve(moving, np.ones(round(0.3 * rate) | 1), "same") > 0
        false += (chance[~near] > 0.5).sum()
        missed += (chance[~near]).mean()
        assert np.sqrt(calm * rate / 60) < 1.5 * CALM
    assert found >= 33 and false < 0.02 * 3 * frames and missed / 3 < 0.1


def test_a_lid_at_rest_is_calm_and_one_that_is_well_seen_moves_when_it_moves():
    still = np.full(1800, 0.3)
    assert (step_chances(*told(still, 1), 60.0)[0] > 0.5).mean() < 0.01
    assert (step_chances(*told(np.full(14400, 0.3), 1), 24.0)[0] > 0.5).mean() < 0.022
    ramp = np.interp(np.arange(600), [300, 312], [0.1, 0.9])
    chance, _ = step_chances(*told(ramp, 1, noise=0.01), 60.0)
    assert chance[302:312].min() > 0.99 and max(chance[:295].max(), chance[320:].max()) < 0.2


def test_how_much_a_calm_lid_drifts_is_learned():
    """A random walk of 0.003 and of 0.012 a frame."""
    for size, rate in ((0.003, 60.0), (0.012, 60.0), (0.004, 240.0)):
        rng = np.random.default_rng(2)
        walk = np.abs((np.cumsum(size * rng.normal(size=6000)) + 0.5 + 1) % 2 - 1)  # folded into 0 to 1
        calm = step_chances(*told(walk, 3, noise=0.05), rate)[1]
        assert 0.7 * size < np.sqrt(calm) < 1.5 * size


def test_frames_that_tell_nothing_and_takes_of_a_frame_are_calm():
    chance, calm = step_chances(np.full(200, 0.4), np.zeros(200), 60.0)
    assert np.isfinite(chance).all() and chance.max() < 0.9 and calm > 0
    for frames in (1, 2, 3):
        chance, calm = step_chances(np.full(frames, 0.4), np.ones(frames), 240.0)
        assert chance.shape == (frames,) and np.isfinite(chance).all() and calm > 0


def test_both_sides_tell_a_blink_that_neither_does_and_a_wink_is_one_sides():
    rate, peaks = 30.0, [60, 160, 260, 360]
    lid = blinking(peaks, 400, rate)
    wink = blinking([210], 400, rate)
    truth = np.column_stack([np.maximum(lid, wink), lid, np.full(400, 0.2)])
    noise = np.array([0.08, 0.35, 0.05])
    rng = np.random.default_rng(4)
    seen = truth + noise * rng.normal(size=truth.shape), np.tile(noise**-2.0, (400, 1))
    quick, partner = np.array([True, True, False]), np.array([1, 0, 2])
    chance, calm = lid_events(*seen, quick, partner, rate)
    assert min(chance[p, i] for p in peaks for i in (0, 1)) > 0.9 and chance[210, 0] > 0.9
    assert not chance[:, 2].any() and np.isnan(calm[2]) and calm[0] == calm[1]
    alone = step_chances(seen[0][:, 1], seen[1][:, 1], rate)[0]
    assert min(alone[p] for p in peaks) < 0.8


def test_what_a_frame_tells_is_the_best_weight_if_only_it_could_move():
    rng = np.random.default_rng(0)
    columns, missing = rng.normal(size=(4, 6, 3)), rng.random((7, 6)) < 0.3
    moved = rng.normal(size=(7, 6, 3))
    moved[missing] = np.nan
    rows = marker_rows(columns[:3], columns[3:], moved, np.tile([0.0, 1.0], (3, 1)), -1.0)
    unknowns, strength = rng.random((7, 4)), np.array([0.5, 0.0, 2.0])
    curves = Curves(*rng.random((2, 7, 3)))
    value, precision = told_by_frames(rows, unknowns, 0.3, curves, strength)

    def energy(a):
        return np.nansum(rows.errors(a) ** 2) + curves.energy(a[:, :3], strength).sum()

    for t, i in ((0, 0), (3, 1), (6, 2)):
        here, step = unknowns.copy(), 1e-3
        here[t, i] = value[t, i]
        low, mid, high = (
            energy(here + step * k * (np.arange(7)[:, None] == t) * (np.arange(4) == i)) for k in (-1, 0, 1)
        )
        assert abs(high - low) < 1e-9 and (high + low - 2 * mid) / 2 / step**2 == pytest.approx(0.09 * precision[t, i])


def test_a_side_that_hides_moves_neither_lid():
    """One lid hangs lower than the other: where its markers vanish, what both tell must not leap."""
    rng = np.random.default_rng(1)
    truth, noise = np.tile([0.1, 0.55], (400, 1)), 0.05
    precision = np.full((400, 2), noise**-2)
    precision[150:200, 1] = 0
    seen = truth + noise * rng.normal(size=truth.shape)
    chance, _ = lid_events(seen, precision, np.ones(2, bool), np.array([1, 0]), 60.0)
    assert chance[145:205].max() < 0.5


@pytest.mark.parametrize("rest", [0.0, 0.3, 0.85, 1.0])
def test_a_lid_is_calm_wherever_it_rests(rest):
    chance, _ = step_chances(*told(np.full(900, rest), 2, noise=0.05), 60.0)
    assert chance.mean() < 0.06


@pytest.mark.parametrize(("weight", "precision"), [(np.nan, 1.0), (0.5, np.nan), (0.5, np.inf), (0.5, -1.0)])
def test_what_is_no_number_is_refused(weight, precision):
    seen = np.full(100, 0.3), np.ones(100)
    seen[0][50], seen[1][50] = weight, precision
    with pytest.raises(InputError, match="must be numbers, of a precision of 0 or more"):
        step_chances(*seen, 60.0)


@pytest.mark.parametrize("rate", [24.0, 30.0, 120.0, 240.0])
def test_an_event_is_told_when_it_is(rate):
    """A lid that falls in a fifth of a second is on its way then, at any rate, and not a block of frames later."""
    frames = round(4 * rate)
    seconds = np.arange(frames) / rate
    chance, _ = step_chances(*told(np.interp(seconds, [2.0, 2.2], [0.1, 0.9]), 1, noise=0.02), rate)
    moving = seconds[chance > 0.5]
    assert abs(moving.mean() - 2.1 - 0.5 / rate) < 0.006 and 0.13 < np.ptp(moving) < 0.3


def test_what_hardly_any_marker_sees_for_a_while_is_no_event():
    """Frames that tell less than a guess and a tenth of what others tell; where all tell as little, none is hidden."""
    precision = np.full((20, 3), 40.0)
    precision[5:9, :2] = 1.0
    precision[10:12, 0] = 1.0  # its partner sees
    precision[15, :2] = 2.1  # together more than a guess
    guess, quick, partner = 0.5, np.array([True, True, False]), np.array([1, 0, 2])
    answer = hidden(precision, guess, quick, partner)
    assert np.argwhere(answer).tolist() == [[t, i] for t in range(5, 9) for i in (0, 1)]
    assert not hidden(np.full((20, 3), 0.1), guess, quick, partner).any()
