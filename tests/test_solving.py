"""The one equation on random problems small enough to be written out in full."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from blendcap.data import InputError
from blendcap.numerics.boxls import solve_box
from blendcap.solving.curves import Curves
from blendcap.solving.events import FREE
from blendcap.solving.learned import (
    HANDOVER_FRAMES,
    HELMET_RIDGE,
    HELMET_STEP,
    _Belief,
    _pull_along,
    _terms,
    handed_over,
    solve_learned,
)
from blendcap.solving.live import REFRESH, LiveSolver, solve_live
from blendcap.solving.noise import marker_noise
from blendcap.solving.paper import solve_paper
from blendcap.solving.prior import (
    DEVIATION_FLOOR,
    HOLD,
    PSEUDO_FRAMES,
    REACH,
    STEP_FLOOR,
    TakePrior,
    relearned_prior,
    resting,
    step_weights,
    symmetric_prior,
    trend,
)
from blendcap.solving.rows import MarkerRows, marker_rows
from blendcap.solving.settings import SolveSettings
from blendcap.solving.visibility import Kinship, weight_errors

SHAPES, MARKERS, FRAMES = 5, 8, 14
MIRROR = np.array([1, 0, 3, 2, 4])
KIN = Kinship.of_pairs(MIRROR)


def random_rows(seed=0, frames=FRAMES, helmet=2, gaps=0.2, noise=0.3, helmet_lower=-1.0):
    """Rows, and the unknowns that made their targets: smooth, and now and then on their bounds."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(SHAPES + helmet, MARKERS, 3))
    time = np.linspace(0, 2 * np.pi, frames)[:, None]
    truth = np.clip(0.5 + 0.7 * np.sin(time * rng.uniform(0.4, 1.4, SHAPES) + rng.uniform(0, 6, SHAPES)), 0, 1)
    truth = np.hstack([truth, np.tile(rng.uniform(0.1, 0.4, helmet), (frames, 1))])
    moved = np.tensordot(truth, columns, 1) + rng.normal(scale=noise, size=(frames, MARKERS, 3))
    moved[rng.random((frames, MARKERS)) < gaps] = np.nan
    bounds = np.tile([0.0, 1.0], (SHAPES, 1))
    return marker_rows(columns[:SHAPES], columns[SHAPES:], moved, bounds, helmet_lower), truth


def least_squares(rows: MarkerRows, quadratic, linear=0.0, coupling=None):
    """scipy's answer to the whole take at once: |H a - y|² + a'Q a + 2 l'a + sum c |a_t - a_(t-1)|², a in the box.

    The linear term is put into the square: `a'Qa + 2 l'a = |R a + R^-T l|² - const` with `R'R = Q`.
    """
    frames, size = len(rows.targets), len(rows.lower)
    root = np.linalg.cholesky(quadratic).T
    blocks, sides = [], []
    for t in range(frames):
        seen = ~rows.missing[t]
        block = np.zeros((3 * seen.sum() + size, frames * size))
        block[:, t * size : (t + 1) * size] = np.vstack([rows.rows[seen].reshape(-1, size), root])
        shift = -np.linalg.solve(root.T, np.broadcast_to(linear, size))
        blocks.append(block)
        sides.append(np.concatenate([rows.targets[t, seen].ravel(), shift]))
    if coupling is not None:
        for t in range(1, frames):
            block = np.zeros((size, frames * size))
            step = np.diag(np.sqrt(np.broadcast_to(coupling, (frames, size))[t]))
            block[:, t * size : (t + 1) * size], block[:, (t - 1) * size : t * size] = step, -step
            blocks.append(block)
            sides.append(np.zeros(size))
    limits = (np.tile(rows.lower, frames), np.tile(rows.upper, frames))
    answer = lsq_linear(np.vstack(blocks), np.concatenate(sides), limits, method="bvls", tol=1e-14, max_iter=2000)
    return answer.x.reshape(frames, size)


# Rows


def test_rows_are_one_quadratic():
    rows, _ = random_rows()
    a = np.random.default_rng(1).uniform(size=(FRAMES, SHAPES + 2))
    flat = rows.rows.reshape(MARKERS, 3, -1)
    for t in range(FRAMES):
        lost = flat[rows.missing[t]].reshape(-1, a.shape[1])
        gram = rows.gram - lost.T @ lost
        cost = a[t] @ gram @ a[t] + 2 * rows.linear[t] @ a[t] + (rows.targets[t] ** 2).sum()
        assert cost == pytest.approx(np.nansum(rows.errors(a)[t] ** 2))
    assert np.array_equal(np.isnan(rows.errors(a)), rows.missing)


