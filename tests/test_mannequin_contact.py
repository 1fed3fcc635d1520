"""What may not pass through what: lips and lids that meet, skin that keeps off eyeballs and teeth."""

import numpy as np
import pytest

from blendcap import Rig
from blendcap.data.correctives import driven
from blendcap.io import read_animation
from blendcap.rendering.camera import face_camera
from blendcap.rendering.rasterize import rasterize
from blendcap.synthetic.mannequin import MEASURES, PEOPLE
from blendcap.synthetic.mannequin.cage import head_cage
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS, make_person
from blendcap.synthetic.mannequin.lids import blink
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.performances import for_rig, range_of_motion, speech
from faces import alone, depth_in_eyes, depth_in_teeth, gap, person, skin_normals, solids, weights

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


def seen_through_the_lids(rig: Rig, vertices: np.ndarray, yaw: float) -> int:
    """Pixels of 0.2 mm that see the lining of the lids from behind: nothing but skin it came through lies there."""
    faces = rig.mesh.faces
    sockets = rig.regions["sockets"]
    lining = np.isin(faces, sockets[sockets < len(shared().rest)]).any(1)
    eyes = vertices[np.concatenate([rig.contacts["lids_left"], rig.contacts["lids_right"]]).ravel()]
    box = np.concatenate([eyes + np.array([0.0, up, 0.0]) for up in (-12, 12)])
    camera = face_camera(box, (600, 170), yaw)
    seen = rasterize(vertices, faces, camera, (600, 170)).face
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    station = -camera.pose[:3, :3].T @ camera.pose[:3, 3]
    behind = ((a - station) * np.cross(b - a, c - a)).sum(1) > 0
    return int((lining & behind)[seen[seen >= 0]].sum())


def assert_lids_hide_their_lining(identity, *poses: dict[str, float]) -> None:
    rig = person(identity)
    for pose in poses:
        vertices = rig.pose(driven(rig, weights(rig, **pose)))
        for yaw in (-0.6, 0.0, 0.6):
            assert seen_through_the_lids(rig, vertices, yaw) < GRAZED, (identity, pose, yaw)


GRAZED = 5  # pixels along the line where the rims meet, seen edge on
BLINKS = [{"eyeBlink": closed} for closed in (0.8, 0.9, 1.0)]


@pytest.mark.parametrize("identity", ["ada", "mei", 3])  # the slow test has everybody
def test_shut_lids_hide_their_lining(identity):
    assert_lids_hide_their_lining(identity, *BLINKS)


@pytest.mark.slow
def test_nobodys_lids_show_their_lining():
    others = [{"eyeBlink": 0.5}, {"eyeClose": 1}, {"eyeSqueeze": 1}, {"eyeSquint": 1}, {"lidTighten": 1},
              {"eyeBlink": 1, "cheekSquint": 1, "browDown": 1}, {"eyeBlink": 1, "eyeLookDown": 1}]  # fmt: skip
    for identity in (*PEOPLE, *range(1, 25)):
        assert_lids_hide_their_lining(identity, {}, *BLINKS, *others)


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


def test_the_measure_of_depth_itself():
    rig = person()
    for own, faces in solids(rig, rig.mesh.vertices):
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2), axis=1)
        assert (np.unique(ends, axis=0, return_counts=True)[1] == 2).all()  # closed
        assert 1e3 < np.einsum("ij,ij->", own[faces[:, 0]], np.cross(own[faces[:, 1]], own[faces[:, 2]])) / 6 < 1e4
    pushed = rig.mesh.vertices.copy()
    pushed[rig.regions["lips"], 2] -= 8
    assert depth_in_teeth(rig, rig.mesh.vertices) < -0.5 < 1 < depth_in_teeth(rig, pushed)
    assert depth_in_eyes(rig, rig.mesh.vertices) < -0.2


def assert_single_shapes_stay_out(identity, levels: tuple[float, ...]) -> None:
    rig = person(identity)
    for name in rig.names:
        if name.endswith("Right") and rig.names[rig.mirror[rig.index(name)]] != name and identity in PEOPLE:
            continue  # mirrors the left
        for level in levels:
            vertices = rig.pose(level * alone(rig, name))
            assert depth_in_teeth(rig, vertices) < 0, (identity, name, level)
            assert depth_in_eyes(rig, vertices) < 0, (identity, name, level)


def test_no_shape_goes_through_teeth_or_eyes():
    assert_single_shapes_stay_out("plain", (1.0,))


@pytest.mark.slow
@pytest.mark.parametrize("identity", ["kofi", "lars", "mei", 4, 7, 9, 14, 17])
def test_no_shape_goes_through_teeth_or_eyes_on_others_nor_half_way(identity):
    assert_single_shapes_stay_out(identity, (1.0, 0.5))


def _through(identity, weights: np.ndarray) -> float:
    rig = person(identity)
    posed = (rig.pose(row) for row in driven(rig, weights))
    return max(max(depth_in_teeth(rig, vertices), depth_in_eyes(rig, vertices)) for vertices in posed)


def _acted(identity, count: int, seed: int) -> np.ndarray:
    rig, rng = person(identity), np.random.default_rng(seed)
    takes = [speech(rig, 30, 60, seed=seed).weights, range_of_motion(rig, 30).weights]
    return np.concatenate([take[rng.choice(len(take), count // 2, replace=False)] for take in takes])


def test_acted_faces_do_not_go_through_teeth_or_eyes():
    assert _through(0, _acted(0, 50, seed=1)) < 0


@pytest.mark.slow
@pytest.mark.parametrize("identity", [0, "lars", 7])
def test_500_faces_do_not_go_through_teeth_or_eyes(identity, data):
    rig, rng, weights = person(identity), np.random.default_rng(5), [_acted(identity, 250, seed=5)]
    for name in ("alexdjulin_alex_rom_3", "neurosync_Happy_Happy"):
        played = for_rig(read_animation(data(f"performances/{name}.csv")), rig).weights
        weights.append(played[rng.choice(len(played), 125, replace=False)])
    assert _through(identity, np.concatenate(weights)) < 0


@pytest.mark.parametrize("other", ["eyeLookDown", "eyeLookUp", "eyeSquint", "eyeWide"])
@pytest.mark.parametrize("level", [0.4, 1.0])
def test_a_blink_seals_whatever_the_lids_did_before(other, level):
    rig = person(3)
    blink = driven(rig, weights(rig, eyeBlink=1, **{other: level}))
    assert gap(rig, rig.pose(blink), "lids_left") < 1e-3 and gap(rig, rig.pose(blink), "lids_right") < 1e-3
    assert gap(rig, rig.pose(weights(rig, eyeBlink=1, **{other: level})), "lids_left") > 0.05  # without its corrective


@pytest.mark.slow
def test_twenty_people_seal_and_never_fold():
    """Lids and lips meet to a hundredth of a millimetre; no quad turns by a right angle in or into a shape."""
    for seed in range(1, 21):
        rig = person(seed)
        assert gap(rig, rig.pose(weights(rig, jawOpen=1, mouthClose=1)), "lips") < 0.01
        for side in ("left", "right"):
            assert gap(rig, rig.pose(weights(rig, eyeBlink=1)), f"lids_{side}") < 0.01
        rest = skin_normals(rig.mesh.vertices)
        for name in rig.names:
            for level in (0.5, 1.0):
                turned = (skin_normals(rig.pose(level * alone(rig, name))) * rest).sum(1) < 0
                assert not turned.any(), (seed, name, level)
