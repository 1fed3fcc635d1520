"""Lips meet for p, b and m, whatever is said around them and whoever says it."""

from functools import cache

import numpy as np
import pytest

from blendcap import Animation, Rig, mannequin
from blendcap.synthetic import conversation as conversing
from blendcap.synthetic import performances as speaking
from blendcap.synthetic.conversation import conversation
from blendcap.synthetic.performances import shut, speech
from blendcap.synthetic.performer import Performer, make_performer
from faces import weights

MEETING = 0.1  # mm: the most that lips of a closure lie apart anywhere along them
RATE, SECONDS = 60.0, 20.0


@cache
def face(identity, shapes: int = 140) -> Rig:
    return mannequin(identity, shapes)


def gaps(performer: Performer, meant: np.ndarray) -> np.ndarray:
    """(T,): the widest gap between the lips, mm."""
    one, other = performer.rig.contacts["lips"].T
    rest = performer.rig.mesh.vertices[one] - performer.rig.mesh.vertices[other]
    parting = performer.rig.deltas[:, one].astype(float) - performer.rig.deltas[:, other]
    return np.linalg.norm(rest + np.tensordot(performer.expand(meant), parting, 1), axis=2).max(1)


def watch(module, monkeypatch) -> list[tuple[float, float]]:
    """The closures (start, length in seconds) that a performance is made with, once it is made."""
    found: list[tuple[float, float]] = []
    monkeypatch.setattr(module, "shut", lambda played, closures: found.extend(closures) or shut(played, closures))
    return found


@pytest.mark.parametrize("identity", [0, "lars", "mei", 3])
@pytest.mark.parametrize(("module", "play", "seeds"), [(conversing, conversation, (0, 1)), (speaking, speech, (2,))])
def test_lips_meet_in_played_speech(identity, module, play, seeds, monkeypatch):
    rig = face(identity)
    for seed in seeds:
        closures = watch(module, monkeypatch)
        played = play(rig, RATE, SECONDS, seed)
        middles = np.array([round((start + length / 2) * RATE) for start, length in closures])
        middles = middles[middles < len(played.weights)]
        assert len(middles) >= 2
        for strength in (0.0, 1.0):
            gap = gaps(make_performer(rig, seed=seed, strength=strength, resistance=strength), played.weights)
            assert gap[middles].max() < MEETING, (seed, strength)
            assert np.percentile(gap, 85) > 2.0  # and they part again


@pytest.mark.parametrize("shapes", [52, 140])
@pytest.mark.parametrize("seed", (0, 3, 7))
def test_lips_meet_over_a_jaw_that_stays_open(shapes, seed):
    """Everything that parts lips at once: a closure takes all of it back but the jaw, which the lips bridge."""
    rig = face(0, shapes)
    loud = weights(rig, jawOpen=1, mouthFunnel=0.7, mouthUpperUp=0.5, mouthSmile=0.6, mouthPress=0.3)
    held = speaking.with_correctives(Animation(np.tile(loud, (31, 1)), rig.names, 30.0), rig)
    closed = shut(held, [(0.25, 0.5)])
    assert closed.weights[15, rig.index("jawOpen")] > 0.35
    for strength in (0.0, 1.0):
        gap = gaps(make_performer(rig, seed=seed, strength=strength, resistance=strength), closed.weights)
        assert gap[15] < MEETING < 5 < gap[0] == gap[30], strength


def test_a_rig_without_mouth_close_shuts_its_jaw():
    rig = face(0, 52)
    fewer = rig.select([name for name in rig.names if name != "mouthClose"])
    open_wide = Animation(np.tile(weights(fewer, jawOpen=1), (31, 1)), fewer.names, 30.0)
    assert shut(open_wide, [(0.25, 0.5)]).weights[15, fewer.index("jawOpen")] == pytest.approx(0, abs=1e-9)
