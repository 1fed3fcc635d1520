"""Normal maps: what they shade like, against surfaces that are really displaced, and how they add up."""

from dataclasses import replace

import numpy as np
import pytest

from blendcap.data import InputError, Mesh, Rig, triangulate
from blendcap.rendering import (
    Light,
    blended_slopes,
    face_camera,
    normal_map_of,
    prepare,
    prepare_rig,
    render,
    shaped,
    slopes_of,
    tangents_of,
    vertex_normals,
)
from blendcap.rendering.relief import FLAT, relief_of
from blendcap.rendering.shading import bent

SIZE = (160, 140)
MATT = Light(key=(0.8, 0.5, 0.6), fill=(-0.6, 0.7, 0.5), strengths=(0.0, 0.9, 0.0, 0.1), gloss=0)


def grid(place, count=80):
    """A mesh over the unit square: `place` takes (K, 2) texture coordinates to (K, 3), mm."""
    u, v = (a.ravel() for a in np.meshgrid(*[np.linspace(0, 1, count + 1)] * 2))
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    quads = np.stack([first, first + 1, first + count + 2, first + count + 1], 1)
    uv = np.stack([u, v], 1)
    return Mesh(place(uv), triangulate(quads), quads, uv=uv)


def flat(uv):
    return np.stack([80 * uv[:, 0] - 40, 60 * uv[:, 1] - 30, 0 * uv[:, 0]], 1)


def barrel(uv):
    """A cylinder of radius 40 about the vertical, u round it, v up."""
    turn = 2.2 * (uv[:, 0] - 0.5)
    return np.stack([40 * np.sin(turn), 70 * uv[:, 1] - 35, 40 * np.cos(turn)], 1)


