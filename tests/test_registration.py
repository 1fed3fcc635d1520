"""Non-rigid registration: closed forms, invariances, the dense normal equations, and truths that come back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

import blendcap
import masks
from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.modeling import nonrigid, template
from blendcap.modeling.affine import AffineField
from blendcap.modeling.matching import ScanSurface
from blendcap.modeling.nonrigid import fit_skin
from blendcap.modeling.registration import register
from blendcap.modeling.schedule import SCHEDULES
from blendcap.modeling.template import find_skin
from blendcap.numerics.similarity import apply
from blendcap.numerics.surfaces import edges_of, turned_over

OTHER = {"width": 78.0, "nose": 14.0, "chin": -12.0}
TEMPLATE, PARAMETERS = masks.template()


def error(registration, **shape):
    return np.linalg.norm(registration.mesh.vertices - masks.mask(PARAMETERS, **shape), axis=1)


def inside(margin=0.8):
    return (np.abs(PARAMETERS) < margin).all(1)


@pytest.mark.parametrize("method", ["even", "paper"])
def test_a_scan_that_is_the_template_leaves_it_as_it_is(method):
    # the paper matches vertices, which are the scan's own here
    result = register(TEMPLATE, TEMPLATE, masks.landmarks(TEMPLATE, PARAMETERS), method=method)
    np.testing.assert_allclose(result.mesh.vertices, TEMPLATE.vertices, atol=1e-6)
    assert all(energy.max() < 1e-10 for energy in result.energies.values())
    assert all(level.converged and level.residual < 1e-10 for level in result.levels)
    assert not len(result.flipped)


def test_another_face_is_recovered_vertex_by_vertex():
    scan, pairs = masks.scan(noise=0.1, **OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    result = register(TEMPLATE, scan, pairs)
    missed = error(result, **OTHER)
    before = np.linalg.norm(apply(TEMPLATE.vertices, *result.alignment) - masks.mask(PARAMETERS, **OTHER), axis=1)
    assert missed[inside()].mean() < 0.4 * before[inside()].mean()
    assert missed[inside()].mean() < 1.1
    assert np.nanmedian(result.distance) < 0.1
    assert not len(result.flipped)
    for level, alpha in zip(result.levels, SCHEDULES["even"].stiffness, strict=True):
        assert level.stiffness == alpha and level.residual < 1e-10 and 1 <= level.steps <= 15
    assert (np.diff(result.energies["data"]) < 0).all()  # softer lies closer, and bends more
    assert (np.diff(result.energies["stiffness"]) > 0).all()


def test_a_similarity_of_the_scan_moves_the_answer_with_it():
    scan, (points, places) = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    motion = (Rotation.from_rotvec([0.4, -1.1, 0.3]).as_matrix(), np.array([300.0, -20, 50]), np.float64(2.5))
    plain = register(TEMPLATE, scan, (points, places))
    moved = register(TEMPLATE, scan.with_vertices(apply(scan.vertices, *motion)), (points, apply(places, *motion)))
    np.testing.assert_allclose(moved.mesh.vertices, apply(plain.mesh.vertices, *motion), atol=1e-6)
    np.testing.assert_allclose(moved.energies["data"], 2.5**2 * plain.energies["data"], rtol=1e-6)
    np.testing.assert_allclose(moved.distance, 2.5 * plain.distance, atol=1e-6)


def test_backends_agree():
    pytest.importorskip("cvxopt")
    scan, pairs = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    answers = [register(TEMPLATE, scan, pairs, backend=name) for name in ("splu", "cholmod")]
    np.testing.assert_allclose(answers[0].mesh.vertices, answers[1].mesh.vertices, atol=1e-6)


def test_a_hole_is_bridged_by_stiffness():
    scan = masks.scan(hole=(0.45, 0.4, 0.2), **OTHER)
    result = register(TEMPLATE, scan, masks.landmarks(TEMPLATE, PARAMETERS, **OTHER))
    hole = np.hypot(PARAMETERS[:, 0] - 0.45, PARAMETERS[:, 1] - 0.4) < 0.17
    assert hole.sum() > 10
    assert np.isnan(result.distance[hole]).mean() > 0.9  # no vertex inside believes a match on the rim
    assert error(result, **OTHER)[hole].mean() < 2.0
    assert not len(result.flipped)


def test_the_order_of_the_scan_does_not_matter():
    pairs, scan = masks.landmarks(TEMPLATE, PARAMETERS, **OTHER), masks.scan(**OTHER)
    order = np.random.default_rng(5).permutation(len(scan.vertices))
    shuffled = Mesh(scan.vertices[order], np.argsort(order)[scan.faces][::-1])
    first, second = register(TEMPLATE, scan, pairs), register(TEMPLATE, shuffled, pairs)
    np.testing.assert_allclose(first.mesh.vertices, second.mesh.vertices, atol=1e-5)


def test_without_landmarks_the_shape_aligns():
    turn = (Rotation.from_rotvec([0.1, 0.15, -0.1]).as_matrix(), np.array([200.0, 80, -300]), np.float64(1.0))
    scan = masks.scan(**OTHER)
    result = register(TEMPLATE, scan.with_vertices(apply(scan.vertices, *turn)))
    missed = np.linalg.norm(result.mesh.vertices - apply(masks.mask(PARAMETERS, **OTHER), *turn), axis=1)
    assert missed[inside()].mean() < 4.0


def test_one_solve_is_the_dense_least_squares_of_equation_7():
    parameters, faces = masks.sheet(5, 6)
    vertices, rng = masks.mask(parameters) / 200, np.random.default_rng(0)
    edges, count = edges_of(faces)[0], len(vertices)
    lengths, weights = rng.uniform(0.5, 2, len(edges)), rng.uniform(0.1, 1, count)
    targets, held = rng.normal(size=(count, 3)), rng.normal(size=(2, 3))
    sampling = sparse.csr_matrix(([0.2, 0.3, 0.5, 1.0], ([0, 0, 0, 1], [*faces[7], 3])), shape=(2, count))
    field = AffineField(vertices, edges, lengths, sampling, "splu")
    answer = field.solve(2.0, weights, targets, 3.0, held)
    incidence, place = np.zeros((len(edges), count)), np.zeros((count, 4 * count))
    for row, (i, j) in enumerate(edges):
        incidence[row, i], incidence[row, j] = -1, 1
    for i in range(count):
        place[i, 4 * i : 4 * i + 4] = [*vertices[i], 1]
    stacked = np.vstack([2 * np.sqrt(np.repeat(lengths, 4))[:, None] * np.kron(incidence, np.eye(4)),
                         np.sqrt(weights)[:, None] * place, 3 * sampling.toarray() @ place])  # fmt: skip
    target = np.vstack([np.zeros((4 * len(edges), 3)), np.sqrt(weights)[:, None] * targets, 3 * held])
    dense = np.linalg.lstsq(stacked, target, rcond=None)[0]
    np.testing.assert_allclose(answer, dense, atol=1e-6)
    assert field.residual < 1e-12
    costs = field.energies(answer, weights, targets, held)
    total = 4 * costs["stiffness"] + costs["data"] + 9 * costs["landmarks"]
    assert total == pytest.approx(((stacked @ answer - target) ** 2).sum())
    np.testing.assert_allclose(field.moved(field.identity), vertices)


def test_closest_points_are_those_of_another_library():
    trimesh = pytest.importorskip("trimesh")
    scan = masks.scan()
    some = np.random.default_rng(0).permutation(len(scan.faces))[:300]
    surface = ScanSurface(scan.vertices, scan.faces[some])
    places = np.random.default_rng(1).normal(0, 60, (50, 3))
    points, distance, faces = surface.closest(places)
    triangles = scan.vertices[scan.faces[some]]
    for place, point, far, face in zip(places, points, distance, faces, strict=True):
        every = trimesh.triangles.closest_point(triangles, np.tile(place, (len(some), 1)))
        there = np.linalg.norm(every - place, axis=1)
        assert far == pytest.approx(there.min(), abs=1e-9)
        np.testing.assert_allclose(point, every[there.argmin()], atol=1e-7)
        assert there[face] == pytest.approx(there.min(), abs=1e-9)


def with_ball(mesh, center, radius):
    ball = pytest.importorskip("trimesh").creation.icosphere(2, radius)
    vertices = np.concatenate([mesh.vertices, ball.vertices + center])
    return Mesh(vertices, np.concatenate([mesh.faces, ball.faces + len(mesh.vertices)])), len(ball.vertices)


def test_an_eyeball_stays_a_ball_and_moves_with_the_face():
    whole, count = with_ball(TEMPLATE, (30.0, 38.0, 30.0), 11.0)
    result = register(whole, masks.scan(**OTHER), masks.landmarks(whole, PARAMETERS, **OTHER))
    ball = result.mesh.vertices[-count:]
    away = np.linalg.norm(ball - ball.mean(0), axis=1)
    assert np.ptp(away) < 1e-6 * away.mean()
    assert away.mean() == pytest.approx(11, rel=0.25)
    depth = masks.mask(np.array([[30 / 70, 0.4]]), **OTHER)[0]
    assert np.linalg.norm(ball.mean(0) - (depth - [0, 0, depth[2] - 0])[:3] * [1, 1, 0] - [0, 0, 30]) < 8
    assert np.isnan(result.distance[-count:]).all()


def test_a_seam_of_the_texture_stays_closed():
    left = TEMPLATE.vertices[TEMPLATE.faces].mean(1)[:, 0] < 0
    twin = np.arange(len(TEMPLATE.vertices))
    on_seam = np.intersect1d(TEMPLATE.faces[left], TEMPLATE.faces[~left])
    twin[on_seam] = len(twin) + np.arange(len(on_seam))
    faces = np.where(left[:, None], twin[TEMPLATE.faces], TEMPLATE.faces)
    cut = Mesh(np.concatenate([TEMPLATE.vertices, TEMPLATE.vertices[on_seam]]), faces)
    scan, pairs = masks.scan(**OTHER), masks.landmarks(cut, PARAMETERS, **OTHER)
    whole, result = register(TEMPLATE, scan, masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)), register(cut, scan, pairs)
    np.testing.assert_array_equal(result.mesh.vertices[len(twin) :], result.mesh.vertices[on_seam])
    np.testing.assert_allclose(result.mesh.vertices[: len(twin)], whole.mesh.vertices, atol=1e-5)


def test_landmarks_off_the_scan_are_left_out():
    scan, (points, places) = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    lost = places.copy()
    lost[3] = np.nan
    kept = [n for i, n in enumerate(points.names) if i != 3]
    first = register(TEMPLATE, scan, (points, lost))
    second = register(TEMPLATE, scan, (points.select(kept), np.delete(places, 3, 0)))
    np.testing.assert_allclose(first.mesh.vertices, second.mesh.vertices, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p, x: (p, x[:5]), "12 landmarks on the template, but their positions have the shape"),
        (lambda p, x: (p, x * np.nan), "Only 0 landmarks have a position"),
        (lambda p, x: (p, x + 900), "Only 0 of [0-9]+ template vertices find a place on the scan"),
        (lambda p, x: (p, x[::-1]), "do not fit the template: 9 of 12 lie far from where the others put them, as p1 "),
    ],
)
def test_landmarks_that_do_not_fit_are_refused(change, words):
    points, places = masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    with pytest.raises(InputError, match=words):
        register(TEMPLATE, masks.scan(**OTHER), change(points, places))


def test_what_cannot_be_registered_is_said():
    scan = masks.scan(**OTHER)
    inward = Mesh(scan.vertices, scan.faces[:, ::-1])
    with pytest.raises(InputError, match="turn its normals outwards"):
        register(TEMPLATE, inward, masks.landmarks(TEMPLATE, PARAMETERS, **OTHER))
    with pytest.raises(InputError, match="choose one of even, paper"):
        register(TEMPLATE, scan, method="magic")
    with pytest.raises(InputError, match="no triangles"):
        register(TEMPLATE, Mesh(scan.vertices, np.zeros((0, 3), int)))


def test_a_rig_is_laid_down_by_its_neutral():
    rig = Rig(TEMPLATE, np.zeros((1, len(TEMPLATE.vertices), 3), np.float32), ("still",))
    scan, pairs = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    np.testing.assert_array_equal(register(rig, scan, pairs).mesh.vertices,
                                  register(TEMPLATE, scan, pairs).mesh.vertices)  # fmt: skip


def slit():
    """The template with a mouth: a row of vertices doubled, the lower lip moved by the one shape."""
    on_line = np.abs(PARAMETERS[:, 1] - PARAMETERS[np.argmin(np.abs(PARAMETERS[:, 1] + 0.5)), 1]) < 1e-9
    upper = np.flatnonzero(on_line & (np.abs(PARAMETERS[:, 0]) < 0.45))
    lower = len(PARAMETERS) + np.arange(len(upper))
    below = TEMPLATE.vertices[TEMPLATE.faces].mean(1)[:, 1] < TEMPLATE.vertices[upper[0], 1]
    twin = np.arange(len(PARAMETERS))
    twin[upper] = lower
    faces = np.where(below[:, None], twin[TEMPLATE.faces], TEMPLATE.faces)
    mesh = Mesh(np.concatenate([TEMPLATE.vertices, TEMPLATE.vertices[upper]]), faces)
    drop = np.zeros((1, len(mesh.vertices), 3), np.float32)
    drop[0, lower[1:-1], 1] = -10
    return mesh, drop, np.stack([upper, lower], 1)[1:-1]


def test_lips_that_touch_stay_together_where_landmarks_tear_at_them():
    mesh, drop, pairs = slit()
    closed = Rig(mesh, drop, ("jawOpen",), contacts={"lips": pairs})
    middle = pairs[len(pairs) // 2]
    points, places = masks.landmarks(mesh, PARAMETERS)
    torn = SurfacePoints.at_vertices(["up", "down"], middle, mesh)
    points = SurfacePoints((*points.names, "up", "down"), np.r_[points.faces, torn.faces],
                           np.r_[points.barycentric, torn.barycentric])  # fmt: skip
    places = np.r_[places, mesh.vertices[middle] + [[0, 2.5, 0], [0, -2.5, 0]]]
    gaps = []
    for rig in (closed, Rig(mesh, drop, ("jawOpen",), contacts={"lids_left": pairs[:0]})):
        lips = register(rig, TEMPLATE, (points, places)).mesh.vertices[pairs]
        gaps.append(np.linalg.norm(lips[:, 0] - lips[:, 1], axis=1).max())
    assert gaps[0] < 0.35 * gaps[1] and gaps[1] > 0.5


def test_acceleration_ends_where_the_plain_iteration_ends():
    scan, pairs = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    patient = replace(SCHEDULES["even"], stiffness=(2.6,), landmarks=(2.0,), tolerance=1e-5, steps=150)
    fast = register(TEMPLATE, scan, pairs, method=patient)
    slow = register(TEMPLATE, scan, pairs, method=replace(patient, memory=0))
    assert np.abs(fast.mesh.vertices - slow.mesh.vertices).mean() < 0.05
    assert sum(level.steps for level in fast.levels) < 0.5 * sum(level.steps for level in slow.levels)


def test_a_template_and_a_scan_that_lack_different_parts():
    """The chin is not in the template, the forehead not in the scan: what both have is found, the rest is told."""
    scan, pairs = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    low = np.quantile(scan.vertices[:, 1], 0.7)
    cut = Mesh(scan.vertices, scan.faces[(scan.vertices[scan.faces, 1] < low).all(1)])
    half = Mesh(TEMPLATE.vertices, TEMPLATE.faces[(PARAMETERS[TEMPLATE.faces, 1] > -0.6).all(1)])
    points, places = pairs
    face = np.array([np.flatnonzero((half.faces == TEMPLATE.faces[f][np.argmax(w)]).any(1))[:1] for f, w in zip(
        points.faces, points.barycentric, strict=True)], dtype=object)  # fmt: skip
    kept = [k for k, found in enumerate(face) if len(found) and places[k, 1] < low]
    rows = [int(TEMPLATE.faces[points.faces[k]][np.argmax(points.barycentric[k])]) for k in kept]
    ours = SurfacePoints.at_vertices([str(k) for k in kept], rows, half)
    answer = register(half, cut, (ours, places[kept]))
    truth = masks.mask(PARAMETERS, **OTHER)
    used = np.isin(np.arange(len(truth)), half.faces)
    both = used & inside() & (truth[:, 1] < low - 10)
    assert error(answer, **OTHER)[both].mean() < 1.5
    assert np.isnan(answer.distance[used & (truth[:, 1] > low + 15)]).all()
    assert np.isfinite(answer.distance[both]).mean() > 0.9
    assert not len(answer.flipped) and answer.levels[-1].matched < 0.8


@pytest.mark.slow
def test_nearer_to_the_truth_than_another_library_where_the_scan_has_a_hole():
    """trimesh's nricp_amberg with its best steps. On a whole scan of so smooth a face its softer end lies nearer."""
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("rtree")  # trimesh's closest points
    from trimesh.registration import nricp_amberg

    scan = masks.scan(noise=0.1, hole=(0.3, 0.1, 0.25), **OTHER)
    points, places = masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    ours = register(TEMPLATE, scan, (points, places))
    start = apply(TEMPLATE.vertices, *ours.alignment)
    theirs = nricp_amberg(
        *(trimesh.Trimesh(v, f, process=False) for v, f in ((start, TEMPLATE.faces), (scan.vertices, scan.faces))),
        source_landmarks=np.argmax(points.matrix(TEMPLATE).toarray(), axis=1), target_positions=places,
        steps=[[0.1, 10, 0.5, 10], [0.05, 5, 0.5, 10], [0.02, 2, 0.5, 10], [0.01, 0.5, 0.5, 10], [0.005, 0, 0.5, 10]],
        distance_threshold=0.05,
    )  # fmt: skip
    missed = [np.linalg.norm(v - masks.mask(PARAMETERS, **OTHER), axis=1) for v in (ours.mesh.vertices, theirs)]
    hole = np.hypot(*(PARAMETERS - [0.3, 0.1]).T) < 0.25
    assert missed[0].mean() < missed[1].mean()
    assert missed[0][hole].mean() < 0.6 * missed[1][hole].mean()
    assert len(ours.flipped) <= turned_over(theirs, TEMPLATE.faces).sum()


