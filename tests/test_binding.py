"""Where markers end on the rig: recovered if it is the performer's own, kept if not, never across a slit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stage
from blendcap import InputError, MarkerTake, SurfacePoints, bind
from blendcap.markers import binding as binding_module
from blendcap.markers.binding import METHODS
from blendcap.markers.helmet import rigid_columns
from blendcap.markers.neighbors import candidates, seamless
from blendcap.markers.refinement import LASTING, MEDIAN, NEUTRAL_FRAMES, Places, algorithm_4, rest_shift
from blendcap.solving.rows import marker_rows
from blendcap.synthetic.performances import range_of_motion
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import choose_points, make_take
from sheet import SLIT_Y, sheet_rig

FLAWS = {"noise": 0.2, "misplacement": 1.5, "slip": (1.0, 1.0), "occlusion": 0.05}


def apart(points, others, rig):
    return np.linalg.norm(points.positions(rig.mesh) - others.positions(rig.mesh), axis=1)


@pytest.fixture(scope="module")
def rig():
    return sheet_rig()


@pytest.fixture(scope="module")
def given(rig):
    return choose_points(rig, 24, seed=1)


@pytest.fixture(scope="module")
def rom(rig, given):
    """A range of motion of the rig itself, with markers that are not quite where they were meant to be."""
    return make_take(make_performer(rig, seed=2, strength=0.0), range_of_motion(rig, 24.0), given, seed=3, **FLAWS)


@pytest.fixture(scope="module")
def bound(rig, given, rom):
    return bind(rig, rom[0], given, rom[0])


@pytest.mark.parametrize("method", ["weighed", "paper"])
def test_the_unit_of_the_weights_does_not_matter(rig, given, rom, bound, method):
    scale = np.resize([100.0, 0.5, 1.0], len(rig.names))
    other = replace(rig, deltas=rig.deltas / scale[:, None, None], bounds=rig.bounds * scale[:, None])
    same = bound if method == "weighed" else bind(rig, rom[0], given, rom[0], method=method)
    assert apart(bind(other, rom[0], given, rom[0], method=method).points, same.points, rig).max() < 1e-3


@pytest.fixture(scope="module")
def on_the_face():
    return make_take(stage.performer(0.0), stage.motion(), stage.markers(), seed=3, **FLAWS)


@pytest.mark.parametrize(("method", "most"), [("weighed", 0.3), ("paper", 0.5)])
def test_a_personal_rig_gets_its_places_back(on_the_face, method, most):
    take, truth = on_the_face
    rig, meant = stage.small_rig(), stage.markers()
    binding = bind(rig, take, meant, take, method=method)
    before, after = (np.sqrt((apart(p, truth.points, rig) ** 2).mean()) for p in (meant, binding.points))
    assert before > 1.4 and after < most
    assert np.abs(binding.rotation - np.eye(3)).max() < 5e-3 and binding.scale == pytest.approx(1, abs=5e-3)
    assert not binding.automatic


def test_the_rest_is_the_mean_of_all_frames_at_rest(on_the_face):
    """What ten frames of 0.2 mm of noise err goes to less than half, and every take of these markers gains by it."""
    take, truth = on_the_face
    rig, meant = stage.small_rig(), stage.markers()
    true, _ = rig.sample(truth.points)
    errors = []
    for method in ("given", "weighed"):
        binding = bind(rig, take, meant, take, method=method)
        rest = binding.to_take(rig.sample(binding.points)[0] + binding.offsets)
        errors.append(np.sqrt(((rest - true) ** 2).sum(1).mean()))
    assert errors[0] > 0.11 and errors[1] < 0.5 * errors[0]


def test_only_a_marker_that_rests_tells_its_rest():
    rng = np.random.default_rng(7)
    deltas, helmet = 5 + rng.random((2, 3, 3)), rng.normal(size=(1, 3, 3))
    deltas[0, 1:] = deltas[1, [0, 2]] = 0.0  # shape 0 moves marker 0, shape 1 marker 1, none marker 2
    unknowns = np.zeros((100, 3))
    unknowns[:20, 0] = unknowns[:80, 1] = 0.5
    unknowns[:, 2] = rng.normal(size=100)
    shift = rng.normal(scale=0.1, size=(3, 3))
    moved = np.tensordot(unknowns, np.concatenate([deltas, helmet]), 1) + shift
    moved[20:, 2] = np.nan
    rows = marker_rows(deltas, helmet, moved, np.tile([0.0, 1.0], (2, 1)), -1.0)
    told, noise = rest_shift(rows, unknowns, 0.2), 0.2**2
    may_err = MEDIAN * noise / NEUTRAL_FRAMES
    assert told[0] == pytest.approx(shift[0] * may_err / (may_err + noise / 80 + LASTING**2))
    assert not told[1:].any()  # marker 1 moves too often, marker 2 is seen too seldom
    assert np.abs(rest_shift(rows, unknowns, 0.01)).max() < 0.02 * np.abs(shift).max()  # what is sharp is right


@pytest.mark.parametrize(("motion", "rests"), [(0.2, True), (0.3, False)])
def test_a_marker_that_the_face_moves_by_a_quarter_of_a_millimeter_does_not_rest(motion, rests):
    unknowns, shift = np.ones((100, 1)), np.array([[0.1, -0.2, 0.05]])
    deltas = np.array([[[motion, 0.0, 0.0]]])
    rows = marker_rows(
        deltas, np.zeros((0, 1, 3)), np.tile(deltas[0] + shift, (100, 1, 1)), np.array([[0.0, 1.0]]), -1.0
    )
    assert rest_shift(rows, unknowns, 0.2).any() == rests


def test_a_generic_rig_is_bound_no_worse_than_given():
    rig, meant = stage.small_rig(), stage.markers()
    v = rig.mesh.vertices
    other = 0.05 * (v - v.mean(0)) * (1, -1, 1) + np.stack([np.sin(v[:, 1] / 30), np.cos(v[:, 0] / 25), 0 * v[:, 0]], 1)
    before, after = [], []
    for seed in range(4, 8):
        performer = make_performer(rig, seed=seed, identity=other)
        take, truth = make_take(performer, stage.motion(), meant, seed=seed + 1, **FLAWS)
        for errors, points in ((before, meant), (after, bind(rig, take, meant, take).points)):
            errors.append(np.sqrt((apart(points, truth.points, rig) ** 2).mean()))
    assert np.mean(after) < 1.05 * np.mean(before)
    assert np.max(np.array(after) / before) < 1.3  # one of four people is bound worse than by hand


def test_given_places_stay(rig, given, rom):
    binding = bind(rig, rom[0], given, rom[0], method="given")
    assert apart(binding.points, given, rig).max() < 1e-9 and len(binding.errors) == 0


def test_one_frame_of_the_neutral_is_enough(rig, given, rom):
    alone = replace(rom[0], positions=rom[0].positions[:1])
    binding = bind(rig, alone, given)
    assert np.allclose(binding.to_rig(alone.positions[0]), binding.points.positions(rig.mesh) + binding.offsets)


def test_offsets_close_the_gap_to_the_neutral(rig, bound, rom):
    neutral = np.nanmedian(rom[0].positions[:10], axis=0)
    rest = bound.points.positions(rig.mesh) + bound.offsets
    assert np.allclose(bound.to_rig(neutral), rest, atol=0.4)  # five times what ten frames of 0.2 mm of noise err
    assert np.abs(bound.to_take(bound.to_rig(neutral)) - neutral).max() < 1e-9


def test_algorithm_4_settles(rig, given, rom):
    errors = bind(rig, rom[0], given, rom[0], method="paper").errors
    steps = -np.diff(errors)
    assert 1 < len(errors) <= 10 and abs(steps[-1]) < 0.1 and (steps[:-1] >= 0.1).all()
    far = choose_points(rig, 24, seed=1)
    rng = np.random.default_rng(0)
    far = replace(far, barycentric=rng.dirichlet(np.ones(3), len(far.names)))
    assert bind(rig, rom[0], far, rom[0], method="paper").errors[-1] <= errors[0] * 1.5


def test_algorithm_4_looks_through_the_slip(rig, given):
    """A helmet that slips as far as the face moves leaves markers in their right places, with hardly an error."""
    weights = range_of_motion(rig, 24.0).weights[::24]
    slip = 0.5 * np.sin(np.linspace(0, 9, len(weights))[:, None] + np.arange(6))
    surface, deltas = rig.sample(given)
    positions = surface + np.tensordot(weights, deltas, 1) + np.tensordot(slip, rigid_columns(surface), 1)
    places = Places(rig, given.names, candidates(seamless(rig), given, 8.0, 40))
    points, _, errors = algorithm_4(places, given, MarkerTake(positions, given.names, 24.0), surface)
    assert errors[-1] < 0.1 and apart(points, given, rig).max() < 0.1


@pytest.mark.parametrize("method", METHODS)
def test_the_performers_space_does_not_matter(rig, given, rom, method):
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    positions = rom[0].positions.copy()
    positions[:15] = positions[0]  # the median of the neutral frames, taken by coordinate, would turn with the noise
    take = replace(rom[0], positions=positions)
    moved = replace(take, positions=positions @ turn.T * 1.25 + (300, -40, 1000))
    here, there = (bind(rig, t, given, t, method=method) for t in (take, moved))
    assert np.array_equal(here.points.faces, there.points.faces)
    assert apart(here.points, there.points, rig).max() < 1e-4
    assert there.scale == pytest.approx(here.scale / 1.25, rel=1e-6)
    assert np.allclose(there.to_rig(moved.positions[0]), here.to_rig(positions[0]), atol=1e-4)


def test_the_order_of_markers_does_not_matter(rig, given, rom, bound):
    order = [rom[0].names[i] for i in np.random.default_rng(0).permutation(24)]
    again = bind(rig, rom[0].select(order), given.select(order), rom[0].select(order[::-1]))
    assert again.points.names == tuple(order)
    assert apart(again.points.select(rom[0].names), bound.points, rig).max() < 1e-6


def test_markers_without_a_place_are_left_out(rig, given, rom, caplog):
    places = {name: {"face": int(f), "barycentric": b.tolist()}
              for name, f, b in zip(given.names[:20], given.faces, given.barycentric, strict=False)}  # fmt: skip
    binding = bind(rig, rom[0], places)
    assert binding.points.names == given.names[:20]
    assert "4 markers have no correspondence" in caplog.text


def test_a_marker_hidden_in_the_neutral_is_left_out(rig, given, rom, caplog):
    positions = rom[0].positions.copy()
    positions[:40, 3] = np.nan
    binding = bind(rig, replace(rom[0], positions=positions), given)
    assert "m03" not in binding.points.names and len(binding.points.names) == 23
    assert "not seen in the neutral" in caplog.text


def lips(rig):
    """Markers on both lips, a vertex pair apart at most: the pairs lie at the same place."""
    pairs = rig.contacts["lips"][2:-2:3]
    upper = SurfacePoints.at_vertices([f"u{i}" for i in range(len(pairs))], pairs[:, 0], rig.mesh)
    lower = SurfacePoints.at_vertices([f"l{i}" for i in range(len(pairs))], pairs[:, 1], rig.mesh)
    return upper, lower


def joined(*points):
    return SurfacePoints(sum((p.names for p in points), ()), np.concatenate([p.faces for p in points]),
                         np.concatenate([p.barycentric for p in points]))  # fmt: skip


@pytest.mark.parametrize("method", ["weighed", "paper"])
def test_no_marker_crosses_the_mouth(rig, given, method):
    """Given on the upper lip, really glued to the lower one: motion and neutral say cross, the slit forbids it."""
    upper, lower = lips(rig)
    rest = given.select([n for n, y in zip(given.names, given.positions(rig.mesh)[:, 1], strict=True) if y > 0])
    real = joined(rest, replace(lower, names=upper.names))
    take, _ = make_take(make_performer(rig, seed=2, strength=0.0), range_of_motion(rig, 24.0), real, seed=0,
                        noise=0.1, misplacement=0.0, slip=(0, 0), occlusion=0)  # fmt: skip
    faces = bind(rig, take, joined(rest, upper), take, method=method).points.select(upper.names).faces
    assert (rig.mesh.vertices[rig.mesh.faces[faces]][..., 1].mean(1) > SLIT_Y).all()
    honest = bind(rig, take, real, take, method=method).points.select(upper.names).faces
    assert (rig.mesh.vertices[rig.mesh.faces[honest]][..., 1].mean(1) < SLIT_Y).all()


def test_a_marker_stays_within_its_radius(rig, given, rom):
    near = bind(rig, rom[0], given, radius=1.0)
    assert apart(near.points, given, rig).max() < 1.0 + 4.0  # a triangle whose middle is near may reach farther
    own = bind(rig, rom[0], given, radius=0.0)
    assert np.array_equal(own.points.faces, given.faces)


@pytest.mark.slow
def test_places_can_be_found_without_a_table():
    rig = stage.small_rig()
    take, truth = make_take(stage.performer(0.0), stage.posed(jawOpen=0.5), stage.markers(), seed=1,
                            **{**FLAWS, "misplacement": 0.0})  # fmt: skip
    turn = Rotation.from_rotvec([0.2, 2.5, -0.3]).as_matrix()
    binding = bind(rig, replace(take, positions=take.positions @ turn.T + 500.0))
    assert binding.automatic and np.median(apart(binding.points, truth.points, rig)) < 2.0


def test_places_are_found_from_the_neutral_that_is_named(monkeypatch, rig, given, rom):
    """Finding itself is tested in test_places; here it only has to be told where the neutral begins."""
    told = []

    def found(rig, take, *, frame):
        told.append(frame)
        return given

    monkeypatch.setattr(binding_module, "find_places", found)
    assert bind(rig, rom[0], neutral=7).automatic and told == [7]


class TestRefusals:
    def test_an_unknown_method(self, rig, given, rom):
        with pytest.raises(InputError, match="method 'glue' is unknown"):
            bind(rig, rom[0], given, method="glue")

    def test_the_papers_binding_without_motion(self, rig, given, rom):
        with pytest.raises(InputError, match="needs a range-of-motion take"):
            bind(rig, rom[0], given, method="paper")

    def test_an_unknown_label(self, rig, given, rom):
        with pytest.raises(InputError, match="'nose'"):
            bind(rig, rom[0], {"nose": 4})
        with pytest.raises(InputError, match="'m00'"):
            bind(rig, rom[0].select(rom[0].names[1:]), given)

    @pytest.mark.parametrize("method", ["weighed", "given", "paper"])
    def test_points_of_another_mesh(self, rig, given, rom, method):
        other = SurfacePoints(given.names, given.faces + len(rig.mesh.faces), given.barycentric)
        with pytest.raises(InputError, match="belong to another mesh"):
            bind(rig, rom[0], other, rom[0], method=method)

    def test_a_marker_that_is_never_seen(self, rig, given, rom):
        positions = rom[0].positions.copy()
        positions[:, 5] = np.nan
        with pytest.raises(InputError, match="'m05' is missing in every frame"):
            bind(rig, replace(rom[0], positions=positions), given)

    def test_too_few_markers(self, rig, given, rom):
        names = given.names[:3]
        with pytest.raises(InputError, match="Only 3 markers"):
            bind(rig, rom[0], given.select(names))

    def test_no_neutral(self, rig, given, rom):
        with pytest.raises(InputError, match="begin at frame 9999"):
            bind(rig, rom[0], given, neutral=9999)

    def test_markers_on_a_line(self, rig):
        middle = np.flatnonzero((np.abs(rig.mesh.vertices[:, 0]) < 1) & (rig.mesh.vertices[:, 1] > 0))[:6]
        points = SurfacePoints.at_vertices([f"p{i}" for i in range(6)], middle, rig.mesh)
        take = MarkerTake(np.tile(points.positions(rig.mesh), (20, 1, 1)), points.names, 60.0)
        with pytest.raises(InputError, match="line"):
            bind(rig, take, points)

    def test_another_body_and_another_unit(self, rig, given, rom):
        """Exchanged labels do not fit; where they are ten times as far apart too, the unit is named first."""
        mixed = replace(rom[0], positions=rom[0].positions[:, np.random.default_rng(3).permutation(len(given.names))])
        with pytest.raises(InputError, match=r"lie more than .* mm off their places"):
            bind(rig, mixed, given, method="given")
        with pytest.raises(InputError, match=r"times as large as the rig .* say the unit"):
            bind(rig, replace(mixed, positions=40 * mixed.positions), given, method="given")