def texels(height, width):
    """Texture coordinates (H, W, 2) of the middles of texels."""
    v, u = np.meshgrid(1 - (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij")
    return np.stack([u, v], -1)


def waves(uv):
    """A relief, mm, on texture coordinates, and its gradient (..., 2) by them."""
    a, b = 25 * uv[..., 0] + 9 * uv[..., 1], 31 * uv[..., 1] - 8 * uv[..., 0]
    height = 0.6 * np.sin(a) + 0.5 * np.cos(b)
    by_u = 0.6 * 25 * np.cos(a) + 0.5 * 8 * np.sin(b)
    by_v = 0.6 * 9 * np.cos(a) - 0.5 * 31 * np.sin(b)
    return height, np.stack([by_u, by_v], -1)


@pytest.mark.parametrize(("place", "lengths", "normal"), [
    (flat, (80.0, 60.0), lambda p: np.tile([0.0, 0, 1], (len(p), 1))),
    (barrel, (88.0, 70.0), lambda p: p * [1 / 40, 0, 1 / 40]),
])  # fmt: skip
def test_a_normal_map_shades_as_the_displaced_surface_does(place, lengths, normal):
    smooth = grid(place, 160)
    height, _ = waves(smooth.uv)
    displaced = smooth.with_vertices(smooth.vertices + height[:, None] * normal(smooth.vertices))
    _, gradient = waves(texels(512, 512))
    mapped = replace(smooth, normal_map=normal_map_of(-gradient / np.array(lengths)))
    camera = face_camera(smooth.vertices, SIZE, 0.3, 0.2)
    even = np.ones(len(smooth.vertices))  # the same sky for all: only normals are compared
    pictures = [prepare(mesh).posed(mesh.vertices, even).picture(camera, SIZE, light=MATT, background=(0, 0, 0))
                .astype(int) for mesh in (mapped, displaced, smooth)]  # fmt: skip
    inside = (pictures[0].min(2) > 20) & (pictures[1].min(2) > 20)
    inside &= np.roll(inside, 3, 0) & np.roll(inside, -3, 0) & np.roll(inside, 3, 1) & np.roll(inside, -3, 1)
    with_map, truth, without = (picture[inside].astype(float) for picture in pictures)
    assert inside.mean() > 0.3
    assert np.abs(truth - without).mean() > 5  # the relief is seen
    assert np.abs(with_map - truth).mean() < 0.12 * np.abs(truth - without).mean()


@pytest.mark.parametrize("chart", [lambda uv: uv, lambda uv: uv * [-1, 1] + [1, 0], lambda uv: uv[:, ::-1],
                                   lambda uv: 0.5 + 0.4 * (uv - 0.5) @ [[0.6, 0.8], [-0.8, 0.6]]])  # fmt: skip
def test_the_same_relief_in_any_chart(chart):
    """Mirrored, transposed or turned, a chart with its own normals gives the picture of the plain one."""
    plain = grid(flat, 20)
    uv = chart(plain.uv)
    mesh = replace(plain, uv=uv)
    jacobian = np.linalg.lstsq(np.c_[plain.uv, np.ones(len(uv))], uv, rcond=None)[0][:2]  # uv_new = uv @ jacobian + c
    back = np.linalg.inv(jacobian)
    offset = uv[0] - plain.uv[0] @ jacobian
    old = (texels(512, 512) - offset) @ back
    gradient = waves(old)[1] / [80, 60]  # by mm along x and y
    frame = np.array([[1 / 80, 0], [0, 1 / 60]]) @ jacobian  # rows: d uv_new / dx, / dy
    along_u = np.linalg.inv(frame)[0] / np.linalg.norm(np.linalg.inv(frame)[0])
    along_v = np.array([-along_u[1], along_u[0]]) * np.sign(np.linalg.det(frame))
    leaning = np.stack([-gradient @ along_u, -gradient @ along_v], -1)
    camera = face_camera(plain.vertices, SIZE)
    first = replace(plain, normal_map=normal_map_of(-waves(texels(512, 512))[1] / [80, 60]))
    pictures = [render(m, camera, SIZE, light=MATT).astype(int) for m in
                (first, replace(mesh, normal_map=normal_map_of(leaning)), plain)]  # fmt: skip
    assert np.abs(pictures[0] - pictures[2]).mean() > 2
    assert np.abs(pictures[0] - pictures[1])[5:-5, 5:-5].mean() < 0.4


def test_slopes_come_back_from_bytes():
    slopes = np.random.default_rng(0).uniform(-1.5, 1.5, (40, 50, 2)).astype(np.float32)
    np.testing.assert_allclose(slopes_of(normal_map_of(slopes)), slopes, atol=0.04)
    assert (normal_map_of(np.zeros((2, 3, 2))) == [128, 128, 255]).all()
    assert np.isfinite(slopes_of(np.zeros((2, 2, 3), dtype=np.uint8))).all()
    steep = np.full((1, 1, 2), 1e6, dtype=np.float32)
    assert (slopes_of(normal_map_of(steep)) > 50).all()


def rig_with_maps(neutral=True):
    mesh = grid(flat, 12)
    rng = np.random.default_rng(3)
    maps = [normal_map_of(rng.uniform(-0.6, 0.6, (32, 48, 2))) for _ in range(3)]
    mesh = replace(mesh, normal_map=maps[2] if neutral else None)
    deltas = np.zeros((3, len(mesh.vertices), 3), dtype=np.float32)
    return Rig(mesh, deltas, ("a", "b", "plain"), normal_maps={"b": maps[0], "a": maps[1]})


def test_weights_blend_linearly_in_slope():
    rig = rig_with_maps()
    own = slopes_of(rig.mesh.normal_map)
    a, b = slopes_of(rig.normal_maps["a"]), slopes_of(rig.normal_maps["b"])
    for weights in ([0, 0, 0], [1, 0, 0], [0.3, 0.9, 0.5], [-0.2, 1.4, 1]):
        expected = own + weights[0] * a + weights[1] * b
        np.testing.assert_allclose(blended_slopes(rig, np.array(weights)), expected, atol=1e-5)
    without = blended_slopes(rig_with_maps(neutral=False), np.array([1.0, 0, 0]))
    np.testing.assert_allclose(without, a, atol=1e-6)
    assert blended_slopes(replace(rig, mesh=grid(flat, 12), normal_maps={}), np.zeros(3)) is None


def test_a_posed_rig_wears_its_wrinkles():
    rig, weights = rig_with_maps(neutral=False), np.array([0.7, 0.2, 0])
    camera = face_camera(rig.mesh.vertices, SIZE)
    worn = shaped(prepare_rig(rig), rig, weights).picture(camera, SIZE)
    baked = replace(rig.mesh, normal_map=normal_map_of(blended_slopes(rig, weights)))
    assert np.abs(worn.astype(int) - prepare(baked, SKIN_LIKE).picture(camera, SIZE)).mean() < 0.5
    still = shaped(prepare_rig(rig), rig, np.zeros(3)).picture(camera, SIZE)
    np.testing.assert_array_equal(still, render(rig.mesh, camera, SIZE))
    assert np.abs(worn.astype(int) - still).mean() > 1


SKIN_LIKE = (0.80, 0.64, 0.56)


def test_a_flat_map_changes_nothing():
    plain = grid(barrel, 30)
    mesh = replace(plain, normal_map=np.full((16, 16, 3), (128, 128, 255), dtype=np.uint8))
    camera = face_camera(plain.vertices, SIZE, 0.4)
    assert np.abs(render(mesh, camera, SIZE).astype(int) - render(plain, camera, SIZE)).max() <= 1


def test_far_away_a_fine_relief_is_smooth():
    """Texels much finer than pixels are averaged, and do not shimmer."""
    plain = grid(flat, 12)
    rough = normal_map_of(np.random.default_rng(0).normal(size=(1024, 1024, 2)) * 0.5)
    mesh = replace(plain, normal_map=rough)
    camera = face_camera(plain.vertices, (64, 64))
    pictures = [render(m, camera, (64, 64), light=MATT)[20:44, 8:56, 1].astype(float) for m in (mesh, plain)]
    assert pictures[0].std() < 4
    assert pictures[0].mean() == pytest.approx(pictures[1].mean(), abs=6)


def test_tangents_are_the_direction_of_u():
    mesh = grid(barrel, 40)
    tangents = tangents_of(mesh)
    along = tangents.directions[tangents.faces].reshape(-1, 3)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    place = mesh.vertices[mesh.faces].reshape(-1, 3)
    inner = np.abs(mesh.uv[mesh.uv_faces].reshape(-1, 2)[:, 0] - 0.5) < 0.45
    round_the_axis = np.stack([place[:, 2], 0 * place[:, 2], -place[:, 0]], 1) / 40
    np.testing.assert_allclose(along[inner], round_the_axis[inner], atol=0.012)
    assert (tangents.signs == 1).all()
    assert (tangents_of(replace(mesh, uv=mesh.uv * [-1, 1])).signs == -1).all()


def test_a_bent_normal_leans_by_its_slopes():
    normal, along = np.array([0.0, 0, 2]), np.array([3.0, 0, 1])
    np.testing.assert_allclose(bent(tuple(normal), tuple(along), 1.0, (0.3, -0.2)), [0.3, -0.2, 1], atol=1e-12)
    np.testing.assert_allclose(bent(tuple(normal), tuple(along), -1.0, (0.3, -0.2)), [0.3, 0.2, 1], atol=1e-12)


def test_what_has_no_chart_has_no_relief():
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]]), normal_map=np.zeros((2, 2, 3), dtype=np.uint8))
    assert relief_of(mesh, slice(None)) is FLAT


