"""Curves beside markers (Eq. 4): closed forms, invariances, and lids that no marker sees."""

from dataclasses import replace

import numpy as np
import pytest

import blendcap
from blendcap import Animation, InputError, SolveSettings
from blendcap.solving.curves import Curves, curves_for
from blendcap.solving.learned import solve_learned
from blendcap.solving.live import solve_live
from blendcap.solving.paper import solve_paper
from blendcap.solving.rows import marker_rows
from blendcap.solving.visibility import Kinship
from stage import SHAPES, scene, talk

METHODS = ("learned", "paper", "live")
LIDS = ("eyeBlinkLeft", "eyeBlinkRight")


@pytest.fixture(scope="module")
def rows():
    """One marker moved by two shapes at right angles: each weight can be had by hand."""
    deltas = np.array([[[3.0, 0, 0]], [[0, 2.0, 0]]])
    moved = np.array([[[1.5, 0.8, 0]], [[0.3, 1.0, 0]], [[np.nan] * 3]])
    return marker_rows(deltas, np.empty((0, 1, 3)), moved, np.array([[0, 1.0], [0, 1.0]]), -1.0)


def test_a_curve_pulls_as_the_equation_says(rows):
    curves = Curves(np.array([[0.2, 0.0], [0.9, 0.4], [0.7, 0.1]]), np.array([[1.0, 0.0], [0.5, 1.0], [1.0, 0.25]]))
    answer, energies, certificate = solve_paper(rows, beta=0.0, gamma=1e-9, curves=curves, influence=4.0)
    push, stiff = np.array([[4.5, 1.6], [0.9, 2.0], [0, 0]]), np.array([[9.0, 4.0], [9.0, 4.0], [0, 0]])
    gamma = 4.0 * curves.confidence
    expected = (push + gamma * curves.targets) / (stiff + gamma)
    np.testing.assert_allclose(answer, expected, atol=1e-8)
    np.testing.assert_allclose(energies["curves"], (gamma * (expected - curves.targets) ** 2).sum(1), atol=1e-8)
    assert certificate.max_kkt < 1e-12
    np.testing.assert_allclose(
        curves.conflict(answer), curves.confidence * np.abs(expected - curves.targets), atol=1e-8
    )


def test_a_curve_that_is_not_trusted_changes_nothing(rows):
    silent = Curves(np.full((3, 2), 0.8), np.zeros((3, 2)))
    mirror = np.arange(2)
    for alone, beside in (
        (solve_paper(rows, 0.1, 0.01), solve_paper(rows, 0.1, 0.01, curves=silent)),
        (solve_live(rows, mirror, 60, 0.2), solve_live(rows, mirror, 60, 0.2, curves=silent)),
    ):
        np.testing.assert_array_equal(alone[0], beside[0])
    alone, beside = (solve_learned(rows, Kinship.of_pairs(mirror), 60, 0.2, curves=given) for given in (None, silent))
    np.testing.assert_allclose(alone.unknowns, beside.unknowns, atol=1e-12)


def test_curves_are_sampled_at_the_frames_of_the_take():
    times = np.arange(120) / 60
    seen = np.arange(48) / 24
    curves = Animation(np.stack([seen / 2, 1 - seen / 2], 1), ("eyeBlink_L", "jawOpen"), 24.0)
    found = curves_for(("jawOpen", "eyeBlinkLeft", "browInnerUp"), curves, times)
    inside = times <= seen[-1]
    np.testing.assert_allclose(found.targets[inside, 1], times[inside] / 2, atol=1e-12)
    np.testing.assert_allclose(found.targets[inside, 0], 1 - times[inside] / 2, atol=1e-12)
    assert not found.confidence[:, 2].any() and (found.confidence[:, :2] == 1).all()
    late = curves_for(("eyeBlinkLeft",), curves.select(("eyeBlink_L",)), times, offset=0.5)
    assert not late.confidence[times < 0.45].any()
    np.testing.assert_allclose(late.targets[60, 0], 0.25, atol=1e-12)


def test_a_gap_in_a_curve_says_nothing():
    weights = np.full((10, 1), 0.7)
    weights[4:6] = np.nan
    found = curves_for(("jawOpen",), Animation(weights, ("jawOpen",), 30.0), np.arange(10) / 30)
    np.testing.assert_array_equal(found.confidence[:, 0], [1, 1, 1, 1, 0, 0, 1, 1, 1, 1])
    np.testing.assert_allclose(found.targets[[0, 3, 6, 9], 0], 0.7)


