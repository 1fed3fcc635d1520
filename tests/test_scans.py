from dataclasses import replace

import igl
import numpy as np
import pytest
import trimesh

from blendcap import InputError, mannequin, read_rig
from blendcap.numerics.barycentric import barycentric
from blendcap.rendering import vertex_normals
from blendcap.synthetic.performer import make_performer
from blendcap.synthetic.scans import Scan, make_scan
from blendcap.synthetic.scans_surface import DISTANCE, VIEWS

SPACING = 3.0


@pytest.fixture(scope="module")
def rig():
    return mannequin(3, 52)


@pytest.fixture(scope="module")
def scan(rig):
    return make_scan(rig, seed=1, spacing=SPACING)


@pytest.fixture(scope="module")
def bare(rig):
    """Without anything that goes wrong."""
    return make_scan(rig, seed=1, spacing=SPACING, noise=0.0, holes=0, clutter=False)


def deviations(scan: Scan) -> np.ndarray:
    return (scan.mesh.vertices - scan.carried(scan.expression.vertices))[~scan.clutter]


def test_every_vertex_lies_where_its_truth_says(bare, scan):
    assert not bare.clutter.any()
    assert np.abs(deviations(bare)).max() < 1e-9
    assert np.allclose(bare.barycentric.sum(1), 1) and bare.barycentric.min() >= 0
    assert scan.clutter.any() and np.isnan(scan.carried(scan.neutral.vertices)[scan.clutter]).all()


def test_noise_is_along_the_normal(scan):
    off = deviations(scan)
    assert off.std(0).max() < 0.1
    length = np.linalg.norm(off, axis=1)
    assert np.sqrt((length**2).mean()) == pytest.approx(0.1, rel=0.03)
    normals = vertex_normals(scan.expression.vertices, scan.expression.faces)
    normals = scan.carried(normals)[~scan.clutter]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.median(np.abs((off * normals).sum(1)) / length) > 0.99


def test_an_expression_is_scanned_with_the_performers_correctives(rig):
    performer = make_performer(rig, seed=2, strength=1.5)
    weights = np.zeros(len(rig.names))
    weights[[rig.index(n) for n in ("jawOpen", "mouthSmileLeft", "mouthSmileRight", "browInnerUp")]] = 0.8
    weights[performer.drivers[0]] = 1.0
    smile = make_scan(performer, weights, seed=3, spacing=4.0, noise=0.0, clutter=False)
    assert np.abs(deviations(smile)).max() < 1e-9
    assert np.allclose(smile.expression.vertices, performer.pose(weights))
    assert np.allclose(smile.landmarks, rig.points["landmarks68"].positions(smile.expression))
    assert np.array_equal(smile.neutral.vertices, performer.rig.mesh.vertices)


def test_only_what_is_open_to_the_cameras_is_scanned(rig, bare):
    inside = np.concatenate([rig.regions[n] for n in ("teeth", "tongue", "mouth")])
    on_inside = np.isin(rig.mesh.faces[bare.faces], inside).all(1)
    assert not on_inside.any()
    ray = trimesh.Trimesh(rig.mesh.vertices, rig.mesh.faces, process=False).ray
    middle = (rig.mesh.vertices.min(0) + rig.mesh.vertices.max(0)) / 2
    normals = vertex_normals(bare.mesh.vertices, bare.mesh.faces)
    start, free = bare.mesh.vertices + 0.3 * normals, np.zeros(len(normals), dtype=bool)
    for pitch, yaws in VIEWS:
        for yaw in yaws:
            p, y = np.deg2rad([pitch, yaw])
            eye = middle + DISTANCE * np.array([np.sin(y) * np.cos(p), np.sin(p), np.cos(y) * np.cos(p)])
            hidden = np.flatnonzero(~free)
            free[hidden] = ~ray.intersects_any(start[hidden], eye - start[hidden])
    assert free.mean() > 0.995


