"""Head cameras: light and noise have closed forms, dots lie where the truth says, makeup sits where the paper says."""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import igl
import numpy as np
import pytest

from blendcap import Animation, Camera, InputError, Mesh, Rig, SurfacePoints, read_rig
from blendcap.rendering import vertex_normals
from blendcap.rendering.grey import GreySurface
from blendcap.synthetic.head_camera import HeadCamera, Sensor, film_head, mount_head_camera, slip_matrices
from blendcap.synthetic.makeup import ACTION_UNITS, BLINKS, Hand, draw_makeup
from blendcap.synthetic.mannequin import mannequin
from blendcap.synthetic.paint import Stroke, paint, skin_faces
from blendcap.synthetic.performances import for_rig
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.takes import Truth, choose_points, make_take

CLEAR = Sensor(well=1e9, read=0.0, gamma=1.0)  # no noise, linear
NONE = np.zeros((0, 0), dtype=np.uint8)


def camera(pose=None, **lens):
    return Camera(
        np.array([[400.0, 0, 159.5], [0, 400, 119.5], [0, 0, 1]]), np.eye(4) if pose is None else pose, **lens
    )


def plain(vertices, faces, albedo=0.5, uv=None, paint=NONE):
    ones = np.ones(len(vertices))
    uv = np.zeros((len(vertices), 2)) if uv is None else uv
    painted = np.full(len(faces), paint.size > 0)
    return GreySurface(faces, albedo * ones, ones, 0 * ones, uv, faces, NONE, paint, painted)


def grid(width, height, depth, n=81):
    """A plane before the camera, its front towards it."""
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, n), np.linspace(-height / 2, height / 2, n))
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    uv = np.stack([x / width + 0.5, 0.5 - y / height], -1).reshape(-1, 2)
    return np.stack([x, y, np.full_like(x, depth)], -1).reshape(-1, 3), faces, uv


@dataclass(frozen=True, eq=False)
class Scene:
    shots: tuple
    truth: Truth
    helmet: HeadCamera
    strokes: list


def film(rig, weights, *, slip=(2.0, 2.0), sensor=CLEAR, makeup=True):
    performer = make_performer(rig, seed=3)
    animation = for_rig(Animation(np.array(list(weights.values())).T, tuple(weights), 30.0), rig)
    points = choose_points(rig, 40, seed=1)
    truth = make_take(performer, animation, points, seed=3, slip=slip, neutral_frames=0)[1]
    strokes = draw_makeup(performer.rig, seed=3) if makeup else []
    helmet = mount_head_camera(performer.rig, seed=3, sensor=sensor)
    return Scene(film_head(truth, helmet, seed=3, makeup=strokes), truth, helmet, strokes)


@cache
def small():
    kept = ("jawOpen", "mouthSmileLeft", "eyeBlinkLeft", "browInnerUp")
    return mannequin().select([n for n in mannequin().names if n in kept])


@pytest.fixture(scope="module", params=["mannequin", pytest.param("ICT-FaceKit", marks=pytest.mark.slow)])
def rig(request, data):
    if request.param == "mannequin":
        return small()
    whole = read_rig(data("rigs/ict_facekit.npz"))
    return whole.select([n for n in whole.names if n.startswith(("jawOpen", "mouthSmile", "eyeBlink", "browInner"))])


@pytest.fixture(scope="module")
def scene(rig):
    """Neutral; a smile with an open jaw; a blink with raised brows."""
    poses = {"jawOpen": [0, 0.5, 0], "mouthSmileLeft": [0, 0.7, 0], "eyeBlinkLeft": [0, 0, 1], "browInnerUp": [0, 0, 1]}
    return film(rig, poses)


def test_a_plane_gets_darker_with_distance_and_both_cosines():
    vertices, faces, _ = grid(200, 150, 250)
    lights = np.array([[20.0, 10, 0, 0, 0, 1, 250.0**2, 3.0]])
    picture = plain(vertices, faces).picture(vertices, camera(), (320, 240), lights)
    column, row = np.meshgrid(np.arange(320), np.arange(240))
    place = np.stack([(column - 159.5) / 400, (row - 119.5) / 400, np.ones((240, 320))], -1) * 250
    arm = lights[0, :3] - place
    distance = np.linalg.norm(arm, axis=-1)
    cosine = -arm[..., 2] / distance
    truth = 0.5 * 250**2 / distance**2 * cosine * cosine**3
    np.testing.assert_allclose(picture[20:-20, 20:-20], truth[20:-20, 20:-20], rtol=2e-3)