def test_a_fold_is_seen():
    vertices = TEMPLATE.vertices.copy()
    middle = int(np.argmin((PARAMETERS**2).sum(1)))
    assert not turned_over(vertices, TEMPLATE.faces).any()
    vertices[middle, 0] += 3 * 70 * 2 / 20  # over its neighbours
    assert turned_over(vertices, TEMPLATE.faces).any()


def test_matches_that_fold_the_skin_are_dropped(monkeypatch):
    """Every vertex is drawn to where it is but one, which is drawn over its neighbours."""
    odd = int(np.argmin((PARAMETERS**2).sum(1)))
    targets = TEMPLATE.vertices.copy()
    targets[odd, 0] += 25

    class Surface:
        def closest(self, places):
            return targets, np.linalg.norm(places - targets, axis=1), np.zeros(len(places), np.int64)

        def believable(self, faces, *_):
            return np.ones(len(faces), dtype=bool)

    skin = find_skin(TEMPLATE)
    soft = replace(SCHEDULES["even"], stiffness=(0.1,), landmarks=(0.0,))
    nothing = sparse.csr_matrix((0, len(targets))), np.zeros((0, 3))
    given = TEMPLATE.vertices, skin, Surface(), *nothing, soft, "auto", None
    fit = fit_skin(*given)
    assert not turned_over(fit.vertices, skin.faces).any()
    assert np.isnan(fit.distance[odd]) and 0.9 < np.isfinite(fit.distance).mean() < 1
    monkeypatch.setattr("blendcap.modeling.nonrigid.UNFOLD", 0)
    assert turned_over(fit_skin(*given).vertices, skin.faces).any()