@pytest.mark.parametrize(
    ("names", "frames", "offset", "sentence"),
    [
        (("noseWiggle",), 30, None, r"The curve 'noseWiggle' has no shape on the rig 'nobody'; map it"),
        (("jawOpen",), 45, None, r"The curves last 1\.50 s and the take 1\.00 s; say by the offset"),
        (("jawOpen",), 45, 2.0, r"With an offset of 2 s the curves and the take do not overlap"),
    ],
)
def test_curves_that_do_not_fit_are_refused(names, frames, offset, sentence):
    curves = Animation(np.full((frames, 1), 0.5), names, 30.0)
    with pytest.raises(InputError, match=sentence):
        curves_for(("jawOpen",), curves, np.arange(30) / 30, offset, "nobody")


def test_settings_of_curves_are_checked():
    with pytest.raises(InputError, match="curve error must be at least"):
        SolveSettings(curve_error=0.0)
    with pytest.raises(InputError, match="influence must be a number that is not negative"):
        SolveSettings(influence=-1.0)


def test_a_curve_is_put_on_the_scale_of_the_markers_that_see_its_shape():
    rng, frames = np.random.default_rng(0), 600
    truth = np.stack([0.5 + 0.4 * np.sin(np.arange(frames) / period) for period in (9.0, 14.0, 20.0)], axis=1)
    lasting = np.zeros((frames, 3))
    for t in range(1, frames):
        lasting[t] = 0.8 * lasting[t - 1] + rng.normal(scale=0.012, size=3)
    said = Curves(0.4 * truth + 0.05 + lasting * 0.4, np.ones((frames, 3)))
    markers = truth + rng.normal(scale=0.05, size=truth.shape)
    seen = np.array([True, True, False])
    mended, errors = said.calibrated(markers, np.full(3, 0.05**2), seen, ~seen, least=0.01)
    np.testing.assert_array_equal(mended.targets[:, 2], said.targets[:, 2])
    assert errors[2] == 0.01
    for n in (0, 1):
        left = (mended.targets - truth)[:, n].std()
        assert left < 1.2 * lasting[:, n].std()  # the gain of 0.4 and the offset are gone
        assert left < errors[n] < 4 * left  # an error that lasts for some frames counts as often
        assert np.abs((said.targets - truth)[:, n]).mean() > 5 * left


def test_a_curve_that_hardly_moves_keeps_its_gain_and_a_silent_one_all():
    still = np.full((100, 1), 0.3) + 1e-4 * np.sin(np.arange(100.0))[:, None]
    markers = np.random.default_rng(1).normal(0.32, 0.05, (100, 1))
    known = Curves(still, np.ones((100, 1)))
    mended, _ = known.calibrated(markers, np.array([0.05**2]), np.array([True]), np.array([False]), least=0.1)
    gain = np.polyfit(still[:, 0], mended.targets[:, 0], 1)[0]
    assert gain == pytest.approx(1, abs=0.3) and mended.targets.mean() == pytest.approx(0.32, abs=0.02)
    silent = Curves(still, np.zeros((100, 1)))
    same, errors = silent.calibrated(markers, np.array([0.05**2]), np.array([True]), np.array([False]), least=0.1)
    np.testing.assert_array_equal(same.targets, still)
    assert errors[0] == 0.1


def test_the_curve_of_a_lid_keeps_its_word_where_the_lid_hides_the_paint():
    """It tells too much of a lid half shut, and the answer too little of one that is shut."""
    truth = 0.5 - 0.5 * np.cos(np.arange(600.0) / 11)[:, None]
    said = Curves(truth + 0.8 * truth * (1 - truth), np.ones_like(truth))
    answer = np.where(truth > 0.75, 0.4, truth)
    seen = np.array([True])
    mended, errors = said.calibrated(answer, np.array([1e-4]), seen, seen, least=0.1)
    shut, half = truth > 0.9, (truth > 0.2) & (truth < 0.6)
    assert errors[0] == 0.1 and mended.confidence[shut].min() > 0.9
    assert np.abs(mended.targets - truth)[shut].max() < 0.06
    assert 3 * np.abs(mended.targets - truth)[half].mean() < np.abs(said.targets - truth)[half].mean()
    line, _ = said.calibrated(answer, np.array([1e-4]), seen, ~seen, least=0.1)
    assert np.abs(line.targets - truth)[shut].min() > 0.2
    wild = said.calibrated(1 - answer, np.array([1e-4]), seen, seen, least=0.1)[0]
    assert wild.confidence[half].max() < 0.4  # at odds where both should know
    assert wild.confidence[shut].min() > 0.9


