"""Landmarks: the detector's mathematics, and points found on scans whose truth is known."""

import numpy as np
import pytest

import blendcap
from blendcap.data import InputError, LandmarkModel, Mesh, SurfacePoints
from blendcap.modeling.contours import Weights, line_energy, ribbon, trace_exact, trace_icm
from blendcap.modeling.detection import detect, detect_paper, log_odds
from blendcap.modeling.frontal import frontal, lift, out_of_gaps
from blendcap.modeling.hog import BINS, cell_maps, describe
from blendcap.modeling.landmark_names import FEATURES, LINES, ON_A_LINE, along, line_names, rig_landmarks
from blendcap.modeling.landmark_pairs import find_pairs
from blendcap.modeling.landmark_training import train_landmarks
from blendcap.modeling.landmarks import search_landmarks
from blendcap.modeling.lines import without_lost
from blendcap.modeling.mean_shift import mean_shift
from blendcap.modeling.shut_eyes import keep_eyes_open


@pytest.fixture(scope="module")
def rig():
    return blendcap.mannequin(1002)


@pytest.fixture(scope="module")
def finding(rig):
    return search_landmarks(rig.mesh)


def random_picture(seed=0, size=96):
    import cv2

    noise = np.random.default_rng(seed).normal(size=(size, size))
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return (0.5 + 0.15 * smooth / smooth.std())[..., None].clip(0, 1)


