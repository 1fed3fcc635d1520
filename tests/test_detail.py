"""Baking normals: surfaces whose normals are known, and wrinkles on a face that come back."""

from dataclasses import replace

import numpy as np
import pytest

import blendcap
from blendcap.data import InputError, Mesh, Rig, SurfacePoints
from blendcap.modeling.detail import bake, bake_normals, dilated
from blendcap.modeling.rays import RayTarget
from blendcap.rendering import normal_map_of, slopes_of
from blendcap.rendering.texels import texels_of, uv_pixels


def sheet(count, half=40.0, height=None, flip=False):
    """A square of triangles in x and y, its uv from 0.1 to 0.9 (u backwards if `flip`), raised by a height."""
    line = np.linspace(-half, half, count)
    x, y = np.meshgrid(line, line)
    z = np.zeros_like(x) if height is None else height(x, y)
    index = np.arange(count * count).reshape(count, count)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    uv = 0.5 + 0.4 * vertices[:, :2] / half * [-1 if flip else 1, 1]
    return Mesh(vertices, faces, uv=uv)


def rig_of(mesh):
    return Rig(mesh, np.zeros((2, len(mesh.vertices), 3)), ("frown", "smile"))


def bump(x, y):
    return 0.8 * np.sin(0.35 * x) * np.cos(0.25 * y)


def bump_slopes(x, y):
    return np.stack([-0.28 * np.cos(0.35 * x) * np.cos(0.25 * y), 0.2 * np.sin(0.35 * x) * np.sin(0.25 * y)], -1)


def places_of(mesh, size):
    texels = texels_of(mesh, (size, size))
    return (texels.barycentric[..., None] * mesh.vertices[mesh.faces[texels.face]]).sum(2)


def angle_between(one, other):
    """Degrees between normals given by slopes (..., 2)."""
    a, b = (np.concatenate([s, np.ones_like(s[..., :1])], -1) for s in (one, other))
    cosine = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("flip", [False, True])
def test_a_bumped_plane_gives_its_known_slopes(flip):
    mesh, scan = sheet(5, flip=flip), sheet(201, height=bump)
    baked = bake(mesh, scan, 128, 4.0, 1.0)
    at = places_of(mesh, 128)
    truth = bump_slopes(at[..., 0], at[..., 1]) * [-1 if flip else 1, 1]
    assert baked.seen.mean() == pytest.approx(0.64, abs=0.02) and baked.coverage > 0.99
    assert angle_between(baked.slopes, truth)[baked.known].max() < 0.5
    np.testing.assert_allclose(baked.distance[baked.known], np.abs(bump(*at[baked.known][:, :2].T)), atol=0.01)


def test_the_slopes_stand_when_plane_and_scan_move_together():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    mesh, scan = sheet(5), sheet(81, height=bump)
    moved = [m.with_vertices(m.vertices @ turn.T + [5, -3, 100]) for m in (mesh, scan)]
    still, after = bake(mesh, scan, 64, 4.0, 1.0), bake(*moved, 64, 4.0, 1.0)
    both = still.known & after.known
    assert both.sum() > 0.98 * still.known.sum()
    np.testing.assert_allclose(after.slopes[both], still.slopes[both], atol=2e-3)


def globe(rings, radius):
    height, turn = np.meshgrid(
        np.linspace(0.02, np.pi - 0.02, rings), np.linspace(0, 2 * np.pi, 2 * rings), indexing="ij"
    )
    points = radius * np.stack([np.sin(height) * np.sin(turn), np.cos(height), np.sin(height) * np.cos(turn)], -1)
    index = np.arange(rings * 2 * rings).reshape(rings, 2 * rings)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    uv = np.stack([turn / (2 * np.pi), 1 - height / np.pi], -1).reshape(-1, 2)
    return Mesh(points.reshape(-1, 3), faces, uv=uv)


@pytest.mark.parametrize("radius", [51.0, 49.0])
def test_a_larger_and_a_smaller_sphere_leave_a_sphere_smooth(radius):
    baked = bake(globe(24, 50.0), globe(90, radius), 128, 4.0, 1.0)
    middle = np.s_[10:118, 4:124]
    assert baked.known[middle].all()
    assert angle_between(baked.slopes, np.zeros_like(baked.slopes))[middle].max() < 1.0
    assert np.nanmean(baked.distance[middle]) == pytest.approx(1.0, abs=0.15)


def test_what_is_far_or_faces_away_is_not_believed():
    mesh = sheet(3)
    far = sheet(5, height=lambda x, y: np.where(x > 0, 10.0, 0.5))
    left = places_of(mesh, 64)[..., 0] < -22
    right = places_of(mesh, 64)[..., 0] > 22
    baked = bake(mesh, far, 64, 4.0, 1.0)
    assert baked.known[baked.seen & left].all() and not baked.known[baked.seen & right].any()
    assert (baked.slopes[~baked.known] == 0).all()
    turned = Mesh(far.vertices, far.faces[:, ::-1])
    assert not bake(mesh, turned, 64, 4.0, 1.0).known.any()


