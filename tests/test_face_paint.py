"""Paint: the same every time, at home on every face, lips where the lips are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from blendcap import InputError, mannequin
from blendcap.data import landmarks68
from blendcap.data.anatomy import inside_vertices
from blendcap.io.ict import read_ict_pack
from blendcap.rendering import face_camera, prepare_rig
from blendcap.synthetic.canvas import canvas_of
from blendcap.synthetic.charts import in_one_picture
from blendcap.synthetic.face_paint import LAYERS, is_mannequin, kinds_of, paint_face
from blendcap.synthetic.mannequin.atlas import FLOOR
from blendcap.synthetic.mannequin.look import LOOKS, Look, draw_look
from blendcap.synthetic.mannequin.noise import noise, spots
from blendcap.synthetic.mannequin.shared import shared
from blendcap.synthetic.plain import _mended, plain_places

SIZE = (160, 200)
MARKED = Look(skin=(0.5, 0.5, 0.5), lips=(0.9, 0.0, 0.0), blush=0, shade=0, blotches=0, cut="bald")


@pytest.fixture(scope="module")
def plain():
    return mannequin()


def in_tiles(rig):
    """The rig as other hands might have laid it out: eyes, teeth and tongue over the skin, the neck a tile aside."""
    mesh, parts = rig.mesh, np.zeros(len(rig.mesh.vertices), dtype=bool)
    for name in ("eyes", "teeth", "tongue"):
        parts[rig.regions[name]] = True
    rows = np.unique(mesh.uv_faces[parts[mesh.faces].all(1)])
    uv = mesh.uv.copy()
    uv[rows] = 0.02 + 0.9 * (uv[rows] * [1, 2.8])
    neck = np.isin(mesh.faces, rig.regions["neck"]).all(1)
    moved = np.concatenate([uv, uv + np.array([1, 0])])
    uv_faces = mesh.uv_faces + neck[:, None] * len(uv)
    return replace(rig, mesh=replace(mesh, uv=moved, uv_faces=uv_faces, texture=None))


def picture(rig, yaw=0.3):
    head = rig.mesh.vertices[rig.mesh.vertices[:, 1] > -110]
    return prepare_rig(rig).picture(face_camera(head, SIZE, yaw), SIZE).astype(float)


def ict(data, seed=None):
    coefficients = None if seed is None else 0.8 * np.random.default_rng(seed).normal(size=100)
    return read_ict_pack(data("rigs/ict_facekit.npz"), coefficients)


# ---------------------------------------------------------------- looks


def test_looks_are_drawn_the_same_every_time_and_differ():
    looks = [draw_look(seed) for seed in range(40)]
    assert looks == [draw_look(seed) for seed in range(40)]
    assert len(set(looks)) == 40
    tones = np.array([look.skin for look in looks])
    assert tones.max() > 0.6 and tones[:, 0].min() < 0.3
    assert (np.diff(tones, axis=1) < 0).all()  # skin is red before it is green before it is blue
    assert {look.cut for look in looks} == {"bald", "buzz", "short"}
    assert any(look.stubble > 0.5 for look in looks) and any(look.freckles > 0.3 for look in looks)
    assert all(look.stubble == 0 or look.brow_height > 7 for look in looks)


def test_a_look_with_another_feature():
    look = draw_look(3)
    assert look.but(stubble=0.8, cut="bald") == replace(look, stubble=0.8, cut="bald") != look
    with pytest.raises(InputError, match="has no feature 'stubbel'; it has skin, lips, hair"):
        look.but(stubbel=0.8)
    with pytest.raises(InputError, match="There is no cut 'buz'; choose one of bald, buzz, short"):
        look.but(cut="buz")


def test_paint_is_the_same_every_time(plain):
    one, two = (paint_face(in_tiles(plain), 5, size=256).mesh.texture for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert np.abs(one.astype(int) - paint_face(in_tiles(plain), 6, size=256).mesh.texture).mean() > 5
    np.testing.assert_array_equal(paint_face(plain, 0).mesh.texture, plain.mesh.texture)
    np.testing.assert_array_equal(mannequin("kofi").mesh.texture, paint_face(plain, LOOKS["kofi"]).mesh.texture)


def test_noise_is_the_same_on_every_machine():
    places = np.array([[0.0, 0, 0], [1.3, -2.7, 40.2], [-71.5, 33.3, -8.1], [12.0, 12.0, 12.5]])
    expected = [0.0, 0.39464521, -0.02325537, -0.50119829]
    np.testing.assert_allclose(noise(places, 0.7, 5), expected, atol=1e-6)
    many = np.random.default_rng(0).uniform(-100, 100, (20000, 3))
    values = noise(many, 0.7, 5)
    assert abs(values.mean()) < 0.02 and 0.3 < values.std() < 0.6
    close = noise(many + 1e-3, 0.7, 5)
    assert np.abs(values - close).max() < 0.02
    dots = spots(many, 4.0, (0.5, 1.5), 0.5, 3)
    assert dots.min() == 0 and 0.9 < dots.max() <= 1 and 0.005 < (dots > 0).mean() < 0.2


def test_features_are_alike_on_both_sides(plain):
    """Lips, brows, lashes and hair mirror; only the grain of the skin does not."""
    texture = paint_face(plain, MARKED).mesh.texture[20:620, 20:-20].astype(float)
    mirrored = texture[:, ::-1]
    assert 0 < np.abs(texture - mirrored).mean() < 6
    blocks = [t[:, :984].reshape(75, 8, 123, 8, 3).mean((1, 3)) for t in (texture, mirrored)]
    assert np.quantile(np.abs(blocks[0] - blocks[1]), 0.99) < 8


# ---------------------------------------------------------------- other faces


def test_a_mannequin_lies_on_itself(plain):
    skin = np.arange(len(shared().rest))
    places = plain_places(plain, skin)
    away = np.linalg.norm(places[:, :3] - shared().rest, axis=1)
    assert np.quantile(away, 0.95) < 0.3
    other, face = plain_places(mannequin("kofi"), skin), plain.regions["lower"]
    away = np.linalg.norm(other[face, :3] - shared().rest[face], axis=1)
    assert np.median(away) < 2 and np.quantile(away, 0.95) < 5


def test_a_mannequin_in_foreign_charts_looks_the_same(plain):
    """Two routes to one picture: the known places, and the places found by landmarks and closest points."""
    foreign = in_tiles(plain)
    assert is_mannequin(plain) and not is_mannequin(foreign)
    found = paint_face(foreign, LOOKS["plain"])
    assert found.mesh.uv.min() >= 0 and found.mesh.uv.max() <= 1
    known, found = picture(plain), picture(found)
    assert np.abs(known - found).mean() < 1.5
    assert np.quantile(np.abs(known - found), 0.98) < 25


def test_charts_that_lie_over_each_other_are_parted(plain):
    foreign = in_tiles(plain)
    mesh, layers = foreign.mesh, LAYERS[kinds_of(foreign).astype(int)][foreign.mesh.faces].min(1)
    nothing = np.full((len(mesh.vertices), 2), np.nan)
    uv, uv_faces = in_one_picture(mesh, layers, int(foreign.points["landmarks68"].faces[30]), nothing)
    masks = [np.zeros((512, 512), dtype=bool) for _ in np.unique(layers)]
    for mask, layer in zip(masks, np.unique(layers), strict=True):
        mask[canvas_of(uv, np.ascontiguousarray(uv_faces[layers == layer]), 512).where] = True
    assert np.sum(masks, axis=0).max() == 1
    kept = in_one_picture(plain.mesh, 0 * layers, 0, nothing)
    assert kept[0] is plain.mesh.uv


def lip_border(rig, size=1024):
    """How far (K,) each texel on the border of the painted lips is from the contour through the landmarks, mm."""
    painted = paint_face(rig, MARKED, size=size)
    mesh, whole = painted.mesh, canvas_of(painted.mesh.uv, painted.mesh.uv_faces, painted.mesh.texture.shape[0])
    redness = mesh.texture[..., 0].astype(float) - mesh.texture[..., 1]
    skin = kinds_of(rig)[mesh.faces[whole.faces]].max(1) == 0
    if is_mannequin(rig):  # lips go on inside the mouth, which has a chart of its own
        skin &= whole.where[0] < (1 - FLOOR) * size
    lips, known = np.zeros(redness.shape, dtype=bool), np.zeros(redness.shape, dtype=bool)
    known[whole.where], lips[whole.where] = skin, (redness[whole.where] > 60) & skin
    near = np.stack([np.roll(lips, step, axis) for axis in (0, 1) for step in (1, -1)]).any(0)
    border = (near & ~lips & known)[whole.where]
    places = whole.part(border).mixed(mesh.vertices, mesh.faces)
    contour = rig.points["landmarks68"].positions(rig.mesh)[[*range(48, 60), 48]]
    steps, along = np.arange(7), np.linspace(0, 6, 300)  # corner to corner, above and below
    curve = np.concatenate([CubicSpline(steps, part)(along) for part in (contour[:7], contour[6:])])
    away, nearest = KDTree(curve).query(places)
    return away[places[:, 2] > curve[nearest, 2] - 3]  # what lies behind is where the lips turn into the mouth


@pytest.mark.parametrize("seed", [0, "ada", "kofi"])
def test_lips_end_at_the_landmarks_on_mannequins(seed):
    away = lip_border(mannequin(seed))
    assert len(away) > 100
    assert np.median(away) < 0.7 and np.quantile(away, 0.9) < 1.5


@pytest.mark.parametrize("seed", [None, 3])
def test_lips_end_at_the_landmarks_on_ict(data, seed):
    away = lip_border(ict(data, seed), 768)
    assert len(away) > 100
    assert np.median(away) < 1.2 and np.quantile(away, 0.9) < 2.5


def test_ict_is_painted_part_by_part(data):
    rig = ict(data)
    painted = paint_face(rig, 3, size=512)
    assert painted.mesh.texture.shape == (512, 512, 3)
    np.testing.assert_array_equal(painted.mesh.vertices, rig.mesh.vertices)
    assert painted.mesh.uv.min() >= 0 and painted.mesh.uv.max() <= 1
    colors = painted.mesh.texture[whole_of(painted).where].astype(int)
    kinds = kinds_of(rig)[rig.mesh.faces[whole_of(painted).faces]].min(1)
    assert colors[kinds == 2].mean() > 180 > colors[kinds == 4].mean()  # teeth, gums
    shells = np.isin(rig.mesh.faces, rig.regions["eye_occlusion_left"]).all(1)
    assert shells.any() and not np.isin(prepare_rig(painted).faces, rig.regions["eye_occlusion_left"]).any()


def whole_of(rig):
    return canvas_of(rig.mesh.uv, rig.mesh.uv_faces, rig.mesh.texture.shape[0])


def test_what_cannot_be_painted_is_refused(plain):
    bare = replace(plain, mesh=replace(plain.mesh, uv=None, uv_faces=None, texture=None))
    with pytest.raises(InputError, match=r"has no texture coordinates \(uv\)"):
        paint_face(bare)
    with pytest.raises(InputError, match="has no points 'landmarks68'"):
        paint_face(replace(in_tiles(plain), points={}))


def test_places_that_are_torn_are_filled_in_from_around():
    row = np.arange(12)
    i = (row[:-1, None] * 12 + row[:-1]).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 13], 1), np.stack([i, i + 13, i + 12], 1)])
    points = np.stack([np.repeat(row, 12), np.tile(row, 12), np.zeros(144)], 1).astype(float)
    plain = np.c_[points, points @ np.array([[0.1, 0, 0], [0, 0.2, 0], [0.3, 0.3, 0]]).T, points]
    torn = plain.copy()
    torn[[5 * 12 + 5, 5 * 12 + 6, 6 * 12 + 5]] += 20.0
    np.testing.assert_allclose(_mended(torn, points, faces), plain, atol=1e-7)
    np.testing.assert_array_equal(_mended(plain, points, faces), plain)


def test_lids_of_another_face_have_no_patches(data):
    rig = ict(data)
    skin = np.flatnonzero(~inside_vertices(rig))
    places = plain_places(rig, skin)[:, :3]
    eyes = landmarks68(rig).positions(rig.mesh)[36:48].reshape(2, 6, 3).mean(1)
    faces = rig.mesh.faces[np.isin(rig.mesh.faces, skin).all(1)]
    near = np.min([np.linalg.norm(rig.mesh.vertices[faces].mean(1) - eye, axis=1) for eye in eyes], axis=0) < 18
    row = np.full(len(rig.mesh.vertices), -1)
    row[skin] = np.arange(len(skin))
    there, here = places[row[faces[near]]], rig.mesh.vertices[faces[near]]
    long, short = (np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2) for corners in (there, here))
    assert (long - 3 * short).max() < 2.0  # it was 5.5 mm where a fold was torn
