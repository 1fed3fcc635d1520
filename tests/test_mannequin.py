"""The mannequin: seams that seal, sides that mirror, lids that clear the eyes, people within human bounds."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from blendcap import InputError, Rig, mannequin
from blendcap.synthetic.mannequin import MEASURES, PEOPLE
from blendcap.synthetic.mannequin.cage import head_cage
from blendcap.synthetic.mannequin.face import Face
from blendcap.synthetic.mannequin.identity import GLOBE_RADIUS, make_person, measures_of
from blendcap.synthetic.mannequin.lids import blink
from blendcap.synthetic.mannequin.shapes import ARKIT
from blendcap.synthetic.mannequin.shared import shared

IDENTITIES = (0, 3, 11, *list(PEOPLE)[1:])
CLOSED = (
    "mouthSmile mouthFrown mouthDimple mouthStretch mouthPress mouthLeft mouthRight mouthPucker mouthRollLower "
    "mouthRollUpper mouthShrugLower mouthShrugUpper cheekPuff cheekSquint noseSneer jawForward jawLeft jawRight"
)


@pytest.fixture(scope="module", params=IDENTITIES, ids=str)
def anybody(request) -> Rig:
    return mannequin(request.param)


@pytest.fixture(scope="module")
def plain() -> Rig:
    return mannequin()


def weights(rig: Rig, **values: float) -> np.ndarray:
    """Weights by name; a name without its side means both."""
    result = np.zeros(len(rig.names))
    for name, value in values.items():
        for full in (name, f"{name}Left", f"{name}Right"):
            if full in rig.names:
                result[rig.index(full)] = value
    return result


def gap(rig: Rig, vertices: np.ndarray, contact: str) -> float:
    pairs = rig.contacts[contact]
    return float(np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1).max())


def reflected(vectors: np.ndarray) -> np.ndarray:
    return vectors * [-1, 1, 1]


# ---------------------------------------------------------------- what it is


def test_it_is_a_complete_rig(plain):
    assert plain.names == ARKIT
    assert len(plain.names) == 52
    assert len(plain.mesh.vertices) >= 8000
    assert plain.mesh.polygons.shape[1] == 4
    assert (plain.mesh.polygons >= 0).all()  # quads only
    assert plain.mesh.texture.shape[2] == 3
    assert (plain.mesh.uv >= 0).all() and (plain.mesh.uv <= 1).all()
    wanted = {
        "forehead",
        "brows",
        "glabella",
        "lids",
        "eyes",
        "nose",
        "cheeks",
        "lips",
        "jaw",
        "neck",
        "upper",
        "lower",
    }
    assert wanted <= set(plain.regions)
    assert set(plain.contacts) == {"lips", "lids_left", "lids_right"}
    assert plain.combinations == {"mouthClose": ("jawOpen",)}


def test_every_vertex_is_used_and_every_edge_has_at_most_two_faces(plain):
    quads = plain.mesh.polygons
    assert np.array_equal(np.unique(quads), np.arange(len(plain.mesh.vertices)))
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], -1).reshape(-1, 2)
    _, directed = np.unique(ends, axis=0, return_counts=True)
    assert directed.max() == 1  # so neighbours run along their edge in opposite ways: the surface is oriented


def test_faces_look_outwards(plain):
    a, b, c = (plain.mesh.vertices[plain.mesh.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    front = plain.mesh.vertices[plain.regions["forehead"]].mean(0)
    nearest = np.linalg.norm((a + b + c) / 3 - front, axis=1).argmin()
    assert normal[nearest, 2] > 0


def test_it_is_deterministic(plain):
    again = mannequin(0)
    assert np.array_equal(plain.deltas, again.deltas)
    assert np.array_equal(plain.mesh.texture, again.mesh.texture)
    assert np.array_equal(mannequin(5).mesh.vertices, mannequin(5).mesh.vertices)
    assert np.array_equal(mannequin({}).mesh.vertices, plain.mesh.vertices)


def test_seeds_and_measures_differ(plain):
    assert np.abs(mannequin(1).mesh.vertices - mannequin(2).mesh.vertices).max() > 1
    wider = mannequin({"mouth_width": 4})
    corners = [wider.points["landmarks68"].positions(rig.mesh)[[48, 54]] for rig in (plain, wider)]
    widths = [np.linalg.norm(left - right) for left, right in corners]
    assert widths[1] - widths[0] == pytest.approx(4, abs=0.4)


# ---------------------------------------------------------------- contacts


def test_lips_seal_in_neutral_and_with_mouth_close(anybody):
    assert len(anybody.contacts["lips"]) >= 25
    assert gap(anybody, anybody.mesh.vertices, "lips") < 1e-9
    assert gap(anybody, anybody.pose(weights(anybody, jawOpen=1)), "lips") > 15
    assert gap(anybody, anybody.pose(weights(anybody, jawOpen=1, mouthClose=1)), "lips") < 1e-4


@pytest.mark.parametrize("name", CLOSED.split())
def test_closed_mouth_shapes_keep_the_lips_sealed(plain, name):
    assert gap(plain, plain.pose(weights(plain, **{name: 1})), "lips") < 1e-4


def test_lids_seal_at_full_blink_only(anybody):
    for side in ("Left", "Right"):
        contact = f"lids_{side.lower()}"
        assert len(anybody.contacts[contact]) >= 20
        assert gap(anybody, anybody.mesh.vertices, contact) > 5
        assert gap(anybody, anybody.pose(weights(anybody, **{f"eyeBlink{side}": 1})), contact) < 1e-4


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


# ---------------------------------------------------------------- symmetry


def test_skin_mirrors_exactly(anybody):
    twins = shared().surface.twins
    skin = anybody.mesh.vertices[: len(twins)]
    assert np.array_equal(twins[twins], np.arange(len(twins)))
    assert np.array_equal(skin[twins], reflected(skin))
    deltas = anybody.deltas[:, : len(twins)]
    assert np.array_equal(deltas[anybody.mirror][:, twins], reflected(deltas).astype(np.float32))


def test_parts_mirror(plain):
    count = len(shared().rest)
    parts = plain.mesh.vertices[count:]
    distance, twins = cKDTree(parts).query(reflected(parts))
    assert distance.max() < 1e-9
    for name in ("eyeLookInLeft", "eyeLookUpLeft", "jawOpen", "jawLeft", "tongueOut"):
        row = plain.index(name)
        mirrored = plain.deltas[plain.mirror[row], count:][twins]
        assert np.abs(mirrored - reflected(plain.deltas[row, count:])).max() < 1e-4


def test_mirror_map_swaps_sides(plain):
    for name, other in zip(plain.names, plain.mirror, strict=True):
        expected = name.replace("Left", "\0").replace("Right", "Left").replace("\0", "Right")
        assert plain.names[other] == expected


def test_left_means_the_subjects_left(plain):
    for name in ("eyeBlink", "mouthSmile", "browDown", "noseSneer"):
        moved = np.linalg.norm(plain.deltas[plain.index(f"{name}Left")], axis=1)
        assert (plain.mesh.vertices[moved > 1, 0] > -5).all()
    assert plain.deltas[plain.index("jawLeft")][:, 0].max() > 5
    assert plain.deltas[plain.index("mouthRight")][:, 0].min() < -5


def test_halves_overlap_only_near_the_midline(plain):
    left, right = (plain.deltas[plain.index(f"mouthSmile{side}")] for side in ("Left", "Right"))
    whole = left + right
    far = np.abs(plain.mesh.vertices[:, 0]) > 25
    larger = np.where(np.linalg.norm(left, axis=1)[:, None] > np.linalg.norm(right, axis=1)[:, None], left, right)
    assert np.abs(whole - larger)[far].max() < 0.02


# ---------------------------------------------------------------- shapes


REACH = {  # regions that may move by more than 0.5 mm
    "brow": {"brows", "forehead", "glabella", "lids", "nose", "sockets", "scalp", "cheeks"},
    "eye": {"lids", "eyes", "sockets", "cheeks", "brows", "nose"},
    "mouth": {"lips", "cheeks", "jaw", "nose", "mouth", "lids", "neck"},
    "jaw": {"lips", "cheeks", "jaw", "neck", "mouth", "teeth", "tongue", "scalp", "nose"},
    "nose": {"nose", "lips", "cheeks", "lids", "mouth", "glabella"},
    "cheek": {"cheeks", "lips", "lids", "nose", "jaw", "brows", "mouth", "sockets", "neck"},
    "tongue": {"tongue", "lips", "mouth", "jaw", "nose", "cheeks"},
}


@pytest.mark.parametrize("name", ARKIT)
def test_each_shape_moves_its_own_part_of_the_face(plain, name):
    moved = np.linalg.norm(plain.deltas[plain.index(name)], axis=1)
    assert 1.0 < moved.max() < 45
    kind = next(prefix for prefix in REACH if name.startswith(prefix))
    single = [region for region in plain.regions if region not in ("upper", "lower")]
    reached = {region for region in single if moved[plain.regions[region]].max() > 0.5}
    assert reached <= REACH[kind]


def test_no_two_shapes_are_the_same(plain):
    flat = plain.deltas.reshape(52, -1).astype(np.float64)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    cosine = flat @ flat.T - np.eye(52)
    assert cosine.max() < 0.97


def test_few_quads_turn_over(plain):
    """Folding under the lids and inside the corners of the mouth is natural; more would be a torn face."""
    quads = plain.mesh.polygons

    def normals(vertices):
        return np.cross(vertices[quads[:, 2]] - vertices[quads[:, 0]], vertices[quads[:, 3]] - vertices[quads[:, 1]])

    rest = normals(plain.mesh.vertices)
    skin = ~np.isin(quads, np.concatenate([plain.regions[k] for k in ("eyes", "teeth", "tongue")])).any(1)
    for name in plain.names:
        drivers = dict.fromkeys(plain.combinations.get(name, ()), 1)
        turned = (normals(plain.pose(weights(plain, **{name: 1}, **drivers))) * rest).sum(1) < 0
        assert (turned & skin).sum() <= 12, name


def test_gaze_turns_the_eye_the_way_it_says(plain):
    eyes = plain.regions["eyes"]
    left = eyes[plain.mesh.vertices[eyes, 0] > 0]
    cornea = left[plain.mesh.vertices[left, 2].argmax()]
    for name, axis, sign in (("In", 0, -1), ("Out", 0, 1), ("Up", 1, 1), ("Down", 1, -1)):
        moved = plain.deltas[plain.index(f"eyeLook{name}Left"), cornea]
        assert sign * moved[axis] > 4
        assert np.abs(plain.deltas[plain.index(f"eyeLook{name}Right")][left]).max() == 0


def test_the_jaw_takes_its_teeth_along(plain):
    teeth = plain.regions["teeth"]
    down = plain.deltas[plain.index("jawOpen")][teeth, 1]
    assert (down[: len(teeth) // 2] == 0).all()  # upper
    assert (down[len(teeth) // 2 :] < -5).all()


# ---------------------------------------------------------------- places


def test_landmarks_have_the_usual_order_and_sides(anybody):
    at = anybody.points["landmarks68"].positions(anybody.mesh)
    assert anybody.points["landmarks68"].names == tuple(str(i) for i in range(68))
    pairs = [(i, 16 - i) for i in range(8)] + [(17 + i, 26 - i) for i in range(5)] + [(31, 35), (32, 34)]
    pairs += [(36, 45), (37, 44), (38, 43), (39, 42), (40, 47), (41, 46), (48, 54), (49, 53), (50, 52), (60, 64)]
    for right, left in pairs:
        assert at[right, 0] < -1 < 1 < at[left, 0]
        assert at[left] == pytest.approx(reflected(at[right]), abs=1e-9)
    for middle in (8, 27, 28, 29, 30, 33, 51, 57, 62, 66):
        assert at[middle, 0] == pytest.approx(0, abs=1e-9)
    assert at[36, 0] < at[39, 0] < at[27, 0] < at[42, 0] < at[45, 0]
    heights = [at[i, 1] for i in (24, 44, 30, 33, 51, 57, 8)]
    assert heights == sorted(heights, reverse=True)  # brow, lid, nose tip, nose base, lips, chin
    assert at[:17, 0].tolist() == sorted(at[:17, 0])
    assert at[30, 2] == at[:, 2].max()


def test_markers_are_fifty_and_symmetric(plain):
    points = plain.points["markers50"]
    at = dict(zip(points.names, points.positions(plain.mesh), strict=True))
    assert 48 <= len(at) <= 55
    for name, place in at.items():
        if name.endswith("_left"):
            assert place[0] > 1
            assert at[name.replace("_left", "_right")] == pytest.approx(reflected(place), abs=1e-9)
        elif not name.endswith("_right"):
            assert place[0] == pytest.approx(0, abs=1e-9)
    spots = np.array(list(at.values()))
    assert cKDTree(spots).query(spots, k=2)[0][:, 1].min() > 5  # mm: room for a marker
    assert {"lid_upper_left", "lid_lower_left", "lip_upper_middle", "lip_lower_middle", "nose_bridge"} <= set(at)
    assert sum(name.startswith(("forehead", "temple", "nose_bridge")) for name in at) >= 4


# ---------------------------------------------------------------- people


def test_fifty_seeds_stay_within_human_bounds():
    """Ranges about Farkas' (1994) adult norms, three deviations either side, without building whole rigs."""
    cage, surface = head_cage(), shared().surface
    ends = {"bizygomatic": ("Q7", 118, 152), "mouth": ("seam.4", 40, 68), "inner_canthi": ("margin.0", 23, 42),
            "outer_canthi": ("margin.6", 75, 102), "nose": ("W2", 24, 48)}  # fmt: skip
    for seed in range(50):
        person = make_person(cage, measures_of(seed))
        skin = surface.through(cage.mirrored(person.points))
        for what, (name, low, high) in ends.items():
            width = 2 * skin[cage.index([name])[0], 0]
            assert low < width < high, (seed, what, width)
        assert 54 < 2 * person.globe[0] < 74  # between the pupils
        nasion, menton = (skin[cage.index([name])[0], 1] for name in ("N0", "M78"))
        assert 105 < nasion - menton < 155


