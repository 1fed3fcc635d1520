"""Previews, stills, sheets and heat maps: what comes back from the files, and what is where."""

import re

import cv2
import numpy as np
import pytest

from blendcap.data import Animation, InputError, Mesh, Rig, SurfacePoints, triangulate
from blendcap.io.images import png, write_image
from blendcap.io.video_write import write_video
from blendcap.rendering import project
from blendcap.view import (
    Film,
    marker_heat,
    vertex_error,
    write_contact_sheet,
    write_heatmap,
    write_preview,
    write_still,
)
from blendcap.view.heatmap import SCALE, heat_colors, heatmap
from blendcap.view.image import draw_text
from blendcap.view.posing import framed_vertices, side_by_side, weights_on
from blendcap.view.sheet import contact_sheet
from blendcap.view.still import still


@pytest.fixture(scope="module")
def rig():
    """A bent sheet with a slit across: two shapes open and lift it, a third is a corrective of the first."""
    n = 21
    x, y = np.meshgrid(np.linspace(-60, 60, n), np.linspace(80, -80, n))
    z = 40 - (x / 12) ** 2
    index = np.arange(n * n).reshape(n, n)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1)
    slit = np.zeros((n - 1, n - 1), dtype=bool)
    slit[12, 4:16] = True
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    deltas = np.zeros((3, n * n, 3), dtype=np.float32)
    below = vertices[:, 1] < -15
    deltas[0, below, 1] = -15
    deltas[1, ~below, 2] = 8
    deltas[2, below, 2] = 4
    names = ("jawOpen", "browUp", "mouthClose")
    return Rig(Mesh(vertices, triangulate(quads[~slit])), deltas, names, combinations={"mouthClose": ("jawOpen",)})


@pytest.fixture
def animation():
    rise = np.linspace(0, 1, 7)
    return Animation(np.stack([rise, rise[::-1]], 1), ("browUp", "jawOpen"), 24.0)


def film(path):
    reader = cv2.VideoCapture(str(path))
    frames = []
    while (read := reader.read())[0]:
        frames.append(read[1][..., ::-1])
    return frames, reader.get(cv2.CAP_PROP_FPS)


def test_preview_has_the_frames_rate_and_size_it_should(rig, animation, tmp_path):
    told = []
    path = tmp_path / "face.mp4"
    count = write_preview(path, rig, animation, Film((192, 108), title="a"), progress=lambda *done: told.append(done))
    frames, rate = film(path)
    assert count == len(frames) == 7
    assert rate == pytest.approx(24)
    assert {frame.shape for frame in frames} == {(108, 192, 3)}
    assert told == [(t, 7) for t in range(1, 8)]
    assert not list(tmp_path.glob(".*")), "a temporary file was left behind"
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat"), "a browser must be able to start before the end"
    shown = still(rig, weights_on(rig, animation)[6], size=(192, 108)).astype(int)
    assert np.abs(frames[6][:90].astype(int) - shown[:90]).mean() < 4
    assert np.abs(frames[0][:90].astype(int) - shown[:90]).mean() > 4


def test_preview_shows_one_of_so_many_frames(rig, animation, tmp_path):
    whole, some = Film((96, 54), (0.0,)), Film((96, 54), (0.0,), every=3)
    write_preview(tmp_path / "all.png", rig, animation, whole)
    assert write_preview(tmp_path / "some.mp4", rig, animation, some) == 3
    assert film(tmp_path / "some.mp4")[1] == pytest.approx(8)
    write_preview(tmp_path / "some.png", rig, animation, some)
    for t in range(3):
        one, same = (cv2.imread(str(tmp_path / f"{n}.{f:04d}.png")) for n, f in (("some", t), ("all", 3 * t)))
        np.testing.assert_allclose(one.astype(int), same, atol=6)  # its words too: they name the animation's frame


def test_preview_as_gif_and_as_sequence(rig, animation, tmp_path):
    assert write_preview(tmp_path / "face.gif", rig, animation, Film((96, 54))) == 7
    assert len(film(tmp_path / "face.gif")[0]) == 7
    assert write_preview(tmp_path / "face.png", rig, animation, Film((96, 54), (0.3,))) == 7
    files = sorted(path.name for path in tmp_path.glob("face.*.png"))
    assert files == [f"face.{t:04d}.png" for t in range(7)]
    assert cv2.imread(str(tmp_path / files[3])).shape == (54, 96, 3)