def test_the_nearer_of_two_sheets_counts():
    mesh = sheet(3)
    near, far = sheet(9, height=lambda x, y: -0.5 + 0.1 * x / 40), sheet(9, height=lambda x, y: 1.5 + 0.0 * x)
    both = Mesh(
        np.concatenate([near.vertices, far.vertices]), np.concatenate([near.faces, far.faces + len(near.vertices)])
    )
    baked = bake(mesh, both, 32, 4.0, 1.0)
    np.testing.assert_allclose(baked.slopes[baked.known][:, 0], -0.1 / 40, atol=1e-4)


def test_rays_find_the_distance_in_double_precision():
    mesh = sheet(2)
    target = RayTarget(mesh.vertices + np.array([0, 0, 1000.0]), mesh.faces)
    origins = np.array([[1.0, 2, 1000 - 0.123456789], [1, 2, 1001], [99, 0, 0]])
    faces, distances, weights = target.first(origins, np.tile([0.0, 0, 1], (3, 1)))
    assert faces[0] >= 0 and faces[1] == faces[2] == -1
    assert distances[0] == pytest.approx(0.123456789, abs=1e-9) and np.isinf(distances[1:]).all()
    hit = weights[0] @ mesh.vertices[mesh.faces[faces[0]]]
    np.testing.assert_allclose(hit[:2], [1, 2], atol=1e-9)


def test_maps_go_on_beyond_their_charts():
    mesh = sheet(3)
    seen = texels_of(mesh, (64, 64)).face >= 0
    slopes = np.where(seen[..., None], np.float32(0.3), 0)
    grown = dilated(slopes, seen, 3)
    edge = np.flatnonzero(seen[32])[0]
    np.testing.assert_allclose(grown[32, edge - 3 :][: edge + 20], 0.3)
    assert (grown[32, : edge - 3] == 0).all() and (grown[0] == 0).all()


def test_shapes_hold_what_they_add_and_blend_by_weight():
    mesh = sheet(5)
    rig = rig_of(mesh)
    scans = {
        "neutral": sheet(101, height=bump),
        "frown": sheet(101, height=lambda x, y: bump(x, y) + 0.5 * np.sin(0.3 * x)),
    }
    baking = bake_normals(rig, scans, size=64)
    x = places_of(mesh, 64)[..., 0]
    added = np.stack([-0.15 * np.cos(0.3 * x), 0 * x], -1)
    known = baking.baked["frown"].known
    assert angle_between(slopes_of(baking.rig.normal_maps["frown"]), added)[known].max() < 1.0
    assert set(baking.rig.normal_maps) == {"frown"} and baking.rig.mesh.normal_map is not None
    from blendcap.rendering.slopes import blended_slopes

    half = blended_slopes(baking.rig, np.array([0.5, 0]))
    assert angle_between(half, baking.baked["neutral"].slopes + 0.5 * added)[known].max() < 1.0


def test_correspondences_bring_a_scan_into_place():
    mesh, scan = sheet(9), sheet(81, height=bump)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = scan.with_vertices(scan.vertices @ turn.T + [100.0, -50, 7])
    points = SurfacePoints.at_vertices(["a", "b", "c", "d"], np.array([0, 8, 72, 44]), mesh)
    pairs = (points, points.positions(mesh) @ turn.T + [100.0, -50, 7])
    still = bake_normals(rig_of(mesh), {"smile": scan}, size=64)
    placed = bake_normals(rig_of(mesh), {"smile": moved}, {"smile": pairs}, size=64)
    assert placed.rms["smile"] < 1e-9
    off = placed.rig.normal_maps["smile"].astype(int) - still.rig.normal_maps["smile"]
    assert np.abs(off)[still.baked["smile"].known].max() <= 1


def test_bad_input_is_said_plainly():
    mesh = sheet(5)
    rig, scan = rig_of(mesh), sheet(9)
    with pytest.raises(InputError, match="no texture coordinates, on which"):
        bake_normals(rig_of(Mesh(mesh.vertices, mesh.faces)), {"smile": scan})
    with pytest.raises(InputError, match="'grin'"):
        bake_normals(rig, {"grin": scan})
    with pytest.raises(InputError, match="nowhere within 4 mm of the rig; give correspondences"):
        bake_normals(rig, {"smile": scan.with_vertices(scan.vertices + np.array([0, 0, 50.0]))}, size=32)
    points = SurfacePoints.at_vertices(["a", "b"], np.array([0, 8]), mesh)
    with pytest.raises(InputError, match="three or more of them known"):
        bake_normals(rig, {"smile": scan}, {"smile": (points, np.zeros((2, 3)))})
    with pytest.raises(InputError, match="no scans to bake"):
        bake_normals(rig, {})


def split(mesh, rounds):
    """Each triangle of a mesh as four, its vertices where they are."""
    import trimesh

    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(rounds):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return Mesh(vertices, faces)