def test_records_refuse_what_is_no_normal_map():
    rig = rig_with_maps()
    with pytest.raises(InputError, match=r"must hold bytes \(uint8, 128 is 0\), but is float64"):
        replace(rig.mesh, normal_map=np.zeros((4, 4, 3)))
    with pytest.raises(InputError, match="has no shape named 'c'"):
        replace(rig, normal_maps={"c": rig.normal_maps["a"]})
    with pytest.raises(InputError, match="of the shape 'a' is 4 x 4, but another one of the rig is 48 x 32"):
        replace(rig, normal_maps={"a": np.zeros((4, 4, 3), dtype=np.uint8)})
    assert set(rig.select(["plain", "b"]).normal_maps) == {"b"}


def test_tangents_turn_with_the_mesh():
    mesh, rng = grid(barrel, 24), np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    first, second = tangents_of(mesh), tangents_of(mesh.with_vertices(mesh.vertices @ turn.T))
    np.testing.assert_allclose(second.directions, first.directions @ turn.T, atol=1e-9)


def test_bent_normals_are_those_of_the_displaced_surface():
    """At every vertex: the smooth surface's frame with the slopes there, against normals of really moved vertices."""
    for place, lengths in ((flat, (80, 60)), (barrel, (88, 70))):
        mesh = grid(place, 240)
        height, gradient = waves(mesh.uv)
        normals, tangents = vertex_normals(mesh.vertices, mesh.faces), tangents_of(mesh)
        along = np.empty_like(normals)
        along[mesh.faces] = tangents.directions[tangents.faces]
        rows = zip(normals, along, -gradient / lengths, strict=True)
        leaning = np.array([bent(tuple(n), tuple(a), 1.0, tuple(s)) for n, a, s in rows])
        leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
        moved = vertex_normals(mesh.vertices + height[:, None] * normals, mesh.faces)
        inner = (np.abs(mesh.uv - 0.5) < 0.45).all(1)
        angle = np.degrees(np.arccos(np.clip((leaning * moved).sum(1)[inner], -1, 1)))
        plain = np.degrees(np.arccos(np.clip((normals * moved).sum(1)[inner], -1, 1)))
        assert plain.mean() > 10 and angle.mean() < 0.02 * plain.mean() + 0.5 * (lengths[0] == 88)