@pytest.fixture(scope="module")
def lids():
    """Speech on a rig whose lids carry no marker: only curves can tell a blink."""
    whole = scene(talk(), strength=1.0, seed=1, noise=0.2, slip=(2.0, 2.0), occlusion=0.05)
    _, deltas = whole.rig.sample(whole.binding.points)
    moved = np.linalg.norm(deltas[[SHAPES.index(lid) for lid in LIDS]], axis=2).max(0)
    keep = [name for name, far in zip(whole.binding.points.names, moved, strict=True) if far < 1.0]
    take = whole.take.select(keep)
    binding = blendcap.bind(whole.rig, take, whole.truth.points.select(keep), method="given")
    return replace(whole, take=take, binding=binding)


@pytest.mark.parametrize("method", METHODS)
def test_curves_close_the_lids_that_no_marker_sees(lids, method):
    truth = lids.truth.animation
    said = truth.select(LIDS)
    wobble = np.random.default_rng(0).normal(scale=0.05, size=said.weights.shape)
    patches = Animation(np.clip(said.weights + wobble, 0, 1), LIDS, said.rate, confidence=np.ones_like(said.weights))
    settings = SolveSettings(method=method)
    alone = blendcap.solve(lids.rig, lids.take, lids.binding, settings=settings)
    both = blendcap.solve(lids.rig, lids.take, lids.binding, patches=patches, settings=settings)
    columns = [SHAPES.index(lid) for lid in LIDS]

    def error(solution, which):
        return float(np.sqrt(((solution.animation.weights - truth.weights)[:, which] ** 2).mean()))

    others = [i for i in range(len(SHAPES)) if i not in columns]
    assert error(both, columns) < 0.4 * error(alone, columns) and error(both, columns) < 0.06
    assert error(both, others) < 1.05 * error(alone, others)
    assert both.certificate.max_kkt < 1e-9 and both.certificate.converged
    assert both.conflict is not None and both.conflict[:, others].max() == 0
    assert "curves" in both.energies and alone.conflict is None
    assert not set(LIDS) & set(both.unseen)


def test_a_curve_that_does_not_count_tells_nothing(lids):
    settings = {n: SolveSettings(method="paper", influence=n) for n in (0.0, 4.0)}
    patches = Animation(np.zeros((len(lids.take.positions), 2)), LIDS, lids.take.rate)
    without, told = (
        blendcap.solve(lids.rig, lids.take, lids.binding, patches=patches, settings=s) for s in settings.values()
    )
    alone = blendcap.solve(lids.rig, lids.take, lids.binding, settings=settings[0.0])
    assert without.unseen == alone.unseen and set(LIDS) & set(alone.unseen)
    assert not set(LIDS) & set(told.unseen)


def test_a_wrong_curve_shows_as_conflict(lids):
    truth = lids.truth.animation
    jaw = truth.select(("jawOpen",))
    wrong = Animation(np.where(jaw.weights > 0.3, 0.0, 1.0), jaw.names, jaw.rate)
    solution = blendcap.solve(lids.rig, lids.take, lids.binding, patches=wrong)
    assert np.median(solution.conflict[:, SHAPES.index("jawOpen")]) > 0.3


def test_the_edge_of_a_gap_pulls_toward_nothing():
    weights = np.ones((10, 1))
    weights[4:6] = np.nan
    curves = Animation(weights, ("a",), 30.0)
    there = curves_for(("a",), curves, np.arange(19) / 60)
    said = there.confidence[:, 0] > 0
    np.testing.assert_allclose(there.targets[said, 0], 1)
    assert not there.confidence[8:11, 0].any() and 0 < there.confidence[7, 0] < 1


@pytest.mark.parametrize(("most", "said"), [(1.0, False), (1.4, False), (100.0, True)])
def test_curves_in_percent_are_said(caplog, most, said):
    curves = Animation(np.array([[0.0], [most], [np.nan]]), ("jawOpen",), 30.0)
    assert curves_for(("jawOpen",), curves, np.arange(3) / 30).targets.max() == 1
    assert ("if they are in percent" in caplog.text) == said