def test_a_descriptor_knows_no_brightness_and_little_contrast():
    picture, spots = random_picture(), np.array([[40.0, 50], [60, 33]])
    plain = describe(cell_maps(picture, 8), spots, 4, 8)
    assert plain.shape == (2, 16 * BINS)
    np.testing.assert_allclose(np.linalg.norm(plain, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(describe(cell_maps(picture + 0.3, 8), spots, 4, 8), plain, atol=2e-4)
    assert (describe(cell_maps(0.5 * picture, 8), spots, 4, 8) * plain).sum(1).min() > 0.98
    np.testing.assert_allclose(describe(cell_maps(1 - picture, 8), spots, 4, 8), plain, atol=2e-4)  # no sign


def test_the_histogram_of_a_slope_is_its_direction():
    y, x = np.mgrid[0:64, 0:64] / 64.0
    for turn in np.radians([0, 20, 75, 130]):
        slope = np.cos(turn) * x + np.sin(turn) * y
        cell = cell_maps(slope[..., None], 8)[32, 32]
        at = turn / np.pi * BINS
        low = int(at)
        expected = np.zeros(BINS)
        expected[low], expected[(low + 1) % BINS] = 1 - (at - low), at - low
        np.testing.assert_allclose(cell / cell.sum(), expected, atol=1e-3)


def test_descriptors_move_with_the_picture():
    picture = random_picture()
    moved = np.roll(picture, (5, -7), (0, 1))
    one = describe(cell_maps(picture, 8), np.array([[48.0, 48]]), 4, 8)
    other = describe(cell_maps(moved, 8), np.array([[41.0, 53]]), 4, 8)
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_mean_shift_finds_the_dense_places_in_order():
    rng = np.random.default_rng(0)
    blobs = [rng.normal(center, 1.0, size=(count, 2)) for center, count in (((0, 0), 30), ((60, 5), 80))]
    centers, sizes = mean_shift(np.concatenate(blobs), 10.0)
    np.testing.assert_array_equal(sizes, [80, 30])
    np.testing.assert_allclose(centers, [blobs[1].mean(0), blobs[0].mean(0)], atol=0.2)


def test_a_weight_counts_as_that_many_points():
    points = np.array([[0.0, 0], [2, 0], [30, 0], [31, 3]])
    repeats = np.array([3, 1, 2, 1])
    weighted = mean_shift(points, 10.0, repeats)
    repeated = mean_shift(np.repeat(points, repeats, axis=0), 10.0)
    for one, other in zip(weighted, repeated, strict=True):
        np.testing.assert_allclose(one, other)
    np.testing.assert_allclose(weighted[0][0], [0.5, 0])


def test_log_odds_are_zero_where_both_are_as_likely_and_grow_no_more_beyond_the_good():
    good, bad = np.array([2.0, 1.0]), np.array([0.0, 1.0])
    np.testing.assert_allclose(log_odds(np.array([0.0, 1, 2, 5]), good, bad), [-2, 0, 2, 2])


@pytest.mark.parametrize("seed", range(4))
def test_no_line_has_less_energy_than_the_exact_one(seed):
    rng = np.random.default_rng(seed)
    cost, weights = rng.normal(size=(5, 6)), Weights(0.3, 1.0, 0.2)
    best = trace_exact(cost, weights)
    every = np.stack(np.meshgrid(*[range(5)] * 4, indexing="ij"), -1).reshape(-1, 4)
    energies = [line_energy(cost, np.array([2, *inner, 2]), weights) for inner in every]
    assert line_energy(cost, best, weights) == pytest.approx(min(energies))
    assert best[0] == best[-1] == 2


def test_both_ways_trace_a_dark_curve_and_the_exact_one_no_worse():
    width, half = 80, 15
    truth = half + 6 * np.sin(np.linspace(0, np.pi, width))
    rows = np.arange(2 * half + 1)[:, None]
    cost = -4 * np.exp(-0.5 * ((rows - truth) / 1.5) ** 2) + 0.05 * np.random.default_rng(0).normal(size=(31, width))
    weights = Weights()
    exact, local = trace_exact(cost, weights), trace_icm(cost, weights)
    assert np.abs(exact - truth).max() <= 1.5
    assert np.abs(local - truth).mean() < 0.6 * np.abs(half - truth).mean()
    assert line_energy(cost, exact, weights) <= line_energy(cost, local, weights) + 1e-9


def test_a_ribbon_lies_along_its_line():
    strip = ribbon(np.array([10.0, 20]), np.array([40.0, 60]), 5)
    assert strip.shape == (11, 51, 2)
    np.testing.assert_allclose(strip[5, [0, -1]], [[10, 20], [40, 60]])
    np.testing.assert_allclose(np.linalg.norm(strip[0] - strip[5], axis=1), 5)


def test_points_along_a_line_are_evenly_spaced():
    bent = np.array([[0.0, 0], [1, 0], [10, 0], [10, 10]])
    points, at = along(bent)
    assert len(points) == ON_A_LINE
    np.testing.assert_allclose(points[4], [10, 0])
    np.testing.assert_allclose(at[4], 2)
    corner = np.insert(np.insert(points, 0, bent[0], 0), ON_A_LINE + 1, bent[-1], 0)
    np.testing.assert_allclose(np.abs(np.diff(corner, axis=0)).sum(1), 2.0)


def marked_pictures(count, seed):
    """Noise with two marks, and where they are."""
    rng = np.random.default_rng(seed)
    pictures, boxes = [], []
    for k in range(count):
        picture = 0.3 * random_picture(1000 * seed + k, 128)[..., 0] + 0.3
        (ax, ay), (bx, by) = np.round(rng.normal([[40, 45], [90, 80]], 3)).astype(int)
        picture[ay - 2 : ay + 3, ax - 9 : ax + 10] = 0.9
        picture[by - 9 : by + 10, bx - 2 : bx + 3] = 0.1
        pictures.append((255 * picture).astype(np.uint8))
        boxes.append({"bar": (ax - 5, ay - 5, 11, 11), "post": (bx - 5, by - 5, 11, 11)})
    return pictures, boxes


@pytest.mark.parametrize("method", ["discriminant", "exemplars"])
def test_trained_marks_are_found_in_new_pictures(method):
    model = train_landmarks(*marked_pictures(12, 1), method=method)
    assert model.filters.shape[1] == (1 if method == "discriminant" else 12)
    pictures, boxes = marked_pictures(6, 2)
    for picture, box in zip(pictures, boxes, strict=True):
        truth = np.array([np.array(box[name][:2]) + 5 for name in model.names])
        image = picture[..., None] / 255.0
        found = detect(image, model)[0] if method == "discriminant" else detect_paper(image, model, 2)[0]
        assert np.abs(found - truth).max() < 3.5


def test_training_says_what_is_wrong():
    pictures, boxes = marked_pictures(3, 1)
    with pytest.raises(InputError, match="as many of one as of the other"):
        train_landmarks(pictures, boxes[:2])
    with pytest.raises(InputError, match="differ in size"):
        train_landmarks([*pictures[:2], pictures[2][:50]], boxes)
    with pytest.raises(InputError, match="Picture 2 differs from the first in having a rectangle 'post'"):
        train_landmarks(pictures, [*boxes[:2], {"bar": (1, 1, 5, 5)}])
    with pytest.raises(InputError, match="rectangle 'post' of picture 1 lies outside"):
        train_landmarks(pictures, [boxes[0], {**boxes[1], "post": (300, 1, 5, 5)}, boxes[2]])


def test_a_model_survives_its_arrays():
    model = train_landmarks(*marked_pictures(4, 3))
    again = LandmarkModel.from_arrays(model.arrays())
    np.testing.assert_allclose(again.filters, model.filters, atol=1e-3)
    assert again.names == model.names and again.cells == model.cells
    with pytest.raises(InputError, match="lacks filters"):
        LandmarkModel.from_arrays({k: v for k, v in model.arrays().items() if k != "filters"})


def test_what_a_picture_sees_is_lifted_to_where_it_is(rig):
    view = frontal(rig.mesh, np.eye(4), textured=False)
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(view.fragments.face >= 0)
    some = rng.choice(len(rows), 200, replace=False)
    pixels = np.stack([columns[some], rows[some]], 1) + rng.uniform(-0.3, 0.3, (200, 2))
    points = lift(view.fragments, view.pixels[rig.mesh.faces], [str(k) for k in range(200)], pixels)
    seen = (points.barycentric[..., None] * view.pixels[rig.mesh.faces[points.faces]]).sum(1)
    off = np.linalg.norm(seen - pixels, axis=1)
    assert np.percentile(off, 80) < 0.01 and off.max() < 1.0  # at an edge of a triangle it stays inside


def test_the_rig_knows_its_own_landmarks():
    rig = blendcap.mannequin()  # the plain person is symmetric
    points = rig_landmarks(rig)
    assert set(points.names) == set(FEATURES) | {name for line in LINES for name in line_names(line)}
    where = dict(zip(points.names, points.positions(rig.mesh), strict=True))
    np.testing.assert_allclose(where["eye_outer_left"] * [-1, 1, 1], where["eye_outer_right"], atol=1e-6)
    assert where["eye_outer_left"][0] > 0 > where["eye_outer_right"][0]
    assert where["lip_top"][1] > where["lips_upper_5"][1] > where["lip_bottom"][1]
    for line in LINES:
        x = [where[name][0] for name in line_names(line)]
        assert (np.diff(x) > 0).all()
        steps = np.linalg.norm(np.diff([where[name] for name in line_names(line)], axis=0), axis=1)
        assert steps.max() < 1.4 * steps.min()
    mirrored = [where[f"lids_upper_right_{ON_A_LINE + 1 - k}"] for k in range(1, ON_A_LINE + 1)]
    own = [where[f"lids_upper_left_{k}"] for k in range(1, ON_A_LINE + 1)]
    np.testing.assert_allclose(np.array(own) * [-1, 1, 1], mirrored, atol=0.05)


def test_features_of_a_person_nobody_trained_on_are_found(rig, finding):
    truth = rig_landmarks(rig)
    where = dict(zip(truth.names, truth.positions(rig.mesh), strict=True))
    found = finding.points.positions(rig.mesh)
    assert set(FEATURES) <= set(finding.points.names)
    for name, place in zip(finding.points.names, found, strict=True):
        if name in FEATURES:
            assert np.linalg.norm(place - where[name]) < 4.0, name
    assert finding.converged


@pytest.mark.slow
def test_a_scan_without_a_face_is_refused():
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 25)[:-1], np.linspace(0, np.pi, 13))
    points = 100 * np.stack([np.sin(height) * np.cos(turn), np.cos(height), np.sin(height) * np.sin(turn)], -1)
    index = np.arange(13 * 24).reshape(13, 24)
    a, b = index[:-1], np.roll(index, -1, 1)[:-1]
    c, d = index[1:], np.roll(index, -1, 1)[1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])
    with pytest.raises(InputError, match="No face was found on the scan; give its landmarks in a file"):
        search_landmarks(Mesh(points.reshape(-1, 3), faces))


