"""A rig refined by a take: nearer to the performer, unchanged by its own motion, contact kept, bad input refused."""

from dataclasses import replace

import numpy as np
import pytest

import blendcap
from blendcap import InputError, PaintTracks, SolveSettings
from blendcap.markers import personal
from blendcap.markers.personal import TakeRefinement
from blendcap.modeling.contacts import gaps
from blendcap.synthetic.takes import choose_points
from stage import RATE, Scene, motion, scene, talk
from test_tracks import seen_from

KEEP = SolveSettings(head="keep")
EYES = np.array([[60.0, 40.0, 400.0], [-60.0, -40.0, 400.0]])


def tracked(whole: Scene) -> PaintTracks:
    """Two cameras, each of which follows the same hundred points."""
    points = choose_points(whole.rig, 100, seed=3)
    one, two = (seen_from(whole, eye, points) for eye in EYES)
    names = tuple(f"q{k}" for k in range(len(two.rest)))
    both = replace(one.points, names=(*one.points.names, *names),
                   faces=np.tile(one.points.faces, 2), barycentric=np.tile(one.points.barycentric, (2, 1)))  # fmt: skip
    parts = {k: np.concatenate([getattr(one, k), getattr(two, k)]) for k in ("rest", "axes")}
    cameras, positions = np.repeat([0, 1], len(one.rest)), np.concatenate([one.positions, two.positions], axis=1)
    return replace(one, points=both, cameras=cameras, positions=positions, **parts)


def refined(whole: Scene, tracks: PaintTracks | None = None, **choices) -> TakeRefinement:
    return blendcap.refine_from_take(whole.rig, whole.take, whole.binding, tracks=tracks, settings=KEEP, **choices)


def skin_error(whole: Scene, rig: blendcap.Rig, weights: np.ndarray) -> float:
    """Root mean square distance of the moving face from the performer's, mm."""
    face = whole.rig.moving_vertices()
    true = whole.truth.performer.pose(whole.truth.animation.weights)[:, face]
    return float(np.sqrt(((rig.pose(weights)[:, face] - true) ** 2).sum(2).mean()))


@pytest.fixture(scope="module")
def someone() -> Scene:
    return scene(motion(), strength=1.0, noise=0.1)


@pytest.fixture(scope="module")
def answer(someone) -> TakeRefinement:
    return refined(someone, tracked(someone))


def test_the_refined_rig_meets_the_performer_better(someone, answer):
    plain = blendcap.solve(someone.rig, someone.take, someone.binding, tracks=tracked(someone), settings=KEEP).animation
    before = skin_error(someone, someone.rig, plain.weights)
    after = skin_error(someone, answer.rig, answer.solution.animation.weights)
    assert after < 0.8 * before
    assert answer.rms[-1] < 0.9 * answer.rms[0] and answer.foretold > 0.15 and answer.residual < 1e-3
    assert answer.solution.certificate.converged


def test_what_it_learned_from_a_range_of_motion_holds_in_speech(someone, answer):
    speech = scene(talk(RATE), strength=1.0, noise=0.1, seed=5)
    errors = []
    for rig in (someone.rig, answer.rig):
        solved = blendcap.solve(rig, speech.take, speech.binding, tracks=tracked(speech), settings=KEEP)
        errors.append(skin_error(speech, rig, solved.animation.weights))
    assert errors[1] < 0.9 * errors[0]


def test_the_rig_itself_is_left_nearly_as_it_is():
    whole = scene(motion(), strength=0.0)
    found = refined(whole, tracked(whole))
    moved = np.linalg.norm(whole.rig.deltas, axis=2).max(1)
    assert (found.change.max(1) < 0.05 * moved + 0.05).all()


def test_names_stay_still_skin_stays_and_shut_lids_shut(someone, answer):
    rig, new = someone.rig, answer.rig
    assert new.names == rig.names and np.array_equal(new.bounds, rig.bounds)
    np.testing.assert_array_equal(new.mesh.vertices, rig.mesh.vertices)
    still = np.setdiff1d(np.arange(len(rig.mesh.vertices)), rig.moving_vertices(0.0))
    assert not answer.change[:, still].any()
    for side in ("left", "right"):
        pairs, row = rig.contacts[f"lids_{side}"], rig.index(f"eyeBlink{side.title()}")
        old, now = (gaps(part.mesh.vertices + part.deltas[row], pairs) for part in (rig, new))
        assert now.max() < old.max() + 0.1


def test_sliders_to_a_hundred_are_like_shares(someone, answer):
    rig = someone.rig
    percent = replace(rig, deltas=rig.deltas / 100, bounds=100 * rig.bounds)
    found = refined(replace(someone, rig=percent), tracked(someone))
    np.testing.assert_allclose(100 * found.rig.deltas, answer.rig.deltas, atol=0.02)
    np.testing.assert_allclose(found.change, answer.change, atol=0.02)


def test_the_same_take_gives_the_same_rig(someone, answer):
    np.testing.assert_array_equal(refined(someone, tracked(someone)).rig.deltas, answer.rig.deltas)


def test_markers_that_only_tremble_teach_nothing(caplog):
    whole = scene(motion(), noise=0.3)
    rest = np.tile(whole.take.positions[:1], (len(whole.take.positions), 1, 1))
    trembling = rest + np.random.default_rng(1).normal(scale=0.3, size=rest.shape)
    found = refined(replace(whole, take=replace(whole.take, positions=trembling)))
    assert not found.change.any() and len(found.rms) == 1
    assert "they stay as they were" in caplog.text


def test_shapes_that_are_another_face_s_are_named(someone, caplog):
    refined(someone, tracked(someone), rounds=1)
    assert "Do not use this rig unseen" not in caplog.text and "are needed" not in caplog.text
    rig = someone.rig
    change = np.zeros_like(rig.deltas)
    change[rig.index("jawOpen")] = 0.6 * rig.deltas[rig.index("jawOpen")]
    change[rig.index("mouthPucker")] = 0.4 * rig.deltas[rig.index("mouthPucker")]
    personal._warn(rig, change)
    assert "differ by: jawOpen. " in caplog.text


def test_a_warning_comes_once(someone, caplog):
    """And not with each of the solves."""
    tracks = tracked(someone)
    late = replace(tracks, positions=np.concatenate([tracks.positions[:1], tracks.positions[:-1]]))
    refined(someone, late)
    assert caplog.text.count("The film seems to begin") == 1


def test_what_cannot_be_is_refused(someone):
    short = replace(someone, take=replace(someone.take, positions=someone.take.positions[:100]))
    with pytest.raises(InputError, match=r"lasts 4\.2 s; to refine a rig takes 8 s"):
        refined(short)
    with pytest.raises(InputError, match="at least one round"):
        refined(someone, rounds=0)
    live = SolveSettings(method="live")
    with pytest.raises(InputError, match="live solve looks at the past only"):
        blendcap.refine_from_take(someone.rig, someone.take, someone.binding, settings=live)
