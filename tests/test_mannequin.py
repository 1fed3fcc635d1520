"""The mannequin: seams that seal, sides that mirror, lids that clear the eyes, people within human bounds."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from blendcap import InputError, Rig, mannequin
from blendcap.data.facs import ARKIT_NAMES, SHAPE_NAMES, SHAPES
from blendcap.rendering import vertex_normals
from blendcap.synthetic.mannequin import ASYMMETRIES, MEASURES, PEOPLE
from blendcap.synthetic.mannequin.cage import head_cage
from blendcap.synthetic.mannequin.identity import make_person, measures_of
from blendcap.synthetic.mannequin.look import Look
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.mannequin.skin import brow
from faces import reflected

IDENTITIES = tuple(PEOPLE)  # as symmetric as they are built


@pytest.fixture(scope="module", params=IDENTITIES, ids=str)
def anybody(request) -> Rig:
    return mannequin(request.param)


@pytest.fixture(scope="module")
def plain() -> Rig:
    return mannequin()


# ---------------------------------------------------------------- what it is


def test_it_is_a_complete_rig(plain):
    assert plain.names == SHAPE_NAMES
    assert mannequin(shapes=52).names == ARKIT_NAMES
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
    assert plain.combinations == {shape.name: shape.drivers for shape in SHAPES if shape.drivers}


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


def test_jaw_and_bridge_are_evenly_marked_along_outline_and_ridge_and_the_brows_on_hair(anybody):
    points = anybody.points["landmarks68"]
    places = points.positions(anybody.mesh)
    normals = points.matrix(anybody.mesh) @ vertex_normals(anybody.mesh.vertices, anybody.mesh.faces)
    assert np.abs(normals[:17, 2]).max() < 0.35  # where the skin turns out of sight
    steps = np.linalg.norm(np.diff(places[:17, :2], axis=0), axis=1)
    assert steps.max() < 1.6 * steps.min()
    down = (places[27, 1] - places[[28, 29], 1]) / (places[27, 1] - places[30, 1])
    assert (np.abs(down - [1 / 3, 2 / 3]) < [0.12, 0.07]).all()
    plain = shared().rest[np.argmax(points.matrix(anybody.mesh)[17:27, : len(shared().rest)].toarray(), axis=1)]
    assert brow(plain, Look()).mean() > 0.3


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
    with pytest.raises(InputError, match="140 shapes or with ARKit's 52"):
        mannequin(shapes=51)


def test_asymmetry_sets_the_sides_apart_and_nothing_else():
    cage = head_cage()
    even = make_person(cage, {})
    assert not even.bend
    skin = cage.mirrored(even.points)
    for name, measure in ASYMMETRIES.items():
        moved = make_person(cage, {name: measure.deviation}).bend.displacement(skin)
        twin = moved[cage.twins] * [-1, 1, 1]
        assert 0.25 * measure.deviation < np.abs(moved).max() < 1.05 * measure.deviation, name
        assert np.abs(moved + twin).max() < 0.02, name  # on the whole, the face stays where it is
        eye = even.globe + 18 * np.array([[0, 0, 1], [0, 0.6, 0.8], [0.6, 0, 0.8], [0, 0, 0]])
        shifts = make_person(cage, {name: measure.deviation}).bend.displacement(eye)
        assert np.ptp(shifts, axis=0).max() < 1e-12, name  # eye and lids move as one


def test_people_are_drawn_with_what_goes_together_in_people():
    people = [measures_of(seed) for seed in range(1, 400)]
    table = {name: np.array([one[name] for one in people]) for name in MEASURES | ASYMMETRIES}
    for name, measure in (MEASURES | ASYMMETRIES).items():
        assert table[name].std() == pytest.approx(measure.deviation, rel=0.15), name
        assert np.abs(table[name]).max() <= 2 * measure.deviation
    for one, other, sign in (("upper_lip_height", "lower_lip_height", 1), ("brow_ridge", "brow_height", -1),
                             ("head_width", "head_length", 1), ("cheek_fullness", "neck_width", 1)):  # fmt: skip
        assert 0.15 < sign * np.corrcoef(table[one], table[other])[0, 1] < 0.8
    assert abs(np.corrcoef(table["nose_length"], table["mouth_slant"])[0, 1]) < 0.2