def test_the_back_of_the_head_is_missing_and_the_face_is_whole(rig, bare):
    used = np.unique(rig.mesh.faces[bare.faces])
    behind = np.flatnonzero((rig.mesh.vertices[:, 2] < -75) & (np.abs(rig.mesh.vertices[:, 0]) < 20))
    assert len(behind) > 10 and not np.isin(behind, used).any()
    face = np.concatenate([rig.regions[n] for n in ("forehead", "glabella", "cheeks", "jaw")])
    tree = igl.AABB()
    tree.init(bare.mesh.vertices, bare.mesh.faces)
    squared = tree.squared_distance(bare.mesh.vertices, bare.mesh.faces, rig.mesh.vertices[face])[0]
    assert np.sqrt(squared).max() < 0.5


def test_closed_lips_are_one_surface(rig, bare):
    welded = rig.contacts["lips"]
    mouth = rig.mesh.vertices[welded[:, 0]]
    border = trimesh.Trimesh(bare.mesh.vertices, bare.mesh.faces, process=False)
    lonely = trimesh.grouping.group_rows(border.edges_sorted, require_count=1)
    edge_points = bare.mesh.vertices[border.edges_sorted[lonely]].mean(1)
    middle = mouth[np.abs(mouth[:, 0]) < 0.7 * np.abs(mouth[:, 0]).max()]
    assert np.linalg.norm(edge_points[:, None] - middle, axis=2).min() > 3 * SPACING