def test_the_same_film_twice_is_the_same_file(rig, animation, tmp_path):
    for name in ("a.mp4", "b.mp4"):
        write_preview(tmp_path / name, rig, animation, Film((96, 64)))
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_markers_are_drawn_where_they_are(rig, animation, tmp_path):
    place = np.tile(rig.mesh.vertices[[100, 210]], (7, 1, 1))
    place[:, 1] = np.nan
    write_preview(tmp_path / "face.png", rig, animation, Film((200, 200), (0.0,)), targets=place)
    camera, _ = side_by_side(rig, (200, 200), (0.0,))[0]
    x, y = np.round(project(place[0, 0], camera)[0]).astype(int)
    picture = cv2.imread(str(tmp_path / "face.0000.png"))[..., ::-1].astype(int)
    assert picture[y, x, 0] > picture[y, x, 1] + 100
    bare = still(rig, weights_on(rig, animation)[0], size=(200, 200), yaws=(0.0,))
    changed = np.argwhere((np.abs(picture[20:185] - bare[20:185]) > 40).any(2))
    assert len(changed) and np.abs(changed - [y - 20, x]).max() <= 4
    red, blue = ((picture[:20, :, k] - picture[:20, :, 2 - k] > 100).any() for k in (0, 2))
    assert red and not blue  # the corner says what is drawn, and no more


def test_markers_move_with_the_frames_that_are_shown(rig, animation, tmp_path):
    place = np.tile(rig.mesh.vertices[210], (7, 1, 1)) + np.arange(7)[:, None, None] * [6.0, 0, 0]
    write_preview(tmp_path / "face.png", rig, animation, Film((200, 200), (0.0,), every=3), targets=place)
    camera, _ = side_by_side(rig, (200, 200), (0.0,))[0]
    for k in range(3):
        picture = cv2.imread(str(tmp_path / f"face.{k:04d}.png"))[20:185, :, ::-1].astype(int)
        red = np.argwhere((picture[..., 0] > picture[..., 1] + 100) & (picture[..., 0] > picture[..., 2] + 100))
        x, y = project(place[3 * k, 0], camera)[0]
        np.testing.assert_allclose(red.mean(0), [y - 20, x], atol=1)


@pytest.mark.parametrize(
    "name, size, said",
    [
        ("face.avi", (64, 64), "end its name with .mp4, .gif or .png"),
        ("face.mp4", (65, 64), "even width and height"),
        ("missing/face.mp4", (64, 64), "does not exist"),
    ],
)
def test_films_that_cannot_be_written_are_refused(rig, animation, tmp_path, name, size, said):
    with pytest.raises(InputError, match=re.escape(said)):
        write_preview(tmp_path / name, rig, animation, Film(size))
    assert not list(tmp_path.iterdir())


def test_a_film_that_fails_half_way_leaves_nothing_behind(tmp_path):
    def frames():
        yield np.zeros((64, 64, 3), dtype=np.uint8)
        raise RuntimeError("out of frames")

    (tmp_path / "face.mp4").write_bytes(b"the one from before")
    with pytest.raises(RuntimeError, match="out of frames"):
        write_video(tmp_path / "face.mp4", frames(), 24, (64, 64))
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"the one from before"]


def test_lengths_and_names_are_checked(rig, animation, tmp_path):
    with pytest.raises(InputError, match="targets have 3 frames, but the animation has 7"):
        write_preview(tmp_path / "face.mp4", rig, animation, targets=np.zeros((3, 4, 3)))
    with pytest.raises(InputError, match="has no shape named 'earWiggle'"):
        write_preview(tmp_path / "face.mp4", rig, Animation([[0.0]], ("earWiggle",), 24))


def test_weights_follow_names_and_unknown_is_zero(rig):
    weights = weights_on(rig, Animation([[0.5, np.nan], [1, 0.25]], ("browUp", "jawOpen"), 24))
    np.testing.assert_array_equal(weights, [[0, 0.5, 0], [0.25, 1, 0]])