def test_a_sphere_is_lit_by_the_lens_as_the_cosine_of_its_slope():
    vertices, faces = sphere(60, [0, 0, 300])
    lights = np.array([[0.0, 0, 0, 0, 0, 1, 300.0**2, 0.0]])
    picture = plain(vertices, faces).picture(vertices, camera(), (320, 240), lights)
    column, row = np.meshgrid(np.arange(320), np.arange(240))
    ray = np.stack([(column - 159.5) / 400, (row - 119.5) / 400, np.ones((240, 320))], -1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = 300 * ray[..., 2]
    reach = along - np.sqrt(np.maximum(60**2 - (300**2 - along**2), 0))
    normal = (reach[..., None] * ray - [0, 0, 300]) / 60
    cosine = -(normal * ray).sum(-1)
    inside = (300**2 - along**2 < 57**2) & (cosine > 0.2)
    truth = 0.5 * 300**2 / reach**2 * cosine
    assert np.abs(picture - truth)[inside].max() < 0.01
    assert picture[~(300**2 - along**2 < 63**2)].max() == 0


def sphere(radius, center, n=96):
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), indexing="ij"
    )
    unit = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], -1)
    index = np.arange(unit[..., 0].size).reshape(polar.shape)
    right = np.roll(index, -1, 1)
    a, b, c, d = index[:-1].ravel(), right[:-1].ravel(), right[1:].ravel(), index[1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = unit.reshape(-1, 3) * radius + center
    outward = ((vertices - center) * vertex_normals(vertices, faces)).sum() > 0
    return vertices, faces if outward else faces[:, ::-1].copy()


def test_noise_is_that_of_photons_and_reading():
    sensor = Sensor(well=3000.0, read=20.0, gamma=1.0)
    for level in (0.2, 0.5):
        picture = sensor.read_out(np.full((400, 400), level, dtype=np.float32), np.random.default_rng(0)).astype(float)
        variance = (255 / 3000) ** 2 * (3000 * level + 20**2) + 1 / 12
        assert picture.mean() == pytest.approx(255 * level, abs=0.1)
        assert picture.var() == pytest.approx(variance, rel=0.02)


def test_gamma_is_the_power_of_the_picture():
    light = np.linspace(0, 1, 300, dtype=np.float32)[None]
    picture = replace(CLEAR, gamma=0.5).read_out(light, np.random.default_rng(0))
    np.testing.assert_allclose(picture, 255 * np.sqrt(light), atol=2.1)  # the levels are coarse where it is dark


@pytest.mark.parametrize("speed", [[4.0, 0, 0], [3, -6, 0], [0, 0, 0]])
def test_a_streak_is_as_long_as_speed_times_exposure(speed):
    vertices, faces, uv = grid(150, 110, 200)
    mask = np.zeros((512, 512), dtype=np.uint8)
    cv2.circle(mask, (256, 256), 12, 255, -1, cv2.LINE_AA)
    surface = replace(plain(vertices, faces, albedo=0.0, uv=uv, paint=mask))
    take = [surface.picture(vertices, camera(), (320, 240), np.zeros((0, 8)), ambient=1.0, shift=s)
            for s in (None, np.tile(speed, (len(vertices), 1)))]  # fmt: skip
    gained = spread(take[1]) - spread(take[0])
    length = 400 / 200 * np.array(speed[:2])
    np.testing.assert_allclose(gained, np.outer(length, length) / 12, rtol=0.03, atol=0.03)


def spread(picture):
    row, column = np.nonzero(picture > 0)
    weight = picture[row, column] / picture.sum()
    off = np.stack([column, row], 1) - weight @ np.stack([column, row], 1)
    return (off * weight[:, None]).T @ off


def test_dots_lie_where_the_truth_says(scene):
    dotted, bare = (film_head(scene.truth, scene.helmet, seed=3, dots=d) for d in (True, False))
    offs = []
    for shot, without in zip(dotted, bare, strict=True):
        seen = shot.markers
        for frame in (0, 1):
            dots = picture(shot, frame) - picture(without, frame)
            good = seen.visible[frame] & alone(seen.pixels[frame]) & flat(shot, shot.dots, frame)
            found = [centroid(dots, pixel) - pixel for pixel in seen.pixels[frame][good]]
            offs += [np.linalg.norm(off) for off in found if np.isfinite(off).all()]
    assert len(offs) > 30
    assert np.median(offs) < 0.15
    assert np.percentile(offs, 95) < 0.35 and max(offs) < 0.5  # a dot on a bent place is off its own middle


def picture(shot, frame):
    return next(shot.frames(frame, frame + 1)).astype(float)


def flat(shot, points, frame):
    """Whether the skin under a dot turns to the camera and is even: on a ridge the middle of a disc is off it."""
    vertices, mesh = shot.vertices(frame), shot.performer.rig.mesh
    normals = vertex_normals(vertices, mesh.faces)
    under = points.matrix(mesh) @ vertices
    near = np.linalg.norm(under[:, None] - vertices, axis=2) < 4.0
    own = points.matrix(mesh) @ normals
    bends = np.array([(normals[n] @ o).min() if n.any() else 1 for n, o in zip(near, own, strict=True)])
    return (bends > 0.94) & (towards(shot, points, frame) > 0.5)


def towards(shot, points, frame):
    """The cosine between the skin at the points and the direction of the camera."""
    vertices, mesh = shot.vertices(frame), shot.performer.rig.mesh
    matrix = points.matrix(mesh)
    place, normal = matrix @ vertices, matrix @ vertex_normals(vertices, mesh.faces)
    view = shot.camera.position - place
    return (normal * view).sum(1) / np.linalg.norm(view, axis=1) / np.linalg.norm(normal, axis=1)


def alone(pixels):
    distance = np.linalg.norm(pixels[:, None] - pixels, axis=2) + 1e9 * np.eye(len(pixels))
    return (distance.min(1) > 20) & (pixels > 12).all(1) & (pixels < [627, 467]).all(1)


def centroid(dots, pixel):
    """The middle of a dot, whose bright side counts no more than its dark one; NaN where something cuts it."""
    column, row = np.round(pixel).astype(int)
    window = dots[row - 9 : row + 10, column - 9 : column + 10].clip(0)
    bright = window.max()
    window = (window / (0.4 * bright) - 0.1).clip(0, 1)
    y, x = np.mgrid[-9:10, -9:10]
    if window.sum() > window[1:-1, 1:-1].sum() or window.sum() < 18 or bright < 20:
        return np.full(2, np.nan)
    return np.array([column + (x * window).sum() / window.sum(), row + (y * window).sum() / window.sum()])


def test_the_lens_bends_as_opencv_says(scene):
    for shot in scene.shots:
        lens = shot.camera
        rotation = cv2.Rodrigues(lens.pose[:3, :3])[0]
        points = shot.landmarks.positions.reshape(-1, 3)
        peer = cv2.projectPoints(points, rotation, lens.pose[:3, 3], lens.intrinsics, lens.distortion)[0]
        np.testing.assert_allclose(shot.landmarks.pixels.reshape(-1, 2), peer.reshape(-1, 2), atol=1e-6)
        assert np.abs(lens.distortion[:2]).min() > 0.01


def test_triangulated_dots_tell_the_slip():
    scene = film(small(), {"jawOpen": np.zeros(3)}, slip=(3, 3), makeup=False)
    shots, truth = scene.shots, scene.truth
    rest = shots[0].dots.positions(truth.performer.rig.mesh)
    for frame in range(3):
        found = triangulate(shots, frame)
        np.testing.assert_allclose(found, truth.positions[frame], atol=1e-3)  # what the markers' take says
        rotation, move = rigid(rest, found)
        slip = slip_matrices(truth)[frame]
        np.testing.assert_allclose(rotation, slip[:3, :3], atol=1e-6)
        np.testing.assert_allclose(move, slip[:3, 3], atol=1e-4)
    assert np.abs(truth.slip).max() > 0.5


def triangulate(shots, frame):
    rows = []
    for shot in shots:
        lens = shot.camera
        given, until = shot.markers.pixels[frame][:, None], (3, 100, 1e-12)
        straight = cv2.undistortPointsIter(given, lens.intrinsics, lens.distortion, None, None, until)[:, 0]
        rows.append(straight[:, :, None] * lens.pose[2] - lens.pose[:2])
    vectors = np.linalg.svd(np.concatenate(rows, axis=1))[2][:, -1]
    return vectors[:, :3] / vectors[:, 3:]


def rigid(source, target):
    u, _, vt = np.linalg.svd((source - source.mean(0)).T @ (target - target.mean(0)))
    rotation = vt.T @ np.diag([1, 1, np.linalg.det(vt.T @ u.T)]) @ u.T
    return rotation, target.mean(0) - rotation @ source.mean(0)


def test_what_the_nose_hides_is_not_visible(scene):
    shots = {shot.name: shot.landmarks.visible[0] for shot in scene.shots}
    assert all(seen[[30, 27]].all() for seen in shots.values())  # the nose is before all four
    assert shots["upper_right"][[36, 2]].all() and not shots["upper_right"][15:17].any()
    assert shots["upper_left"][[45, 14]].all() and not shots["upper_left"][:2].any()
    take = scene.shots[0].landmark_take()
    np.testing.assert_array_equal(np.isnan(take.points[..., 0]), ~scene.shots[0].landmarks.visible)


def test_makeup_is_where_the_paper_says(scene):
    performer, strokes = scene.truth.performer, scene.strokes
    marks = performer.rig.points["landmarks68"].positions(performer.rig.mesh)
    unit = np.linalg.norm(marks[45] - marks[36])
    middle = {}
    for stroke in strokes:
        kind = next(k for k in ACTION_UNITS if stroke.name.startswith(k))
        side = "left" if stroke.name.endswith("left") else "right" if stroke.name.endswith("right") else ""
        middle.setdefault((kind, side), []).append(stroke.points.mean(0))
    at = {key: np.mean(places, axis=0)[:2] for key, places in middle.items()}
    assert {kind for kind, _ in at} == set(ACTION_UNITS)
    brow, other = marks[17:22], marks[22:27]
    for side, line, sign, lid in (("right", brow[::-1], -1, [37, 38]), ("left", other, 1, [43, 44])):
        assert at["brow_inner", side][1] > line[:2, 1].max() and at["brow_outer", side][1] > line[3:, 1].mean()
        assert sign * at["brow_inner", side][0] < sign * line[2, 0] < sign * at["brow_outer", side][0]
        assert abs(at["glabella", side][0]) < abs(line[0, 0]) + 0.05 * unit
        assert marks[lid, 1].mean() - 0.01 * unit < at["lid_upper", side][1] < line[:, 1].mean()
        assert marks[33, 1] < at["lid_lower", side][1] < marks[lid, 1].mean() - 0.1 * unit
        assert marks[28, 1] > at["cheek", side][1] > marks[33, 1]  # a mid line of the cheek, under the eye
        assert marks[51, 1] < at["lip_upper", side][1] < marks[33, 1]
        assert marks[8, 1] < at["lip_lower", side][1] < marks[57, 1] + 0.05 * unit
        assert marks[58, 1] < at["lip_red", side][1] < marks[50, 1]
        assert abs(at["nose_side", side][0]) > abs(marks[31, 0]) / 2  # on the wall of the nose, above its wings
        assert marks[31, 1] + 0.05 * unit < at["nose_side", side][1] < marks[28, 1]


def test_hands_differ_and_one_hand_repeats_itself():
    one, again, other = (draw_makeup(small(), seed=s) for s in (1, 1, 2))
    assert all(np.array_equal(a.points, b.points) for a, b in zip(one, again, strict=True))
    moved = [np.linalg.norm(a.points.mean(0) - b.points.mean(0)) for a, b in zip(one, other, strict=True)]
    assert 0.3 < np.mean(moved) < 4


def test_a_steady_hand_paints_both_sides_alike():
    strokes = {s.name: s.points for s in draw_makeup(mannequin(), seed=1, hand=Hand(0.0, 0.0, 0.0))}
    for name, right in strokes.items():
        if name.endswith("_right"):
            left = strokes[name.replace("_right", "_left")]
            np.testing.assert_allclose(left.mean(0) * [-1, 1, 1], right.mean(0), atol=0.05)


def test_upper_lids_are_painted_with_the_eyes_shut():
    """The plan's heights above the lid's margin, 3 % of the face's unit in its middle, are those of the shut lid."""
    rig = mannequin(3)
    shut = rig.mesh.with_vertices(rig.mesh.vertices + rig.deltas[[rig.index(n) for n in BLINKS]].sum(0))
    marks = rig.points["landmarks68"].positions(shut)
    unit = np.linalg.norm(np.subtract(*rig.points["landmarks68"].positions(rig.mesh)[[45, 36]]))
    skin = np.ascontiguousarray(rig.mesh.faces[skin_faces(rig)])
    strokes = {s.name: s.points for s in draw_makeup(rig, seed=1, hand=Hand(0.0, 0.0, 0.0))}
    for side, margin in (("right", [37, 38]), ("left", [43, 44])):
        points = strokes[f"lid_upper_{side}"]
        away, faces, foot = igl.point_mesh_squared_distance(points, rig.mesh.vertices, skin)[:3]
        assert away.max() < 1e-4  # on the neutral skin, not where the shut lid was
        corners = skin[faces]
        share = igl.barycentric_coordinates(foot, *(np.ascontiguousarray(rig.mesh.vertices[c]) for c in corners.T))
        posed = np.einsum("kc,kcd->kd", share, shut.vertices[corners])
        inner = np.abs(posed[:, 0] - marks[margin, 0].mean()) < 0.02 * unit
        height = posed[inner, 1] - marks[margin, 1].mean()
        np.testing.assert_allclose(height.mean() / unit, 0.033, atol=0.004)


def test_a_rig_that_cannot_blink_is_painted_with_open_eyes():
    rig = mannequin(3, 52)
    still = replace(rig, deltas=np.where([[[name in BLINKS]] for name in rig.names], 0, rig.deltas))
    bare = rig.select([name for name in rig.names if name not in BLINKS])
    percent = replace(rig, deltas=rig.deltas / 100, bounds=100 * rig.bounds)
    ours, theirs, shut, same = ({s.name: s.points for s in draw_makeup(r, seed=1)} for r in (bare, still, rig, percent))
    assert all(np.array_equal(ours[n], theirs[n]) for n in theirs)
    for name in ("lid_upper_right", "lid_upper_left"):
        assert not np.array_equal(ours[name], shut[name])
        np.testing.assert_allclose(same[name], shut[name], atol=1e-3)
    assert min(points[:, 2].min() for points in ours.values()) > 30  # not through the eye on the back of the head


def test_makeup_moves_with_the_skin(scene):
    mesh = scene.truth.performer.rig.mesh
    made, bare = (film_head(scene.truth, scene.helmet, seed=3, makeup=m, dots=False) for m in (scene.strokes, []))
    under = np.array(
        [np.linalg.norm(mesh.vertices - s.points[len(s.points) // 2], axis=1).argmin() for s in scene.strokes]
    )
    covered = [
        (np.linalg.norm(mesh.vertices[v] - s.points, axis=1) < 0.5 * s.radii).any()
        for v, s in zip(under, scene.strokes, strict=True)
    ]
    names = [s.name for s, c in zip(scene.strokes, covered, strict=True) if c]
    places = SurfacePoints.at_vertices(names, under[covered], mesh)
    shown = set()
    for shot, without in zip(made[:2], bare[:2], strict=True):
        seen = shot.look_at(places)
        for frame in range(3):
            added = picture(shot, frame) - picture(without, frame)
            for n in np.flatnonzero(seen.visible[frame] & flat(shot, places, frame)):
                column, row = np.round(seen.pixels[frame, n]).astype(int)
                assert added[row - 1 : row + 2, column - 1 : column + 2].max() > 30, (shot.name, frame, names[n])
                shown.add((names[n], frame))
    assert len(shown) > 9 and {frame for _, frame in shown} == {0, 1, 2}


@pytest.mark.parametrize("seam", [False, True])
def test_paint_ignores_seams(seam):
    """A disc drawn over a seam of the texture, one side of which lies elsewhere and turned, is a disc."""
    vertices, faces, uv = grid(100, 100, 200, n=41)
    vertices = vertices * [1, -1, -1] + [0, 0, 400]  # the front towards +z, as faces look
    corner_uv = 0.1 + 0.35 * uv[faces]
    if seam:
        other = vertices[faces].mean(1)[:, 0] > 0
        corner_uv[other] = corner_uv[other][:, :, ::-1] * [1, -1] + [0.5, 0.95]
    mesh = Mesh(vertices, faces, uv=corner_uv.reshape(-1, 2), uv_faces=np.arange(3 * len(faces)).reshape(-1, 3))
    marks = SurfacePoints.at_vertices([str(i) for i in range(68)], np.arange(68), mesh)
    sheet = Rig(mesh, np.zeros((1, len(vertices), 3)), ("rest",), points={"landmarks68": marks})
    cover, painted = paint(sheet, [[Stroke("dot", np.array([[0.7, 0.3, 200.0]]), np.array([6.0]))]])
    ones = np.ones(len(vertices))
    surface = GreySurface(faces, 0 * ones, ones, 0 * ones, mesh.uv, mesh.uv_faces, NONE, cover, painted)
    pose = np.diag([1.0, -1, -1, 1])
    pose[2, 3] = 400
    picture = surface.picture(vertices, camera(pose), (320, 240), np.zeros((0, 8)), ambient=1.0)
    assert picture.sum() == pytest.approx(np.pi * 12**2, rel=0.02)  # 2 pixels are a millimetre
    inside = picture[119 - 8 : 119 + 8, 161 - 8 : 161 + 8]
    assert inside.min() > 0.97  # no line where the seam runs
    row, column = np.nonzero(picture)
    weight = picture[row, column] / picture.sum()
    np.testing.assert_allclose([weight @ column, weight @ row], [159.5 + 1.4, 119.5 - 0.6], atol=0.1)


def test_the_same_seed_makes_the_same_film_from_any_frame_on():
    scene, again = (film(small(), {"jawOpen": [0, 0.3, 0.6]}, sensor=Sensor()) for _ in range(2))
    frames = list(scene.shots[1].frames())
    assert all(np.array_equal(a, b) for a, b in zip(frames, again.shots[1].frames(), strict=True))
    np.testing.assert_array_equal(frames[2], next(scene.shots[1].frames(2)))
    other = film_head(scene.truth, scene.helmet, seed=9, makeup=scene.strokes)[1]
    assert not np.array_equal(frames[0], next(other.frames()))


def test_what_cannot_be_filmed_is_refused_in_a_sentence():
    rig = small()
    performer = make_performer(rig, seed=1)
    points = choose_points(rig, 5)
    truth = make_take(performer, Animation(np.zeros((2, 1)), ("jawOpen",), 30.0), points, seed=1)[1]
    helmet = mount_head_camera(rig, seed=1)
    without_uv = replace(performer, rig=replace(performer.rig, mesh=Mesh(rig.mesh.vertices, rig.mesh.faces)))
    with pytest.raises(InputError, match=r"has no texture coordinates"):
        film_head(replace(truth, performer=without_uv), helmet, seed=1)
    bare = replace(rig, points={})
    for make in (draw_makeup, mount_head_camera):
        with pytest.raises(InputError, match=r"has no points 'landmarks68'"):
            make(bare, seed=1)
    stray = Stroke("elsewhere", np.array([[0.0, 0, 1e4]]), np.array([1.0]))
    with pytest.raises(InputError, match=r"'elsewhere' lies .* mm from the skin of .*draw it on this performer"):
        film_head(truth, helmet, seed=1, makeup=[stray])