def test_rows_hold_shapes_then_helmet():
    rows, truth = random_rows(noise=0.0, gaps=0.0)
    assert np.allclose(rows.predict(truth), rows.targets)
    assert rows.shapes == SHAPES and np.array_equal(rows.lower, [0] * SHAPES + [-1] * 2)
    bare, _ = random_rows(helmet=0)
    assert bare.rows.shape == (MARKERS, 3, SHAPES)


def test_the_mean_gram_is_the_mean_of_the_grams():
    rows, _ = random_rows(gaps=0.4)
    grams = [(h := rows.rows[~lost].reshape(-1, SHAPES + 2)).T @ h for lost in rows.missing]
    assert np.allclose(rows.mean_gram, np.mean(grams, axis=0))


def test_new_targets_leave_the_gaps_alone():
    rows, _ = random_rows()
    moved = rows.with_targets(np.full_like(rows.targets, 7.0))
    assert (moved.targets[rows.missing] == 0).all() and (moved.targets[~rows.missing] == 7).all()


# Noise


def test_noise_is_measured_and_motion_is_not():
    rng, time = np.random.default_rng(0), np.arange(600)[:, None, None] / 60
    motion = 5 * np.sin(2 * np.pi * 0.8 * time + rng.uniform(0, 6, (20, 3)))
    noise = rng.normal(scale=0.2, size=(600, 20, 3))
    assert marker_noise(motion + noise) == pytest.approx(0.2, rel=0.03)
    assert marker_noise(motion) < 0.001
    cubic = time**3 - 4 * time**2 + time  # fourth differences do not see it at all
    assert marker_noise(noise + cubic) == pytest.approx(marker_noise(noise), rel=1e-9)
    assert marker_noise(3 * noise) == pytest.approx(3 * marker_noise(noise))


def test_noise_is_measured_around_gaps_and_jumps():
    rng = np.random.default_rng(1)
    noise = rng.normal(scale=0.2, size=(900, 10, 3))
    noise[rng.random((900, 10)) < 0.1] = np.nan
    noise[450:] += 10.0
    assert marker_noise(noise) == pytest.approx(0.2, rel=0.05)


def test_too_short_a_take_tells_no_noise():
    assert marker_noise(np.zeros((4, 3, 3))) == 0.0
    assert marker_noise(np.full((9, 3, 3), np.nan)) == 0.0


def test_the_error_of_a_weight_is_that_of_its_least_squares():
    rows, _ = random_rows(gaps=0.0)
    columns = rows.rows.reshape(-1, SHAPES + 2)
    for shape, error in enumerate(weight_errors(rows, 0.3)):
        part = columns[:, [shape, *range(SHAPES, SHAPES + 2)]]
        assert error == pytest.approx(0.3 * np.sqrt(np.linalg.inv(part.T @ part)[0, 0]))


def test_unseen_is_what_no_marker_feels_or_the_helmet_can_do():
    rng = np.random.default_rng(2)
    deltas, helmet = rng.normal(size=(3, MARKERS, 3)), rng.normal(size=(2, MARKERS, 3))
    deltas[0], deltas[1] = 0.0, helmet[0] - 2 * helmet[1]
    moved = np.zeros((10, MARKERS, 3))
    moved[:, :] = rng.normal(size=moved.shape)
    bounds = np.tile([0.0, 1.0], (3, 1))
    errors = weight_errors(marker_rows(deltas, helmet, moved, bounds, -1.0), 0.1)
    assert np.isinf(errors[:2]).all() and errors[2] < 0.1
    moved[::2] = np.nan  # seen half the time, known as from half the frames
    assert weight_errors(marker_rows(deltas, helmet, moved, bounds, -1.0), 0.1)[2] == pytest.approx(
        errors[2] * np.sqrt(2)
    )


# The papers' solve


@pytest.mark.parametrize(("beta", "gamma"), [(0.0, 0.001), (0.8, 0.05), (3.0, 0.4)])
def test_equation_3_against_scipy(beta, gamma):
    rows, _ = random_rows(helmet_lower=0.0)
    unknowns, energies, certificate = solve_paper(rows, beta, gamma)
    expected = least_squares(rows, gamma * np.eye(SHAPES + 2), beta / 2)
    assert np.abs(unknowns - expected).max() < 1e-7
    assert certificate.max_kkt < 1e-9
    assert ((unknowns == 0) | (unknowns == 1)).any() and ((unknowns > 0) & (unknowns < 1)).any()
    assert np.allclose(energies["sparsity"], beta * np.abs(unknowns).sum(1))
    assert np.allclose(energies["ridge"], gamma * (unknowns**2).sum(1))