@pytest.mark.slow
def test_a_mannequin_of_another_person_comes_back():
    """The scan has another net of triangles; the truth is known vertex by vertex."""
    igl = pytest.importorskip("igl")
    rig, person = blendcap.mannequin(), blendcap.mannequin(identity=5)
    piece = igl.facet_components(person.mesh.faces)[1]
    skin = person.mesh.faces[piece == np.bincount(piece).argmax()]
    fine, faces = igl.upsample(person.mesh.vertices, skin, 1)
    coarse = igl.decimate(fine, faces, 40000)
    points = rig.points["landmarks68"].select([str(i) for i in range(17, 68)])
    result = register(rig, Mesh(coarse[0], coarse[1]), (points, points.positions(person.mesh)))
    missed = np.linalg.norm(result.mesh.vertices - person.mesh.vertices, axis=1)
    before = np.linalg.norm(apply(rig.mesh.vertices, *result.alignment) - person.mesh.vertices, axis=1)
    face = np.unique(np.concatenate([rig.regions[n] for n in ("forehead", "nose", "cheeks", "lips", "jaw", "brows")]))
    assert missed[face].mean() < 0.5 * before[face].mean()
    assert missed[face].mean() < 1.5
    assert np.nanmedian(result.distance[face]) < 0.25
    for name in ("eyes", "teeth"):
        assert missed[rig.regions[name]].mean() < 2.5
    assert isinstance(points, SurfacePoints)