def test_the_way_in_uv_needs_a_texture(rig):
    mesh = rig.mesh
    with pytest.raises(InputError, match="no texture, in which"):
        blendcap.find_landmarks(Mesh(mesh.vertices, mesh.faces, uv=mesh.uv, uv_faces=mesh.uv_faces), method="uv")
    with pytest.raises(InputError, match="no texture coordinates, in which"):
        blendcap.find_landmarks(Mesh(mesh.vertices, mesh.faces), method="uv")
    with pytest.raises(InputError, match="called 'magic'; choose frontal or uv"):
        blendcap.find_landmarks(mesh, method="magic")


@pytest.mark.slow
def test_any_unit_and_any_way_up(rig, finding):
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # z up, as many scanners have it
    scan = rig.mesh.with_vertices(0.001 * rig.mesh.vertices @ turn.T + [0.3, -2, 1])
    points = blendcap.find_landmarks(scan)
    both = sorted(set(points.names) & set(finding.points.names))
    one, other = points.select(both).positions(rig.mesh), finding.points.select(both).positions(rig.mesh)
    assert np.median(np.linalg.norm(one - other, axis=1)) < 1.0


@pytest.mark.slow
def test_form_alone_finds_the_features_and_the_thesis_way_most_of_them(rig):
    truth = rig_landmarks(rig).select(list(FEATURES)).positions(rig.mesh)
    bare = Mesh(rig.mesh.vertices, rig.mesh.faces)
    errors = []
    for mesh, method in ((bare, "frontal"), (rig.mesh, "uv")):
        found = blendcap.find_landmarks(mesh, method=method).select(list(FEATURES)).positions(rig.mesh)
        errors.append(np.linalg.norm(found - truth, axis=1))
    assert np.percentile(errors[0], 90) < 6.0
    assert np.median(errors[1]) < 3.0


