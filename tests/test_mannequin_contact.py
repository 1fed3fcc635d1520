"""What may not pass through what: lips and lids that meet, skin that keeps off eyeballs and teeth."""

import numpy as np
import pytest

from blendcap.synthetic.mannequin import MEASURES, PEOPLE
from blendcap.synthetic.mannequin.cage import head_cage
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS, make_person
from blendcap.synthetic.mannequin.lids import blink
from blendcap.synthetic.mannequin.shared import shared
from faces import gap, person, weights

CLOSED = (
    "mouthSmile mouthFrown mouthDimple mouthStretch mouthPress mouthLeft mouthRight mouthPucker mouthRollLower "
    "mouthRollUpper mouthShrugLower mouthShrugUpper cheekPuff cheekSquint noseSneer jawForward jawLeft jawRight "
    "jawBack mouthCornerUp mouthTightenUpper mouthTightenLower mouthPressUpper mouthPuckerLower mouthSwingUpperLeft "
    "chinRaise visemeMBP nasolabialDeepen cheekSuck eyeSqueeze"
)


@pytest.fixture(scope="module", params=(0, 3, *list(PEOPLE)[1:]), ids=str)
def anybody(request):
    return person(request.param)


def test_lips_seal_in_neutral_and_with_mouth_close(anybody):
    assert len(anybody.contacts["lips"]) >= 25
    assert gap(anybody, anybody.mesh.vertices, "lips") < 1e-9
    assert gap(anybody, anybody.pose(weights(anybody, jawOpen=1)), "lips") > 15
    assert gap(anybody, anybody.pose(weights(anybody, jawOpen=1, mouthClose=1)), "lips") < 1e-4


@pytest.mark.parametrize("name", CLOSED.split())
def test_closed_mouth_shapes_keep_the_lips_sealed(name):
    rig = person()
    assert gap(rig, rig.pose(weights(rig, **{name: 1})), "lips") < 1e-4


@pytest.mark.parametrize("name", ["eyeBlink", "eyeClose", "eyeSqueeze"])
def test_lids_seal_when_shut_only(anybody, name):
    for side in ("Left", "Right"):
        contact = f"lids_{side.lower()}"
        assert len(anybody.contacts[contact]) >= 20
        assert gap(anybody, anybody.mesh.vertices, contact) > 5
        assert gap(anybody, anybody.pose(weights(anybody, **{f"{name}{side}": 1})), contact) < 1e-4


@pytest.mark.parametrize("closed", [0, 0.25, 0.5, 0.75, 1])
def test_lids_stay_outside_the_eyeball(anybody, closed):
    """A linear blink takes the chord, yet the lids keep off the globe: by 0.45 mm at 0, 1/2 and 1."""
    vertices = anybody.pose(weights(anybody, eyeBlink=closed))
    eyes, lids = vertices[anybody.regions["eyes"]], vertices[anybody.regions["lids"]]
    for side in (1, -1):
        globe = eyes[eyes[:, 0] * side > 0]
        center = (globe.max(0) + globe.min(0))[:2] / 2
        center = np.array([*center, globe[:, 2].min() + GLOBE_RADIUS])
        distance = np.linalg.norm(lids[lids[:, 0] * side > 0] - center, axis=1)
        assert distance.min() > GLOBE_RADIUS + (0.45 if closed in (0, 0.5, 1) else 0.3)


def test_lids_still_seal_at_the_bounds_of_every_measure():
    cage, surface = head_cage(), shared().surface
    pairs = shared().contacts["lids_left"]
    for name, measure in MEASURES.items():
        for sign in (-2, 2):
            face = Face(cage, make_person(cage, {name: sign * measure.deviation}))
            opened = surface.through(cage.mirrored(face.points))[pairs]
            closed = surface.through(cage.mirrored(face.points + blink(face)))[pairs]
            assert np.linalg.norm(opened[:, 0] - opened[:, 1], axis=1).max() > 4, name
            assert np.linalg.norm(closed[:, 0] - closed[:, 1], axis=1).max() < 1e-9, name