def test_the_topology_is_even_manifold_and_its_own(rig, bare, scan):
    for mesh in (bare.mesh, scan.mesh):
        edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert np.unique(edges, axis=0, return_counts=True)[1].max() == 2
        assert len(np.unique(mesh.faces)) == len(mesh.vertices)
        lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
        assert np.median(lengths) == pytest.approx(SPACING, rel=0.1)
        assert (np.abs(lengths / SPACING - 1) < 0.75).mean() > 0.99
    a, b, c = np.moveaxis(bare.mesh.vertices[bare.mesh.faces], 1, 0)
    squares = ((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2).sum(1)
    shape = 2 * np.sqrt(3) * np.linalg.norm(np.cross(b - a, c - a), axis=1) / squares  # 1: equilateral, 0: a line
    assert shape.mean() > 0.92 and np.quantile(shape, 0.05) > 0.77
    assert (bare.barycentric.max(1) > 0.98).mean() < 0.01  # of the template's vertices next to none
    normals = vertex_normals(rig.mesh.vertices, rig.mesh.faces)
    agree = (bare.carried(normals) * vertex_normals(bare.mesh.vertices, bare.mesh.faces)).sum(1)
    assert (agree > 0).mean() > 0.995  # they face outwards


def test_holes_are_where_the_scan_says(rig, scan, bare):
    assert scan.holes.shape == (5, 4) and bare.holes.shape == (0, 4)
    arms = np.linalg.norm(scan.mesh.vertices[:, None] - scan.holes[:, :3], axis=2)
    assert (arms > scan.holes[:, 3]).all()
    whole = np.linalg.norm(bare.mesh.vertices[:, None] - scan.holes[:, :3], axis=2)
    assert ((whole < scan.holes[:, 3]).sum(0) > 0).all()
    assert (np.abs(np.linalg.norm(scan.holes[:, :3] - scan.landmarks[30], axis=1)) < 140).all()


def test_clutter_is_off_the_skin_where_people_wear_it(rig, scan):
    tree = igl.AABB()
    tree.init(rig.mesh.vertices, rig.mesh.faces)
    extra = scan.mesh.vertices[scan.clutter]
    away = np.sqrt(tree.squared_distance(rig.mesh.vertices, rig.mesh.faces, extra)[0])
    assert np.median(away) > 3 and (away > 0.3).mean() > 0.97
    brows, chin = scan.landmarks[17:27, 1].mean(), scan.landmarks[8, 1]
    in_face = (extra[:, 1] < brows) & (extra[:, 1] > chin) & (extra[:, 2] > scan.landmarks[36, 2])
    assert not in_face.any()
    assert (extra[:, 1] > brows).mean() > 0.3 and (extra[:, 1] < chin - 20).mean() > 0.1
    locks = (extra[:, 2] > scan.landmarks[36, 2]) & (extra[:, 1] < brows + 40)
    assert locks.any()


def texel(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    row = np.clip((1 - uv[:, 1]) * height, 0, height - 1).astype(int)
    return image[row, np.clip(uv[:, 0] * width, 0, width - 1).astype(int)].astype(float) + 1


def test_the_texture_shows_the_face_and_has_seams(rig, scan):
    mesh = scan.mesh
    assert mesh.uv.min() >= 0 and mesh.uv.max() <= 1 and mesh.uv_faces.shape == mesh.faces.shape
    color = texel(mesh.texture, mesh.uv)
    owner = np.empty(len(mesh.uv), dtype=int)
    owner[mesh.uv_faces.ravel()] = mesh.faces.ravel()
    face = ~scan.clutter & (np.linalg.norm(mesh.vertices - scan.landmarks[30], axis=1) < 90)
    uv = np.einsum("vk,vkc->vc", scan.barycentric, rig.mesh.uv[rig.mesh.uv_faces[scan.faces]])
    true = texel(rig.mesh.texture, uv)
    shown, painted = (np.log(c[:, 0] / c[:, 1]) for c in (color[face[owner]], true[owner][face[owner]]))
    assert np.corrcoef(shown, painted)[0, 1] > 0.5  # its redness: lips, brows, eyes are where they belong
    order = np.argsort(owner, kind="stable")
    double = np.flatnonzero(np.diff(owner[order]) == 0)
    jump = np.linalg.norm(color[order[double]] - color[order[double + 1]], axis=1)
    assert len(double) > 100 and np.median(jump) > 4


def test_a_seed_is_a_scan(rig, scan):
    again, other = (make_scan(rig, seed=s, spacing=SPACING) for s in (1, 2))
    assert np.array_equal(again.mesh.vertices, scan.mesh.vertices)
    assert np.array_equal(again.mesh.texture, scan.mesh.texture)
    assert np.array_equal(again.mesh.faces, scan.mesh.faces) and np.array_equal(again.holes, scan.holes)
    assert other.mesh.vertices.shape != scan.mesh.vertices.shape or not np.allclose(
        other.mesh.vertices, scan.mesh.vertices
    )


def test_a_rig_without_texture_is_scanned_too(rig):
    plain = replace(rig, mesh=type(rig.mesh)(rig.mesh.vertices, rig.mesh.faces))
    scan = make_scan(plain, seed=4, spacing=5.0)
    assert scan.mesh.texture is not None and scan.clutter.any()
    assert np.sqrt((deviations(scan) ** 2).sum(1).mean()) == pytest.approx(0.1, rel=0.06)


def test_bad_input_is_told_in_a_sentence(rig):
    with pytest.raises(InputError, match="landmarks68"):
        make_scan(replace(rig, points={}), seed=0)
    with pytest.raises(InputError, match=r"between 0\.3 and 20"):
        make_scan(rig, seed=0, spacing=0.0)
    with pytest.raises(InputError, match="52 shapes, but there are 3"):
        make_scan(rig, np.zeros(3), seed=0)
    with pytest.raises(InputError, match="one expression"):
        make_scan(rig, np.zeros((2, 52)), seed=0)
    with pytest.raises(InputError, match="holes"):
        make_scan(rig, seed=0, spacing=8.0, holes=-1)


def test_barycentric_weights_give_the_point_back():
    rng = np.random.default_rng(0)
    corners, weights = rng.normal(size=(50, 3, 3)), rng.dirichlet(np.ones(3), size=50)
    assert np.allclose(barycentric(np.einsum("pk,pkc->pc", weights, corners), corners), weights)


@pytest.mark.slow
def test_ict_is_scanned_without_its_clear_layers(data):
    ict = read_rig(data("rigs/ict_facekit.npz"))
    performer = make_performer(ict, seed=1, strength=0.0)
    scan = make_scan(performer, seed=5)
    assert 60_000 < len(scan.mesh.vertices) < 130_000
    clear = [v for n, v in ict.regions.items() if any(word in n for word in ("lash", "occlusion", "lacrimal", "blend"))]
    assert not np.isin(ict.mesh.faces[scan.faces[~scan.clutter]], np.concatenate(clear)).any()
    off = deviations(scan)
    assert np.sqrt((off**2).sum(1).mean()) == pytest.approx(0.1, rel=0.02)