class Flickering:
    """A scan that draws one vertex aside in some steps only, and the others at once or bit by bit."""

    def __init__(self, seen, share=1.0):
        self.odd = int(np.argmin((PARAMETERS**2).sum(1)))
        self.targets = TEMPLATE.vertices + np.array([0, 0, 15.0]) * (PARAMETERS[:, :1] > 0.5)
        self.targets[self.odd, 2] += 8
        self.calls, self.seen, self.share = 0, seen, share

    def closest(self, places):
        targets = places + self.share * (self.targets - places)
        return targets, np.linalg.norm(places - targets, axis=1), np.zeros(len(places), np.int64)

    def believable(self, faces, *_):
        self.calls += 1
        assert self.calls < 100
        return (np.arange(len(faces)) != self.odd) | self.seen(self.calls)

    def fit(self):
        soft = replace(SCHEDULES["even"], stiffness=(0.1,), landmarks=(0.0,), memory=0, tolerance=2e-5)
        nothing = sparse.csr_matrix((0, len(self.targets))), np.zeros((0, 3))
        fit = fit_skin(TEMPLATE.vertices, find_skin(TEMPLATE), self, *nothing, soft, "auto", None)
        return fit.levels[0], float(np.linalg.norm(fit.vertices[self.odd] - TEMPLATE.vertices[self.odd]))