def test_a_pixel_that_looks_into_a_gap_moves_to_its_edge():
    depth = np.full((40, 60), 100.0)
    depth[20:22, 10:50] = 140.0  # a slit
    depth[:, 55:] = np.inf
    pixels = np.array([[30.0, 20.2], [30, 21], [30, 30.4], [52, 10]])
    np.testing.assert_allclose(out_of_gaps(depth, pixels), [[30, 19], [30, 22], [30, 30.4], [52, 10]])


@pytest.mark.parametrize(
    ("upper", "lower", "behind", "kept"),
    [
        (-8, -8, np.inf, False),  # both on the upper rim of an empty socket
        (8, 8, 60.0, False),
        (-8, 0, np.inf, False),  # one through the gap
        (-8, 0, 60.0, False),
        (-8, 8, np.inf, True),  # each on its own rim
        (-8, -8, 2.0, True),  # over an eyeball: nothing is known to be wrong
        (0, 0, 0.0, True),  # shut
        (-8, -6, np.inf, False),  # near each other
        (-7, -7, np.inf, False),  # a pixel inside of the rim
        (-7, 7, np.inf, True),
        (-4, 8, np.inf, False),  # beyond it
    ],
)
def test_lines_that_were_lost_in_a_gap_are_left_out(upper, lower, behind, kept):
    x, y = np.meshgrid(np.arange(120), np.arange(80))
    arch = np.clip(1 - ((x - 60) / 30) ** 2, 0, None)
    depth = np.where(np.abs(y - 40) < 8 * arch - 0.5, 100.0 + behind, 100.0) + 0.1 * (x - 30)  # one corner farther back
    assert len(without_lost(lid_lines(upper, lower), depth, 5.0)) == (2 if kept else 0)