@pytest.mark.slow
def test_a_wrinkle_on_a_face_comes_back():
    """Forehead wrinkles, 0.4 mm deep, cut into a finely divided face; their normals are known from their gradient."""
    from blendcap.rendering import vertex_normals

    rig = blendcap.mannequin()
    forehead = rig.regions["forehead"]
    skin = np.isin(rig.mesh.faces, np.concatenate([forehead, rig.regions["brows"]])).all(1)
    fine = split(Mesh(rig.mesh.vertices, rig.mesh.faces[skin]), 4)
    wave = lambda p: 0.4 * np.sin(1.1 * p[..., 1])  # noqa: E731
    scan = fine.with_vertices(fine.vertices + wave(fine.vertices)[:, None] * vertex_normals(fine.vertices, fine.faces))
    baked = bake(rig.mesh, scan, 1024, 4.0, 1.0)
    texels = texels_of(rig.mesh, (1024, 1024))
    inner = np.isin(rig.mesh.faces, forehead).all(1)
    known = baked.known & inner[np.maximum(texels.face, 0)]
    rows = texels.face[known]
    weights = texels.barycentric[known]
    mix = lambda values, at: np.einsum("pk,pkd->pd", weights, values[at])  # noqa: E731
    points = mix(rig.mesh.vertices, rig.mesh.faces[rows])
    gradient = np.zeros_like(points)
    gradient[:, 1] = 0.44 * np.cos(1.1 * points[:, 1])
    normals = mix(vertex_normals(rig.mesh.vertices, rig.mesh.faces), rig.mesh.faces[rows])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    pixels = uv_pixels(rig.mesh, (1024, 1024))
    u = _direction_of_u(rig.mesh, rows, pixels)
    u -= (u * normals).sum(1, keepdims=True) * normals
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    downhill = -(gradient - (gradient * normals).sum(1, keepdims=True) * normals)
    truth = np.stack([(downhill * u).sum(1), (downhill * v).sum(1)], 1)
    stored = slopes_of(normal_map_of(baked.slopes))[known]
    error = angle_between(stored, truth)
    assert np.median(error) < 5.0
    assert np.median(angle_between(0 * truth, truth)) > 10  # there was something to find


def _direction_of_u(mesh, faces, pixels):
    """The direction of u on each face, from its corners alone: another route than the one that bakes."""
    corners, flat = mesh.vertices[mesh.faces[faces]], pixels[mesh.uv_faces[faces]] * [1, -1]
    edges, chart = corners[:, 1:] - corners[:, :1], flat[:, 1:] - flat[:, :1]
    return np.einsum("fij,fjd->fid", np.linalg.inv(chart), edges)[:, 0]


def map_of(seed):
    return normal_map_of(np.random.default_rng(seed).normal(scale=0.3, size=(32, 32, 2)).astype(np.float32))


def test_maps_are_written_beside_the_rig_and_read_again(tmp_path):
    mesh = sheet(4)
    rig = replace(rig_of(mesh), normal_maps={"smile": map_of(0), "frown": map_of(1)})
    path = tmp_path / "face.glb"
    blendcap.write_rig(path, rig)
    written = sorted(f.name for f in (tmp_path / "face.normals").iterdir())
    assert written == ["000_smile.png", "001_frown.png", "manifest.json"]
    again = blendcap.read_rig(path)
    assert set(again.normal_maps) == {"smile", "frown"}
    for name, values in rig.normal_maps.items():
        np.testing.assert_array_equal(again.normal_maps[name], values)
    blendcap.write_rig(path, rig_of(mesh))  # a rig without maps leaves none behind
    assert not (tmp_path / "face.normals").exists() and not blendcap.read_rig(path).normal_maps
    assert [f.name for f in tmp_path.iterdir()] == ["face.glb"]


def test_maps_of_another_rig_are_left_out_and_said(tmp_path, caplog):
    mesh, path = sheet(4), tmp_path / "face.glb"
    blendcap.write_rig(path, replace(rig_of(mesh), normal_maps={"smile": map_of(0)}))
    blendcap.write_rig(tmp_path / "other.glb", rig_of(sheet(5)))
    (tmp_path / "other.glb").replace(path)
    assert not blendcap.read_rig(path).normal_maps
    assert "belong to another face.glb" in caplog.text


def test_a_damaged_manifest_is_said(tmp_path):
    mesh, path = sheet(4), tmp_path / "face.glb"
    blendcap.write_rig(path, replace(rig_of(mesh), normal_maps={"smile": map_of(0)}))
    manifest = tmp_path / "face.normals" / "manifest.json"
    whole = manifest.read_text()
    manifest.write_text(whole.replace('"maps"', '"mops"'))
    with pytest.raises(InputError, match="it lacks 'maps'"):
        blendcap.read_rig(path)
    manifest.write_text(whole.replace("000_smile.png", "../face.glb"))
    with pytest.raises(InputError, match="only files of its own folder"):
        blendcap.read_rig(path)
    manifest.write_text(whole)
    (tmp_path / "face.normals" / "000_smile.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match="no whole picture; bake it again"):
        blendcap.read_rig(path)