def test_frame_leaves_out_what_is_below_the_chin(rig):
    chest = np.array([[0.0, -300, 0], [10, -300, 0], [0, -310, 0]])
    mesh = Mesh(np.concatenate([rig.mesh.vertices, chest]), rig.mesh.faces)
    deltas = np.concatenate([rig.deltas, np.zeros((3, 3, 3), dtype=np.float32)], axis=1)
    framed = framed_vertices(Rig(mesh, deltas, rig.names))
    np.testing.assert_array_equal(framed, rig.mesh.vertices)
    assert len(framed_vertices(Rig(mesh, np.zeros_like(deltas), rig.names))) == len(mesh.vertices)


def test_stills_and_sheets_are_the_same_every_time(rig, tmp_path):
    for name in ("a.png", "b.png"):
        write_still(tmp_path / name, rig, np.array([0.5, 0.2, 0]), size=(160, 90))
        write_contact_sheet(tmp_path / f"sheet-{name}", rig, columns=4, cell=50)
    for name in ("", "sheet-"):
        assert (tmp_path / f"{name}a.png").read_bytes() == (tmp_path / f"{name}b.png").read_bytes()
    with pytest.raises(InputError, match=r"end its name with \.png"):
        write_image(tmp_path / "a.jpg", np.zeros((4, 4, 3), dtype=np.uint8))
    picture = np.random.default_rng(0).integers(0, 256, size=(20, 30, 3)).astype(np.uint8)
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(png(picture), np.uint8), 1)[..., ::-1], picture)


def test_names_stand_beside_the_places_that_face_the_camera(rig):
    places = np.array([[0.0, 40, 40], [-40.0, 60, 40 - (40 / 12) ** 2]])
    options = {"size": (400, 300), "yaws": (0.0,), "fitted": places}
    bare = still(rig, **options)
    named = still(rig, **options, labels=("a", "b")) != bare
    ((camera, _),) = side_by_side(rig, (400, 300), (0.0,))
    pixels = np.round(project(places, camera)[0]).astype(int)
    for x, y in pixels:
        assert named[y - 6 : y + 7, x : x + 16].any()
    crowded = places[[0, 0, 0]]
    apart = (still(rig, **{**options, "fitted": crowded}, labels=("a", "a", "a")) != bare).any(2)
    assert apart[:, pixels[0, 0] : pixels[0, 0] + 24].any(1).sum() > 15  # one below the other
    behind = still(rig, **{**options, "yaws": (np.pi,)}, labels=("a", "b"))
    np.testing.assert_array_equal(behind, still(rig, **{**options, "yaws": (np.pi,)}))


def test_contact_sheet_shows_three_sides_and_every_shape(rig):
    sheet = contact_sheet(rig, columns=4, cell=100)
    assert sheet.shape == (240, 400, 3)
    cells = sheet.reshape(2, 120, 4, 100, 3).swapaxes(1, 2).reshape(8, 120, 100, 3)[:, :100].astype(int)
    assert all(np.abs(cells[0] - cell).max() > 20 for cell in cells[1:])
    # a corrective is shown together with the shapes that call for it: the mouth is open in it too
    assert np.abs(cells[3] - cells[5]).mean() < np.abs(cells[0] - cells[5]).mean()
    assert np.ptp(cells[6:]) == 0


def test_heat_goes_from_green_over_yellow_to_red():
    np.testing.assert_allclose(heat_colors(np.array([0.0, 1, 2, 9]), 2.0), SCALE[[0, 1, 2, 2]])
    grey = heat_colors(np.array([np.nan]), 2.0)[0]
    assert np.ptp(grey) < 0.05


def test_marker_heat_does_not_cross_a_slit(rig):
    above = int(np.argmin(np.linalg.norm(rig.mesh.vertices - [0, -16, 40], axis=1)))
    below = int(np.argmin(np.linalg.norm(rig.mesh.vertices - [0, -24, 40], axis=1)))
    points = SurfacePoints.at_vertices(("above", "below"), [above, below], rig.mesh)
    errors, trust = marker_heat(rig, points, np.array([2.0, np.nan]))
    assert errors[above] == pytest.approx(2) and trust[above] == 1
    assert trust[below] == 0 or np.isnan(errors[below])
    both, _ = marker_heat(rig, points, np.array([2.0, 1.0]))
    assert both[above] == pytest.approx(2, abs=0.05) and both[below] == pytest.approx(1, abs=0.05)
    assert np.nanmin(both) >= 1 - 1e-9 and np.nanmax(both) <= 2 + 1e-9
    assert np.isnan(marker_heat(rig, points, np.full(2, np.nan))[0]).all()