def test_measures_do_what_they_say():
    """1 mm of a width widens by about 1 mm; heights and depths likewise, at the place the measure is named after."""
    cage = head_cage()
    checks = {"mouth_width": ("seam.4", 0, 2), "bizygomatic_width": ("P7", 0, 2), "nasal_width": ("W2", 0, 2),
              "nose_protrusion": ("N4", 2, 1), "chin_projection": ("M68", 2, 1), "nose_length": ("N4b", 1, -1),
              "head_width": ("S5", 0, 2)}  # fmt: skip
    for name, (place, axis, factor) in checks.items():
        at = cage.index([place])[0]
        moved = make_person(cage, {name: 1.0}).points[at, axis] - cage.half[at, axis]
        assert factor * moved == pytest.approx(1, abs=0.35), name


@pytest.mark.parametrize(
    ("identity", "words"),
    [
        ({"nose_size": 1.0}, "no measure named 'nose_size'"),
        ({"mouth_width": 99.0}, "between -6 and 6"),
        ({"mouth_width": float("nan")}, "between -6 and 6"),
        ({"mouth_width": "wide"}, "must be a number"),
        ("nobody", "no mannequin named 'nobody'"),
        (-1, "whole number from 0"),
        (1.5, "is 1.5"),
    ],
)
def test_bad_identities_are_refused_in_plain_words(identity, words):
    with pytest.raises(InputError, match=words):
        mannequin(identity)


def test_other_sets_of_shapes_are_refused():
    with pytest.raises(InputError, match="comes with 52 shapes"):
        mannequin(shapes=51)


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
