"""The records: every refusal with its exact sentence, and what they promise when they accept."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blendcap import (
    Animation,
    Binding,
    Camera,
    Certificate,
    InputError,
    LandmarkTake,
    MarkerTake,
    Mesh,
    Rig,
    Solution,
    SurfacePoints,
)
from blendcap.data import triangulate

NAN, INF = np.nan, np.inf
VERTICES = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def mesh(**changes) -> Mesh:
    return Mesh(**{"vertices": VERTICES, "faces": FACES, **changes})


def rig(**changes) -> Rig:
    deltas = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    return Rig(**{"mesh": mesh(), "deltas": deltas, "names": ("smileLeft", "smileRight"), "name": "toy", **changes})


def points(**changes) -> SurfacePoints:
    given = {"names": ("a", "b"), "faces": [0, 1], "barycentric": [[1, 0, 0], [0.2, 0.3, 0.5]]}
    return SurfacePoints(**{**given, **changes})


def take(**changes) -> MarkerTake:
    return MarkerTake(**{"positions": np.zeros((3, 2, 3)), "names": ("a", "b"), "rate": 60.0, **changes})


def animation(**changes) -> Animation:
    return Animation(**{"weights": np.zeros((3, 2)), "names": ("smileLeft", "smileRight"), "rate": 30.0, **changes})


def binding(**changes) -> Binding:
    given = {"points": points(), "rotation": np.eye(3), "translation": np.zeros(3), "scale": 1.0}
    return Binding(**{**given, "offsets": np.zeros((2, 3)), "errors": [], **changes})


def camera(**changes) -> Camera:
    return Camera(**{"intrinsics": np.eye(3), "pose": np.eye(4), **changes})


def landmarks(**changes) -> LandmarkTake:
    return LandmarkTake(**{"points": np.zeros((3, 2, 2)), "names": ("a", "b"), "rate": 30.0, **changes})


def with_value(shape, place, value):
    array = np.zeros(shape)
    array[place] = value
    return array


REFUSALS = [
    # what every array is asked
    (mesh, {"vertices": np.zeros((4, 2))}, "The mesh's vertices must have the shape (any, 3), but has (4, 2)."),
    (mesh, {"vertices": np.zeros(3)}, "The mesh's vertices must have the shape (any, 3), but has (3,)."),
    (mesh, {"vertices": with_value((4, 3), (2, 1), NAN)},
     "The mesh's vertices holds a NaN or an infinite number, first at [2, 1]; remove or repair it."),
    (mesh, {"vertices": with_value((4, 3), (3, 0), -INF)},
     "The mesh's vertices holds a NaN or an infinite number, first at [3, 0]; remove or repair it."),
    # mesh
    (mesh, {"faces": [[0, 1, 4]]}, "The mesh's faces names vertex 4, but there are 4 (0 to 3)."),
    (mesh, {"faces": [[0, -1, 2]]}, "The mesh's faces names vertex -1, but vertex numbers begin at 0."),
    (mesh, {"faces": [[0.0, 1.0, 2.0]]},
     "The mesh's faces must be whole numbers (indices of vertex), but are float64."),
    (mesh, {"faces": [[0, 1, 2, 3]]}, "The mesh's faces must have the shape (any, 3), but has (1, 4)."),
    (mesh, {"polygons": [[0, 1, 2, 4]]},
     "The mesh's polygons need 3 or more corners, each one of its 4 vertices (-1 pads)."),
    (mesh, {"polygons": [[0, 1, -2, 3]]},
     "The mesh's polygons need 3 or more corners, each one of its 4 vertices (-1 pads)."),
    (mesh, {"polygons": [[0, 1, -1, -1]]},
     "The mesh's polygons need 3 or more corners, each one of its 4 vertices (-1 pads)."),
    (mesh, {"polygons": [[0, 1, 2, -1]]},
     "The mesh's polygons make 1 triangles, but it has 2 faces; use triangulate()."),
    (mesh, {"uv": np.zeros((3, 2))},
     "The mesh has 3 uv rows for 4 vertices; give uv_faces to say which corner uses which row."),
    (mesh, {"uv": np.zeros((3, 2)), "uv_faces": [[0, 1, 2], [0, 2, 3]]},
     "The mesh's uv_faces names uv row 3, but there are 3 (0 to 2)."),
    (mesh, {"uv_faces": FACES}, "The mesh has uv_faces but no uv; give both or neither."),
    (mesh, {"texture": np.zeros((2, 2), np.uint8)},
     "The mesh's texture must have the shape (any, any, any), but has (2, 2)."),
    # points on a surface
    (points, {"names": ("a", "a")}, "The points' names has 'a' 2 times; every name must be used once."),
    (points, {"names": ("a", "")}, "The points' names has an empty name at place 1; give it one."),
    (points, {"names": "ab"}, "The points' names must be a sequence of names, but is the one string 'ab'."),
    (points, {"names": None}, "The points' names must be a sequence of names, but is None; leave it out if there is "
     "none."),
    (points, {"faces": [0]}, "The points' faces must have the shape (2,), but has (1,)."),
    (points, {"barycentric": [[1, 0, 0], [0.2, 0.2, 0.2]]},
     "The barycentric weights of point 'b' sum to 0.6; they must sum to 1."),
    (points, {"barycentric": [[1, 0, 0], [NAN, 0.5, 0.5]]},
     "The points' barycentric holds a NaN or an infinite number, first at [1, 0]; remove or repair it."),
    # rig
    (rig, {"deltas": np.zeros((2, 3, 3))}, "The rig's deltas must have the shape (2, 4, 3), but has (2, 3, 3)."),
    (rig, {"deltas": with_value((2, 4, 3), (1, 3, 2), NAN)},
     "The rig's deltas holds a NaN or an infinite number, first at [1, 3, 2]; remove or repair it."),
    (rig, {"names": ("smile", "smile")},
     "The rig's shape names has 'smile' 2 times; every name must be used once."),
    (rig, {"bounds": [[0, 1], [1, 0]]},
     "The lowest weight of shape 'smileRight' is above its highest; swap its bounds."),
    (rig, {"bounds": [[0, 1]]}, "The rig's bounds must have the shape (2, 2), but has (1, 2)."),
    (rig, {"mirror": [1, 2]}, "The rig's mirror map names shape 2, but there are 2 (0 to 1)."),
    (rig, {"mirror": [1, 1]}, "The rig's mirror map must be its own inverse: left to right and right to left."),
    (rig, {"combinations": {"both": ("smileLeft", "smileRight")}},
     "The rig 'toy' has no shape named 'both'; it has smileLeft, smileRight ..."),
    (rig, {"combinations": {"smileLeft": ("jawOpen",)}},
     "The rig 'toy' has no shape named 'jawOpen'; it has smileLeft, smileRight ..."),
    (rig, {"regions": {"lips": [4]}}, "The region 'lips' names vertex 4, but there are 4 (0 to 3)."),
    (rig, {"contacts": {"lips": [[0, 1, 2]]}}, "The contact 'lips' must have the shape (any, 2), but has (1, 3)."),
    # takes
    (take, {"positions": np.zeros((0, 2, 3))}, "The take is empty: it needs at least one frame and one marker."),
    (take, {"positions": np.zeros((3, 0, 3)), "names": ()},
     "The take is empty: it needs at least one frame and one marker."),
    (take, {"positions": np.zeros((3, 2))}, "The take's positions must have the shape (any, 2, 3), but has (3, 2)."),
    (take, {"positions": with_value((3, 2, 3), (1, 1, 0), INF)},
     "Marker 'b' is at infinity in frame 1; mark a missing marker with NaN."),
    (take, {"rate": 0}, "The take's rate must be a positive number of frames a second, but is 0; state the true rate."),
    (take, {"rate": -60.0},
     "The take's rate must be a positive number of frames a second, but is -60.0; state the true rate."),
    (take, {"rate": NAN},
     "The take's rate must be a positive number of frames a second, but is nan; state the true rate."),
    (take, {"rate": 1e300},
     "The take's rate is 1e+300 frames a second, which no recording has; state the true rate."),
    (take, {"rate": 1e-300},
     "The take's rate is 1e-300 frames a second, which no recording has; state the true rate."),
    (take, {"rate": "fast"}, "The take's rate must be a number of frames a second, but is 'fast'."),
    (take, {"names": ("a", "a")}, "The take's marker names has 'a' 2 times; every name must be used once."),
    (take, {"residuals": np.zeros((3, 3))}, "The take's residuals must have the shape (3, 2), but has (3, 3)."),
    (landmarks, {"points": np.zeros((3, 2, 3))},
     "The take's points must have the shape (any, 2, 2), but has (3, 2, 3)."),
    (landmarks, {"confidence": np.zeros((3, 1))}, "The take's confidence must have the shape (3, 2), but has (3, 1)."),
    (landmarks, {"rate": INF},
     "The take's rate must be a positive number of frames a second, but is inf; state the true rate."),
    (landmarks, {"names": ("a", "a")}, "The take's landmark names has 'a' 2 times; every name must be used once."),
    # animation
    (animation, {"weights": np.zeros((0, 2))}, "The animation is empty: it needs at least one frame."),
    (animation, {"weights": np.zeros((3, 3))},
     "The animation's weights must have the shape (any, 2), but has (3, 3)."),
    (animation, {"weights": with_value((3, 2), (2, 1), INF)},
     "The weight of 'smileRight' is infinite in frame 2; use NaN for unknown."),
    (animation, {"rate": 0.0},
     "The animation's rate must be a positive number of frames a second, but is 0.0; state the true rate."),
    (animation, {"names": ("a", "a")}, "The animation's shape names has 'a' 2 times; every name must be used once."),
    (animation, {"head": np.eye(4)}, "The animation's head motion must have the shape (3, 4, 4), but has (4, 4)."),
    (animation, {"confidence": np.zeros(3)}, "The animation's confidence must have the shape (3, 2), but has (3,)."),
    (animation, {"confidence": with_value((3, 2), (2, 1), -1.0)},
     "The confidence of 'smileRight' is -1 in frame 2; it goes from 0 to 1."),
    (animation, {"confidence": with_value((3, 2), (0, 0), 100.0)},
     "The confidence of 'smileLeft' is 100 in frame 0; it goes from 0 to 1."),
    (animation, {"times": [0.0, 0.1, 0.1]},
     "The animation's times do not rise at frame 2; sort or repair them."),
    (animation, {"times": [0.0, NAN, 0.1]},
     "The animation's times holds a NaN or an infinite number, first at [1]; remove or repair it."),
    # binding, camera
    (binding, {"rotation": np.eye(4)}, "The binding's rotation must have the shape (3, 3), but has (4, 4)."),
    (binding, {"translation": [0, 0, NAN]},
     "The binding's translation holds a NaN or an infinite number, first at [2]; remove or repair it."),
    (binding, {"offsets": np.zeros((3, 3))}, "The binding's offsets must have the shape (2, 3), but has (3, 3)."),
    (binding, {"errors": [[0.1]]}, "The binding's errors must have the shape (any,), but has (1, 1)."),
    (camera, {"intrinsics": np.eye(2)}, "The camera's intrinsics must have the shape (3, 3), but has (2, 2)."),
    (camera, {"pose": np.full((4, 4), NAN)},
     "The camera's pose holds a NaN or an infinite number, first at [0, 0]; remove or repair it."),
    (camera, {"distortion": [0.1, 0.2]}, "The camera's distortion must have the shape (5,), but has (2,)."),
]  # fmt: skip


@pytest.mark.parametrize(("build", "changes", "sentence"), REFUSALS)
def test_bad_input_is_refused_with_its_sentence(build, changes, sentence):
    build()  # the record that the change spoils is good
    with pytest.raises(InputError) as caught:
        build(**changes)
    assert str(caught.value) == sentence


@pytest.mark.parametrize("values", ["words", [["a", "b", "c"]] * 4, [[1, 2], [3]], {"x": 1}])
def test_what_is_no_array_of_numbers_is_refused(values):
    with pytest.raises(InputError, match=r"^The mesh's vertices must (be an array of numbers of|have the) shape"):
        mesh(vertices=values)


QUESTIONS = [
    (lambda: rig().index("jawOpen"), "The rig 'toy' has no shape named 'jawOpen'; it has smileLeft, smileRight ..."),
    (lambda: rig().select(["jawOpen"]), "The rig 'toy' has no shape named 'jawOpen'; it has smileLeft, smileRight ..."),
    (lambda: rig().pose(np.zeros(3)), "The rig has 2 shapes, but the weights have the shape (3,)."),
    (lambda: rig().pose(np.zeros((1, 1, 2))), "The rig has 2 shapes, but the weights have the shape (1, 1, 2)."),
    (lambda: take().select(["c"]), "The take has no marker named 'c'; it has a, b ..."),
    (lambda: points().select(["c"]), "There is no point named 'c'; there are a, b ..."),
    (lambda: points(faces=[0, 2]).matrix(mesh()),
     "The point 'b' lies on face 2, but the mesh has 2 faces; the points belong to another mesh."),
    (lambda: animation().select(["jawOpen"]), "The animation has no shape 'jawOpen'; it has smileLeft, smileRight ..."),
    (lambda: SurfacePoints.at_vertices(["a"], [3], mesh(faces=[[0, 1, 2]])),
     "Vertex 3 belongs to no face of the mesh; choose one on the surface."),
    (lambda: SurfacePoints.at_vertices(["a"], [4], mesh()),
     "The points' vertices names vertex 4, but there are 4 (0 to 3)."),
]  # fmt: skip


@pytest.mark.parametrize(("ask", "sentence"), QUESTIONS)
def test_a_question_without_an_answer_is_refused_with_its_sentence(ask, sentence):
    with pytest.raises(InputError) as caught:
        ask()
    assert str(caught.value) == sentence


@pytest.mark.parametrize("build", [mesh, points, rig, take, landmarks, animation, binding, camera])
def test_a_record_cannot_be_changed(build):
    record = build()
    for field in dataclasses.fields(record):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(record, field.name, None)
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable, field.name


def test_points_on_a_face_below_zero_are_refused():
    with pytest.raises(InputError, match=r"^The points' faces names face -3, but face numbers begin at 0"):
        points(faces=[0, -3])


def test_a_record_leaves_the_arrays_it_was_given_writeable():
    vertices = VERTICES.copy()
    mesh(vertices=vertices)
    assert vertices.flags.writeable


def test_defaults_are_filled_in():
    record = rig()
    assert record.bounds.tolist() == [[0, 1], [0, 1]]
    assert record.mirror.tolist() == [0, 1]
    assert camera().distortion.tolist() == [0] * 5
    assert animation(rate=4).times.tolist() == [0, 0.25, 0.5]


def test_triangulate_fans_around_the_first_corner_and_skips_the_padding():
    polygons = [[0, 1, 2, 3, 4], [5, 6, 7, 8, -1], [9, 8, 7, -1, -1]]
    expected = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [5, 6, 7], [5, 7, 8], [9, 8, 7]]
    assert triangulate(np.array(polygons)).tolist() == expected


@settings(deadline=None)
@given(corners=st.integers(3, 12))
def test_triangulate_keeps_the_area_and_the_winding(corners):
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    a, b, c = ring[triangulate(np.arange(corners)[None])].swapaxes(0, 1)
    doubled = np.cross(np.c_[b - a, np.zeros(len(a))], np.c_[c - a, np.zeros(len(a))])[:, 2]
    assert (doubled > 0).all()
    np.testing.assert_allclose(doubled.sum(), corners * np.sin(2 * np.pi / corners))


def test_a_marker_that_is_partly_nan_was_not_seen():
    record = take(positions=with_value((3, 2, 3), (1, 0, 2), NAN))
    assert record.missing.tolist() == [[False, False], [True, False], [False, False]]
    assert np.isnan(record.positions[1, 0]).all()


def test_pose_is_the_neutral_plus_the_weighted_deltas():
    record, weights = rig(), np.array([[0, 0], [1, 0], [0.5, 0.25]])
    posed = record.pose(weights)
    assert np.array_equal(posed[0], VERTICES)
    assert np.array_equal(posed[2], VERTICES + 0.5 * record.deltas[0] + 0.25 * record.deltas[1])
    assert np.array_equal(record.pose(weights[2]), posed[2])


def test_sampling_the_rig_equals_sampling_its_posed_mesh():
    record, where, weights = rig(), points(), np.array([0.3, 0.7])
    rest, deltas = record.sample(where)
    posed = where.positions(record.mesh.with_vertices(record.pose(weights)))
    np.testing.assert_allclose(rest + np.einsum("n,nmk->mk", weights, deltas), posed, atol=1e-5)  # deltas are float32


def test_points_follow_any_affine_motion_of_the_mesh():
    linear, shift = np.array([[0.0, -2, 0], [1, 0, 3], [0, 1, 1]]), np.array([5.0, -1, 2])
    moved = points().positions(mesh(vertices=VERTICES @ linear + shift))
    np.testing.assert_allclose(moved, points().positions(mesh()) @ linear + shift)


def test_points_at_vertices_lie_on_them():
    record = SurfacePoints.at_vertices(["d", "a", "c"], [3, 0, 2], mesh())
    assert np.array_equal(record.positions(mesh()), VERTICES[[3, 0, 2]])


def test_select_keeps_names_and_columns_together():
    weights = np.array([[1.0, 2], [3, 4]])
    record = animation(weights=weights, confidence=weights / 10, times=[0, 1]).select(["smileRight"])
    assert record.weights.tolist() == [[2], [4]] and record.confidence.tolist() == [[0.2], [0.4]]
    assert record.times.tolist() == [0, 1]
    seen = take(positions=np.arange(18).reshape(3, 2, 3), residuals=np.arange(6).reshape(3, 2)).select(["b", "a"])
    assert seen.positions[0].tolist() == [[3, 4, 5], [0, 1, 2]] and seen.residuals[0].tolist() == [1, 0]


def test_select_keeps_what_the_shapes_of_a_rig_mean():
    names = ("jaw", "smileLeft", "smileRight", "both")
    bounds, drivers = [[0, 1], [-1, 1], [0, 2], [0, 3]], {"both": ("smileLeft", "smileRight")}
    record = Rig(mesh(), np.arange(48).reshape(4, 4, 3), names, bounds, mirror=[0, 2, 1, 3], combinations=drivers)
    turned = record.select(["smileRight", "both", "smileLeft"])
    assert turned.mirror.tolist() == [2, 1, 0]
    assert turned.bounds.tolist() == [[0, 2], [0, 3], [-1, 1]]
    assert turned.combinations == drivers
    assert np.array_equal(turned.deltas, record.deltas[[2, 3, 1]])
    alone = record.select(["smileLeft", "both"])
    assert alone.mirror.tolist() == [0, 1] and alone.combinations == {}


def test_moving_vertices_are_those_that_a_shape_moves_by_more_than_the_threshold():
    deltas = np.zeros((2, 4, 3))
    deltas[0, 1] = [0.3, 0.4, 0]  # 0.5 mm exactly
    deltas[1, 2] = [0.31, 0.4, 0]
    assert rig(deltas=deltas).moving_vertices().tolist() == [2]
    assert rig(deltas=deltas).moving_vertices(0.49).tolist() == [1, 2]


def test_the_camera_stands_where_its_pose_maps_to_zero():
    angle = 0.7
    rotation = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, [10, -20, 500]
    np.testing.assert_allclose(pose @ [*camera(pose=pose).position, 1], [0, 0, 0, 1], atol=1e-12)


def test_a_binding_takes_markers_to_the_rig():
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    record = binding(rotation=quarter, translation=[1, 2, 3], scale=2.0)
    np.testing.assert_allclose(record.to_rig([[1, 0, 0], [0, 1, 0]]), [[1, 4, 3], [-1, 2, 3]])


def solution(residuals) -> Solution:
    residuals = np.array(residuals, dtype=float)
    certificate = Certificate(max_kkt=0.0, iterations=1.0, converged=True, residuals=np.zeros(len(residuals)))
    return Solution(animation(), residuals, np.zeros(len(residuals)), {}, certificate, ("a", "b"))


def test_the_rms_counts_every_marker_that_was_seen_once():
    answer = solution([[3.0, 4.0], [NAN, 1.0], [2.0, NAN]])
    assert answer.rms_mm == pytest.approx(np.sqrt((9 + 16 + 1 + 4) / 4))
    assert answer.marker_rms == pytest.approx([np.sqrt((9 + 4) / 2), np.sqrt((16 + 1) / 2)])
    blind = solution([[NAN, 2.0]])
    assert blind.rms_mm == 2.0 and np.isnan(blind.marker_rms[0])
    assert np.isnan(solution([[NAN, NAN]]).rms_mm)