def test_marker_heat_crosses_a_seam_of_the_texture(rig):
    # the right half gets vertices of its own along the middle, at the same places and with the same motion
    vertices, faces = rig.mesh.vertices, rig.mesh.faces.copy()
    seam = np.flatnonzero(vertices[:, 0] == 0)
    own = np.arange(len(vertices))
    own[seam] = len(vertices) + np.arange(len(seam))
    right = vertices[faces, 0].mean(1) > 0
    faces[right] = own[faces[right]]
    deltas = np.concatenate([rig.deltas, rig.deltas[:, seam]], axis=1)
    split = Rig(Mesh(np.concatenate([vertices, vertices[seam]]), faces), deltas, rig.names)
    marked = [int(np.argmin(np.linalg.norm(vertices - [x, 30, 40], axis=1))) for x in (-12, 24)]
    errors = np.array([2.0, 0.5])
    whole, halves = (
        marker_heat(one, SurfacePoints.at_vertices(("a", "b"), marked, one.mesh), errors) for one in (rig, split)
    )
    for expected, found in zip(whole, halves, strict=True):
        np.testing.assert_allclose(found, np.concatenate([expected, expected[seam]]))


def test_openness_between_key_frames_is_that_of_the_frame_to_the_eye(rig, tmp_path):
    sway = Animation(0.5 - 0.5 * np.cos(np.arange(31) / 5)[:, None], ("jawOpen",), 60.0)
    write_preview(tmp_path / "face.png", rig, sway, Film((160, 160), (0.0,)))
    for t in (0, 4, 6, 15, 29, 30):
        film = cv2.imread(str(tmp_path / f"face.{t:04d}.png"))[:140, :, ::-1].astype(int)
        exact = still(rig, weights_on(rig, sway)[t], size=(160, 160), yaws=(0.0,))[:140]
        apart = np.abs(film - exact)
        assert apart.max() <= (0 if t % 6 == 0 else 12) and apart.mean() < 0.3


def test_text_beyond_the_border_is_cut_off():
    blank = np.full((30, 60, 3), 200, dtype=np.uint8)
    whole, cut, outside = (np.pad(blank, [(30, 30), (60, 60), (0, 0)], "edge"), blank.copy(), blank.copy())
    draw_text(whole, "blendcap", (90, 40), height=16)
    draw_text(cut, "blendcap", (30, 10), height=16)
    draw_text(outside, "blendcap", (70, 10), height=16)
    draw_text(outside, "", (10, 10), height=16)
    np.testing.assert_array_equal(cut, whole[30:60, 60:120])
    assert (cut < 100).any() and (outside == 200).all()


def test_heatmap_shows_the_error_where_it_is(rig, tmp_path):
    errors = np.where(rig.mesh.vertices[:, 0] > 0, 3.0, 0.0)
    size = (200, 200)
    picture = heatmap(rig, errors, size=size, yaws=(0.0,)).astype(int)
    camera, _ = side_by_side(rig, size, (0.0,))[0]
    for x, red in ((40.0, True), (-40.0, False)):
        column, row = np.round(project(np.array([x, 40, 30]), camera)[0]).astype(int)
        assert (picture[row, column, 0] > picture[row, column, 1]) == red
    with pytest.raises(InputError, match="errors for 441 vertices"):
        write_heatmap(tmp_path / "a.png", rig, errors[:-1])
    write_heatmap(tmp_path / "a.png", rig, np.full(441, np.nan), size=(80, 80))
    assert (tmp_path / "a.png").exists()


def test_vertex_error_is_that_of_the_posed_vertices(rig):
    rng = np.random.default_rng(0)
    one, two = (Animation(rng.random((9, 3)), rig.names, 24) for _ in range(2))
    away = np.linalg.norm(rig.pose(one.weights) - rig.pose(two.weights), axis=2)
    np.testing.assert_allclose(vertex_error(one, two, rig), np.sqrt((away**2).mean(0)), atol=1e-4)
    assert vertex_error(one, one, rig).max() == 0
    with pytest.raises(InputError, match="9 and 4 frames"):
        vertex_error(one, Animation(two.weights[:4], rig.names, 24), rig)