def test_signed_helmet_unknowns_are_not_charged_for_a_sign():
    rows, _ = random_rows()
    unknowns, energies, _ = solve_paper(rows, 2.0, 0.01)
    expected = least_squares(rows, 0.01 * np.eye(SHAPES + 2), np.r_[np.ones(SHAPES), 0, 0])
    assert np.abs(unknowns - expected).max() < 1e-7
    assert np.allclose(energies["sparsity"], 2.0 * unknowns[:, :SHAPES].sum(1))


def test_coupled_equation_3_against_scipy():
    rows, _ = random_rows(helmet_lower=0.0)
    unknowns, energies, certificate = solve_paper(rows, 0.5, 0.02, coupling=1.7)
    expected = least_squares(rows, 0.02 * np.eye(SHAPES + 2), 0.25, coupling=1.7)
    assert np.abs(unknowns - expected).max() < 1e-7 and certificate.max_kkt < 1e-9
    assert energies["smoothness"].sum() == pytest.approx(1.7 * (np.diff(unknowns, axis=0) ** 2).sum())


def test_no_coupling_is_every_frame_on_its_own():
    rows, _ = random_rows()
    alone, _, _ = solve_paper(rows, 0.3, 0.01)
    linear = rows.linear + np.r_[np.full(SHAPES, 0.15), 0, 0]
    by_hand, _ = solve_box(
        rows.gram + 0.01 * np.eye(SHAPES + 2), linear, lower=rows.lower, rows=rows.rows, missing=rows.missing
    )
    assert np.array_equal(alone, by_hand)
    assert np.abs(solve_paper(rows, 0.3, 0.01, coupling=1e-9)[0] - alone).max() < 1e-7


# The prior


def test_the_first_prior_ties_partners():
    prior = symmetric_prior(MIRROR, 0.9, rate=60)
    deviation = np.sqrt(np.diag(prior.covariance))
    correlation = prior.covariance / np.outer(deviation, deviation)
    expected = np.eye(5)
    expected[[0, 1, 2, 3], [1, 0, 3, 2]] = 0.9
    assert np.allclose(correlation, expected) and np.allclose(deviation, deviation[0])
    assert np.allclose(symmetric_prior(MIRROR, 0.9, rate=30).steps, 2 * prior.steps)  # a random walk