def lid_lines(upper, lower):
    """The two lines of a lid, 60 pixels long, that rise and fall by so many pixels."""
    columns = np.arange(30, 91)
    rise = 1 - ((columns - 60) / 30) ** 2
    return {"lids_upper_left": np.stack([columns, 40 + upper * rise], 1),
            "lids_lower_left": np.stack([columns, 40 + lower * rise], 1)}  # fmt: skip


@pytest.mark.parametrize("back", [0.2, -0.2])
def test_a_lid_that_is_turned_away_is_no_gap(back):
    """Its far corner lies 12 mm behind the near one; a gap of 8 mm in its middle is one still."""
    x, y = np.meshgrid(np.arange(120), np.arange(80))
    turned = 100.0 + back * (x - 60) + 6
    gap = np.where((np.abs(x - 60) < 20) & (np.abs(y - 40) < 6), 8.0, 0.0)
    assert len(without_lost(lid_lines(0, 0), turned, 5.0)) == 2
    assert len(without_lost(lid_lines(-8, 0), turned + gap, 5.0)) == 0


@pytest.mark.parametrize(
    ("upper", "lower", "hole", "kept"),
    [
        (-6, 6, (slice(29, 33), slice(45, 76)), True),  # beside lids that are open
        (-2, 2, (slice(29, 33), slice(45, 76)), False),  # and beside lids that are taken to be shut
        (0, 0, (slice(29, 33), slice(45, 50)), True),  # beside a few pixels of them
        (-8, 0, (slice(34, 46), slice(50, 53)), True),  # on a tenth of a line
        (-8, 0, (slice(34, 46), slice(50, 60)), False),  # on a third of it
        (-8, 0, (slice(30, 50), [*range(30, 38), *range(83, 91)]), True),  # at its ends, where lids meet
    ],
)
def test_a_hole_counts_where_lids_are_looked_for(upper, lower, hole, kept):
    depth = np.full((80, 120), 100.0)
    depth[hole] = np.inf
    depth[40, [30, 90]] = 100.0  # the corners themselves are there
    assert len(without_lost(lid_lines(upper, lower), depth, 5.0)) == (2 if kept else 0)


@pytest.mark.slow
def test_an_empty_socket_is_not_a_shut_eye(data, rig):
    """The skin of ICT-FaceKit without its eyeballs: the lower line of one eye is found on the upper rim."""
    ict = blendcap.read_rig(data("rigs/ict_facekit.npz")).mesh
    skin = Mesh(ict.vertices, ict.faces[(ict.faces < 11248).all(1)])
    pairs, _ = find_pairs(skin, rig)
    assert pairs is not None and "eye_inner_right" in pairs[0].names
    assert not keep_eyes_open(rig, pairs).notes


def test_points_on_eyeballs_come_to_the_lids(rig, finding):
    from blendcap.modeling.landmarks import onto_skin

    on_globe = np.isin(rig.mesh.faces, rig.regions["eyes"]).all(1)
    assert not on_globe[finding.points.faces].any()
    ball = np.flatnonzero(on_globe)
    middles, lid = rig.mesh.vertices[rig.mesh.faces[ball]].mean(1), rig.mesh.vertices[rig.contacts["lids_left"][11, 1]]
    spots = [ball[np.linalg.norm(middles - lid, axis=1).argmin()], ball[middles[:, 2].argmin()]]
    points = SurfacePoints(("lid", "pole"), spots, [[0.2, 0.3, 0.5]] * 2)
    moved = onto_skin(rig.mesh, points, 4.0)
    before, after = points.positions(rig.mesh), moved.positions(rig.mesh)
    assert not on_globe[moved.faces[0]] and np.linalg.norm(after[0] - before[0]) < 4
    everywhere = rig.mesh.vertices[np.setdiff1d(np.arange(len(rig.mesh.vertices)), rig.regions["eyes"])]
    assert np.linalg.norm(after[0] - before[0]) <= np.linalg.norm(everywhere - before[0], axis=1).min() + 1e-9
    np.testing.assert_array_equal(after[1], before[1])  # nothing is near the back of an eyeball
    assert onto_skin(Mesh(rig.mesh.vertices, rig.mesh.faces[~on_globe]), points.select([]), 4.0).names == ()