def test_a_match_that_comes_and_goes_is_given_up(monkeypatch):
    """As at an ear: every second step draws the vertex aside. The level settles all the same, without it."""
    level, moved = Flickering(lambda call: call % 2 == 1).fit()
    assert level.converged and moved < 1
    monkeypatch.setattr("blendcap.modeling.nonrigid.PATIENCE", 10**9)
    level, _ = Flickering(lambda call: call % 2 == 1).fit()
    assert not level.converged and level.steps == SCHEDULES["even"].steps and level.change > 0.1


def test_a_match_that_comes_late_is_believed():
    """While the template is still on its way, what has no match yet may find one."""
    level, moved = Flickering(lambda call: call > 5, share=0.5).fit()
    assert level.converged and moved > 6


def test_a_template_that_would_slide_over_the_end_of_a_scan_stops():
    """Half of the face is in the scan. Nobody would ask for so fine a tolerance; hair and clothes do the same."""
    scan, (points, places) = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    low, fine = np.median(scan.vertices[:, 1]), replace(SCHEDULES["even"], tolerance=1e-6)
    cut = Mesh(scan.vertices, scan.faces[(scan.vertices[scan.faces, 1] > low).all(1)])
    kept = np.flatnonzero(places[:, 1] > low)
    pairs = points.select([points.names[k] for k in kept]), places[kept]
    there = masks.mask(PARAMETERS, **OTHER)[:, 1] > low
    stopped, slid = (error(register(TEMPLATE, cut, pairs, method=method), **OTHER)[there].mean()
                     for method in (fine, replace(fine, steps=200)))  # fmt: skip
    assert stopped < 0.85 * slid