def dense_chain(gram, precision, steps, noise, length):
    """What the Gaussian posterior of a long chain has in its middle: covariance of unknowns, variance of steps."""
    count, size = len(steps), len(gram)
    full = np.kron(np.eye(length), gram + precision)
    bend = 2 * np.eye(length) - np.eye(length, k=1) - np.eye(length, k=-1)
    bend[0, 0] = bend[-1, -1] = 1
    full += np.kron(bend, np.diag(np.r_[noise**2 / steps, np.zeros(size - count)]))
    inverse = np.linalg.inv(full)
    at, after = (slice(k * size, (k + 1) * size) for k in (length // 2, length // 2 + 1))
    pose, cross = noise**2 * inverse[at, at], noise**2 * inverse[at, after]
    return pose, (2 * np.diag(pose) - 2 * np.diag(cross))[:count]


def test_what_the_markers_leave_open_is_the_chains_posterior():
    rows, _ = random_rows(gaps=0.0)
    noise, start = 0.3, symmetric_prior(MIRROR, 0.8, rate=60)
    current = TakePrior(0.1 * np.eye(SHAPES) + 0.02, np.full(SHAPES, 0.03))
    precision = 0.01 * np.eye(SHAPES + 2)
    precision[:SHAPES, :SHAPES] += noise**2 * np.linalg.inv(current.covariance)
    weights = np.random.default_rng(5).uniform(0.1, 0.9, (40, SHAPES))
    learned, covariance = relearned_prior(start, weights, rows.gram, current, precision, noise, 60)
    pose, step = dense_chain(rows.gram, precision, current.steps, noise, 120)
    assert np.allclose(covariance, pose, rtol=1e-4, atol=1e-7)
    moment = weights.T @ weights / 40 + pose[:SHAPES, :SHAPES]
    expected = (40 * moment + PSEUDO_FRAMES * start.covariance) / (40 + PSEUDO_FRAMES)
    assert np.allclose(learned.covariance, expected + DEVIATION_FLOOR**2 * np.eye(SHAPES), rtol=1e-4)
    steps = (np.diff(weights, axis=0) ** 2).mean(0) + step + STEP_FLOOR**2
    assert np.allclose(learned.steps, steps, rtol=1e-4)


def test_a_weight_at_rest_leaves_nothing_open():
    rows, _ = random_rows(gaps=0.0)
    start = symmetric_prior(MIRROR, 0.0, rate=60)
    weights = np.full((50, SHAPES), 0.5)
    weights[:, 2] = 0.0
    precision = 0.01 * np.eye(SHAPES + 2)
    learned, _ = relearned_prior(start, weights, rows.gram, start, precision, 0.3, 60)
    alone = (PSEUDO_FRAMES * start.covariance[2, 2]) / (50 + PSEUDO_FRAMES) + DEVIATION_FLOOR**2
    assert learned.covariance[2, 2] == pytest.approx(alone)
    assert learned.steps[2] == pytest.approx(STEP_FLOOR**2)


def test_a_held_shape_hardly_moves():
    prior = symmetric_prior(MIRROR, 0.9, rate=60)
    held = prior.holding(np.array([0, 0, 1, 0, 0], bool))
    assert held.covariance[2, 2] < 1e-3 * prior.covariance[2, 2]
    others = np.array([0, 1, 3, 4])
    assert np.array_equal(held.covariance[np.ix_(others, others)], prior.covariance[np.ix_(others, others)])
    np.linalg.cholesky(held.covariance)


def test_a_quick_shape_may_go_farther_than_it_does_on_average():
    prior = symmetric_prior(MIRROR, 0.9, rate=60)
    quick = np.array([1, 1, 0, 0, 0], bool)
    reaching = prior.reaching(quick)
    deviation, wider = (np.sqrt(np.diag(p.covariance)) for p in (prior, reaching))
    assert np.allclose(wider, np.where(quick, REACH, deviation)) and deviation.max() < REACH
    assert np.allclose(reaching.covariance / np.outer(wider, wider), prior.covariance / np.outer(deviation, deviation))
    assert np.array_equal(reaching.steps, prior.steps)
    assert np.array_equal(replace(prior, covariance=np.eye(SHAPES)).reaching(quick).covariance, np.eye(SHAPES))


def test_of_two_that_exclude_each_other_the_smaller_rests():
    weights = np.tile([0.5, 0.2, 0.0, 0.0, 0.9], (20, 1))
    weights[10:, :2] = [0.1, 0.3]
    opposite = np.array([1, 0, 3, 2, 4])
    smaller = resting(weights, opposite)
    assert not smaller[:, 2:].any()  # none of two at rest, and not what nothing excludes
    assert smaller[:8, 1].all() and smaller[12:, 0].all() and not (smaller[:, 0] & smaller[:, 1]).any()
    flicker = weights.copy()
    flicker[3, :2] = [0.2, 0.25]
    assert np.array_equal(resting(flicker, opposite), smaller)  # a frame of noise decides nothing


def test_an_event_is_charged_less_than_rest():
    weights = np.zeros((30, SHAPES))
    weights[15:, 0] = 0.8
    prior = symmetric_prior(MIRROR, 0.9, rate=60)
    factors = step_weights(weights, prior, MIRROR)
    assert factors[15, 0] < 0.01 and np.allclose(factors[20:, 0], factors[1, 0]) and factors[1, 0] > 1
    assert np.allclose(factors[14:17, 0], factors[15, 0])  # the steps beside it may belong to it
    assert np.array_equal(factors[:, 0], factors[:, 1])  # and its partner's
    assert np.allclose(factors[1:, 4], factors[1, 0])
    backwards = step_weights(weights[::-1], prior, MIRROR)
    assert np.allclose(backwards[1:], factors[1:][::-1])


# The learned solve


def test_one_pass_is_one_least_squares():
    """A quick shape is free in the first pass: what that would flatten no later pass could find again."""
    rows, _ = random_rows()
    quick = np.arange(SHAPES) == 4
    answer = solve_learned(rows, replace(KIN, quick=quick, symmetry=0.9), 30.0, 0.4, smoothness=0.7, passes=1)
    prior = symmetric_prior(MIRROR, 0.9, 30.0)
    quadratic = HELMET_RIDGE * np.eye(SHAPES + 2)
    quadratic[:SHAPES, :SHAPES] = 0.16 * np.linalg.inv(prior.covariance)
    steps = np.where(quick, 2 * FREE**2, prior.steps)
    coupling = 0.16 * np.r_[0.7 / steps, np.full(2, 1 / (2 * HELMET_STEP**2))]
    expected = least_squares(rows, quadratic, coupling=coupling)
    assert np.abs(answer.unknowns - expected).max() < 1e-6
    assert np.array_equal(answer.energies["markers"], np.nansum(rows.errors(answer.unknowns) ** 2, axis=1))
    total = sum(e.sum() for e in answer.energies.values())
    steps = np.diff(expected, axis=0) ** 2
    assert total == pytest.approx(
        np.nansum(rows.errors(expected) ** 2)
        + np.einsum("ti,ij,tj", expected, quadratic, expected)
        + (coupling * steps).sum()
    )


@pytest.mark.parametrize("seed", range(3))
def test_short_blinks_of_lids_that_the_markers_hardly_see_are_not_muted(seed):
    """Six blinks of a fifth of a second, of a lid that moves all markers together by 2 mm, at 0.2 mm of noise."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(SHAPES + 2, MARKERS, 3))
    columns[4] *= 2.0 / np.linalg.norm(columns[4])
    truth = np.zeros((240, SHAPES + 2))
    truth[:, 0] = 0.3 + 0.2 * np.sin(np.arange(240) / 17)
    for peak in range(20, 240, 40):
        truth[peak - 4 : peak + 5, 4] = 0.9 * np.sin(np.linspace(0, np.pi, 9)) ** 2
    moved = np.tensordot(truth, columns, 1) + rng.normal(scale=0.2, size=(240, MARKERS, 3))
    rows = marker_rows(columns[:SHAPES], columns[SHAPES:], moved, np.tile([0.0, 1.0], (SHAPES, 1)), -1.0)
    answer = solve_learned(rows, replace(KIN, quick=np.arange(SHAPES) == 4), 30.0, 0.2).unknowns[:, 4]
    true = truth[:, 4] - truth[:, 4].mean()
    assert 0.8 < true @ answer / (true @ true) < 1.05
    assert answer[truth[:, 4] == 0].mean() < 0.06


def test_energies_are_the_objective():
    """With all that may stand in it: `E(a) - E(b)` is the difference of what the solver is told to minimise."""
    rows, truth = random_rows()
    rng = np.random.default_rng(4)
    belief = _Belief(
        symmetric_prior(MIRROR, 0.9, 30.0), 0.4, rng.uniform(0.5, 2, (FRAMES, SHAPES)),
        np.pad(rng.normal(scale=0.1, size=(FRAMES - 1, SHAPES)), ((1, 0), (0, 0))), np.zeros(SHAPES, bool),
        np.arange(FRAMES)[:, None] < rng.integers(0, FRAMES, SHAPES),
        np.linspace(0.2, 1, MARKERS),
    )  # fmt: skip
    curves = Curves(*rng.random((2, FRAMES, SHAPES)))
    terms = _terms(rows, belief, 30.0, 0.7, curves, np.full(SHAPES, 0.2))
    diagonal, pull = terms.diagonal_and_pull()
    assert diagonal[:, :SHAPES][handed_over(belief.resting) > 0.5].min() > 100 and not diagonal[:, SHAPES:].any()

    def told(a):
        value = 2 * ((terms.rows.linear + pull + _pull_along(terms.coupling, terms.foretold)) * a).sum()
        for t in range(FRAMES):
            h = terms.rows.rows[~rows.missing[t]].reshape(-1, a.shape[1])
            value += a[t] @ (h.T @ h + terms.precision + np.diag(diagonal[t])) @ a[t]
        return value + (terms.coupling[1:] * np.diff(a, axis=0) ** 2).sum()

    one, other = truth, rng.random(truth.shape)
    apart = sum(e.sum() for e in terms.energies(one).values()) - sum(e.sum() for e in terms.energies(other).values())
    assert apart == pytest.approx(told(one) - told(other))


def test_a_hold_comes_and_goes_by_equal_factors():
    resting = np.zeros((60, 2), dtype=bool)
    resting[30:, 0] = True
    resting[:, 1] = True
    share = handed_over(resting)
    assert (share[:, 1] == 1).all() and (share[:20, 0] == 0).all() and (share[40:, 0] == 1).all()
    rising = share[(share[:, 0] > 0) & (share[:, 0] < 1), 0] + 1 / (HOLD**-2 - 1)
    assert len(rising) == HANDOVER_FRAMES - 1
    np.testing.assert_allclose(rising[1:] / rising[:-1], HOLD ** (-2 / HANDOVER_FRAMES), rtol=1e-9)


def test_two_that_exclude_each_other_are_not_on_together():
    """What the rig lacks looks like a bit of both, beside a motion that is now the one and now the other."""
    rng = np.random.default_rng(6)
    columns = rng.normal(size=(SHAPES, MARKERS, 3))
    columns[1] = -0.8 * columns[0] + 0.3 * columns[1]
    truth = np.zeros((200, SHAPES))
    truth[:, 0] = 0.6 * np.clip(np.sin(np.arange(200) / 15), 0, None)
    truth[:, 1] = 0.6 * np.clip(-np.sin(np.arange(200) / 15), 0, None)
    lacked = 0.2 * (columns[0] + columns[1])
    moved = np.tensordot(truth, columns, 1) + lacked + rng.normal(scale=0.2, size=(200, MARKERS, 3))
    rows = marker_rows(columns, np.empty((0, MARKERS, 3)), moved, np.tile([0.0, 1.0], (SHAPES, 1)), -1.0)
    kin = replace(KIN, opposite=np.array([1, 0, 2, 3, 4]))
    free, decided = (solve_learned(rows, k, 60.0, 0.2).unknowns for k in (KIN, kin))
    both = [np.minimum(w[:, 0], w[:, 1]) for w in (free, decided)]
    assert both[0].max() > 0.1 and both[1].max() < 0.05  # for some frames, while one hands over to the other
    assert both[1].mean() < 0.003
    assert np.abs(decided - truth)[:, :2].mean() < np.abs(free - truth)[:, :2].mean()


def long_rows(seed=3, noise=0.05, gaps=0.1):
    return random_rows(seed, frames=240, noise=noise, gaps=gaps)


def test_the_learned_solve_finds_the_truth_and_the_noise():
    rows, truth = long_rows(noise=0.15)
    answer = solve_learned(rows, replace(KIN, symmetry=0.0), 60.0, 0.01)
    assert answer.noise == pytest.approx(0.15, rel=0.1)  # nobody told it
    unlearned, _, _ = solve_paper(rows, 0.0, 1e-6)
    error, plain = (np.sqrt(((a - truth)[:, :SHAPES] ** 2).mean()) for a in (answer.unknowns, unlearned))
    assert error < 0.6 * plain and error < 0.02
    assert answer.certificate.max_kkt < 1e-9 and answer.certificate.converged


def test_a_stated_noise_is_the_least_that_is_assumed():
    rows, _ = long_rows(noise=0.02)
    assert solve_learned(rows, replace(KIN, symmetry=0.5), 60.0, 0.2).noise == 0.2


def test_time_has_no_direction_for_the_whole_take():
    rows, _ = long_rows()
    back = MarkerRows(rows.rows, rows.targets[::-1], rows.missing[::-1], SHAPES, rows.lower, rows.upper)
    forth, reverse = (solve_learned(r, KIN, 60.0, 0.05).unknowns for r in (rows, back))
    assert np.abs(reverse[::-1] - forth).max() < 1e-6


def test_smoothness_smooths():
    rows, _ = long_rows(noise=0.3)
    rough = [np.square(np.diff(solve_learned(rows, KIN, 60.0, 0.3, smoothness=s).unknowns[:, :SHAPES], 2, 0)).mean()
             for s in (0.0, 1.0, 10.0)]  # fmt: skip
    assert rough[0] > 3 * rough[1] > 3 * rough[2]


@pytest.mark.parametrize("seed", range(3))
def test_what_no_marker_sees_follows_its_partner_or_rests(seed):
    """Shape 1 moves no marker and its partner does; 2, 3 and 4 hardly do, and the rig lacks what looks like them."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(SHAPES + 2, MARKERS, 3))
    columns[1], columns[2:5] = 0.0, 0.02 * columns[2:5]
    wave = np.sin(np.linspace(0, 2 * np.pi, 120))[:, None, None]
    lacked = 20 * columns[2:5].sum(0)
    lacked -= columns[0] * (lacked * columns[0]).sum() / (columns[0] ** 2).sum()  # shape 0 has no part in it
    moved = wave**2 * (0.8 * columns[0] + lacked)
    rows = marker_rows(columns[:SHAPES], columns[SHAPES:], moved, np.tile([0.0, 1.0], (SHAPES, 1)), -1.0)
    weights = solve_learned(rows, KIN, 60.0, 0.05).unknowns[:, :SHAPES]
    assert np.abs(weights[:, 0] - 0.8 * wave[:, 0, 0] ** 2).max() < 0.3
    assert np.abs(weights[:, 1] - weights[:, 0]).max() < 0.12
    assert weights[:, 2:].max() < 0.002


def test_a_marker_that_goes_astray_does_not_drive_the_face():
    """Two labels are exchanged half way: the answer is nearly that of the others alone, and the two are blamed."""
    rows, truth = long_rows(noise=0.1, gaps=0.0)
    targets = rows.targets.copy()
    targets[120:, [2, 5]] += np.array([[9.0, -4.0, 3.0], [-9.0, 4.0, -3.0]])
    swapped = MarkerRows(rows.rows, targets, rows.missing, SHAPES, rows.lower, rows.upper)
    answer = solve_learned(swapped, KIN, 60.0, 0.1)
    assert answer.trusted[[2, 5]].max() < 0.2 and np.delete(answer.trusted, [2, 5]).min() > 0.5
    gone = rows.missing | np.isin(np.arange(MARKERS), [2, 5])
    without = MarkerRows(rows.rows, np.where(gone[..., None], 0, targets), gone, SHAPES, rows.lower, rows.upper)
    errors = [np.sqrt(((solve_learned(r, KIN, 60.0, 0.1).unknowns - truth)[:, :SHAPES] ** 2).mean())
              for r in (swapped, without, rows)]  # fmt: skip
    assert errors[0] < 1.5 * errors[1] and errors[2] < errors[1]
    assert solve_learned(rows, KIN, 60.0, 0.1).trusted.min() == 1.0


def test_foretold_steps_are_a_linear_term():
    coupling = np.random.default_rng(1).uniform(1, 4, (9, SHAPES + 2))
    foretold = np.zeros((9, SHAPES))
    foretold[1:] = np.random.default_rng(2).normal(scale=0.1, size=(8, SHAPES))
    a = np.random.default_rng(3).uniform(size=(9, SHAPES + 2))
    steps = np.diff(a, axis=0)
    steps[:, :SHAPES] -= foretold[1:]
    plain, shifted = ((coupling[1:] * s**2).sum() for s in (np.diff(a, axis=0), steps))
    constant = (coupling[1:, :SHAPES] * foretold[1:] ** 2).sum()
    assert shifted == pytest.approx(plain + 2 * (_pull_along(coupling, foretold) * a).sum() + constant)


def test_what_is_on_its_way_goes_on():
    ramp = np.tile(np.arange(20.0)[:, None] * 0.05, (1, SHAPES))
    foretold = trend(ramp)
    assert np.allclose(foretold[4:-3], 0.05) and not foretold[0].any()
    lone = np.zeros((20, 1))
    lone[10:] = 0.8
    assert np.allclose(trend(lone)[10], 0.8 * 6 / 16)  # a lone step is foretold but in part


def test_a_blink_of_wide_eyes_is_not_held_at_rest():
    """Lids are up by 0.8 and blink on top of it: of the two opposites the blink is the smaller in every frame."""
    rng = np.random.default_rng(7)
    columns = rng.normal(size=(SHAPES + 2, MARKERS, 3))
    columns[3] = -0.6 * columns[4]
    columns[3:5] *= 2.5 / np.linalg.norm(columns[4])
    truth = np.zeros((200, SHAPES + 2))
    truth[:, 3] = 0.8
    truth[95:107, 4] = 0.7 * np.sin(np.linspace(0, np.pi, 12)) ** 2
    moved = np.tensordot(truth, columns, 1) + rng.normal(scale=0.2, size=(200, MARKERS, 3))
    rows = marker_rows(columns[:SHAPES], columns[SHAPES:], moved, np.tile([0.0, 1.0], (SHAPES, 1)), -1.0)
    kin = Kinship.of_pairs(np.arange(SHAPES))
    kin = replace(kin, opposite=np.array([0, 1, 2, 4, 3]), quick=np.arange(SHAPES) == 4)
    answer = solve_learned(rows, kin, 60.0, 0.2).unknowns
    assert answer[99:103, 4].max() > 0.4 and answer[:85, 4].max() < 0.1


def test_targets_are_relinearized_before_the_last_pass():
    rows, _ = long_rows()
    seen = []

    def shifted(unknowns):
        seen.append(unknowns)
        return rows.targets + 0.01

    answer = solve_learned(rows, KIN, 60.0, 0.05, relinearize=shifted)
    assert len(seen) == 1 and not np.array_equal(seen[0], answer.unknowns)
    assert np.allclose(answer.rows.targets[~rows.missing], rows.targets[~rows.missing] + 0.01)


# Live


def test_the_first_live_frame_is_the_prior_and_the_markers():
    rows, _ = random_rows()
    solver = LiveSolver(rows, MIRROR, 60.0, 0.3, symmetry=0.8)
    first = np.where(rows.missing[0, :, None], np.nan, rows.targets[0])
    answer, certificate = solver.step(first)
    quadratic = 1e-4 * np.eye(SHAPES + 2)
    quadratic[:SHAPES, :SHAPES] += 0.09 * np.linalg.inv(symmetric_prior(MIRROR, 0.8, 60.0).covariance)
    one = MarkerRows(rows.rows, rows.targets[:1], rows.missing[:1], SHAPES, rows.lower, rows.upper)
    assert np.abs(answer - least_squares(one, quadratic)[0]).max() < 1e-7
    assert certificate.max_kkt < 1e-9


def test_live_follows_and_uses_the_past_only():
    rows, truth = long_rows(noise=0.15)
    unknowns, energies, certificate = solve_live(rows, MIRROR, 60.0, 0.15, symmetry=0.0)
    plain, _, _ = solve_paper(rows, 0.0, 1e-6)
    error, unlearned = (np.sqrt(((a - truth)[:, :SHAPES] ** 2).mean()) for a in (unknowns, plain))
    assert error < 0.9 * unlearned
    assert certificate.max_kkt < 1e-9 and len(certificate.residuals) == 240
    assert np.allclose(energies["markers"], np.nansum(rows.errors(unknowns) ** 2, axis=1))
    cut = 2 * REFRESH + 7
    other = rows.with_targets(np.where(np.arange(240)[:, None, None] < cut, rows.targets, -rows.targets))
    changed, _, _ = solve_live(other, MIRROR, 60.0, 0.15, symmetry=0.0)
    assert np.array_equal(changed[:cut], unknowns[:cut]) and not np.allclose(changed[cut:], unknowns[cut:])


def test_half_a_marker_is_a_missing_marker():
    """A coordinate alone is not believed: the answer is that of the frames without the marker."""
    rows, _ = long_rows(gaps=0.0)
    half, gone = rows.targets[:5].copy(), rows.targets[:5].copy()
    half[2:, 3, 1], gone[2:, 3] = np.nan, np.nan
    answers = []
    for targets in (half, gone, rows.targets[:5]):
        solver = LiveSolver(rows, MIRROR, 60.0, 0.1)
        answers.append(np.array([solver.step(frame)[0] for frame in targets]))
    assert np.isfinite(answers[0]).all() and np.array_equal(answers[0], answers[1])
    assert np.abs(answers[0] - answers[2])[2:].max() > 1e-4


def test_live_eases_to_rest_when_it_sees_nothing():
    rows, _ = long_rows()
    solver = LiveSolver(rows, MIRROR, 60.0, 0.1)
    for frame in rows.targets[:40]:
        before, _ = solver.step(frame)
    blind = np.array([solver.step(np.full((MARKERS, 3), np.nan))[0] for _ in range(60)])
    assert np.isfinite(blind).all()
    assert np.abs(blind[0] - before).max() < 0.2  # it does not drop the pose at once
    sizes = np.linalg.norm(np.vstack([before, blind])[:, :SHAPES], axis=1)
    assert (np.diff(sizes) <= 1e-9).all()


# Settings


@pytest.mark.parametrize(
    "wrong",
    [{"method": "magic"}, {"helmet": "hat"}, {"head": "off"}, {"beta": -1.0}, {"gamma": np.nan}, {"coupling": np.inf},
     {"longest_gap": -0.1}, {"noise": 0.0}, {"noise": np.nan}, {"symmetry": 1.0}, {"passes": 0}, {"passes": 1.5},
     {"passes": True}, {"passes": 10**9}, {"beta": "a"}, {"noise": "quiet"}, {"coupling": 1e7},
     {"stable": "abc"}, {"stable": None},     {"smoothness": 1e9}, {"noise": 1e308}, {"model_error": 1e160}],
)  # fmt: skip
def test_settings_refuse_what_makes_no_sense(wrong):
    with pytest.raises(InputError, match=str(next(iter(wrong)))):
        SolveSettings(**wrong)


@pytest.mark.parametrize(
    ("method", "setting"),
    [("paper", "smoothness"), ("paper", "symmetry"), ("live", "passes"), ("learned", "beta"), ("live", "influence")],
)
def test_a_setting_of_another_method_is_refused(method, setting):
    with pytest.raises(InputError, match=f"setting {setting} belongs to the method [a-z ]+, not to {method}"):
        SolveSettings(method=method, **{setting: 0.9 if setting != "passes" else 2})