def test_folded_skin_is_made_firmer(monkeypatch):
    """Nine landmarks turn a piece of skin over; dropping the matches around does not mend that."""
    piece = np.flatnonzero((np.abs(PARAMETERS) < 0.12).all(1))
    count = len(piece), len(PARAMETERS)
    held = sparse.csr_matrix((np.ones(len(piece)), (np.arange(len(piece)), piece)), shape=count)
    soft, skin = replace(SCHEDULES["even"], stiffness=(0.1,), landmarks=(3.0,)), find_skin(TEMPLATE)
    folds = []
    for firmer in (nonrigid.FIRMER, 1.0):
        monkeypatch.setattr(nonrigid, "FIRMER", firmer)
        fit = fit_skin(TEMPLATE.vertices, skin, ScanSurface(TEMPLATE.vertices, TEMPLATE.faces), held,
                       TEMPLATE.vertices[piece] * [-1.0, 1.0, 1.0], soft, "auto", None)  # fmt: skip
        folds.append(int(turned_over(fit.vertices, skin.faces).sum()))
    assert folds[0] == 0 < folds[1]


def test_free_vertices_are_not_drawn_to_the_scan():
    scan, pairs = masks.scan(**OTHER), masks.landmarks(TEMPLATE, PARAMETERS, **OTHER)
    free = np.flatnonzero(np.hypot(PARAMETERS[:, 0] - 0.45, PARAMETERS[:, 1] - 0.4) < 0.2)
    result = register(TEMPLATE, scan, pairs, free=free)
    assert np.isnan(result.distance[free]).all()
    others = np.setdiff1d(np.flatnonzero(inside()), free)
    assert np.isfinite(result.distance[others]).mean() > 0.95
    assert error(result, **OTHER)[free].mean() < 2.5  # they follow
    for wrong in ([-1], [len(TEMPLATE.vertices)], [0.5], [[1]]):
        with pytest.raises(InputError, match="free vertices"):
            register(TEMPLATE, scan, pairs, free=wrong)


@pytest.mark.parametrize(("outside", "joined"), [(True, True), (False, False)])
def test_two_sides_are_joined_through_flesh_but_not_through_air(outside, joined):
    parameters, faces = masks.sheet(9, 9)
    flat = np.column_stack([50 * parameters, np.ones(len(parameters))])
    lower = flat * [1, 1, -1]
    a, b, c = flat[faces[0]]
    up, down = (faces, faces[:, ::-1]) if (np.cross(b - a, c - a)[2] > 0) == outside else (faces[:, ::-1], faces)
    vertices, both = np.concatenate([flat, lower]), np.concatenate([up, down + len(flat)])
    seen = np.arange(len(vertices)) < len(flat)
    pairs = template._walls(vertices, both, seen)
    expected = np.stack([np.arange(len(flat)) + len(flat), np.arange(len(flat))], axis=1)
    np.testing.assert_array_equal(pairs, expected if joined else np.zeros((0, 2)))
