"""Deformation transfer: fixed points, invariances, contact, solid bodies, and the peers' failures."""

from dataclasses import replace

import numpy as np
import pytest

from blendcap import InputError, Mesh, Rig, mannequin, transfer_rig
from blendcap.modeling.contacts import gaps
from blendcap.modeling.differences import differences
from blendcap.modeling.globes import find_globes
from blendcap.modeling.parts import pieces
from blendcap.modeling.transfer import _aligned, transfer
from blendcap.numerics.geodesic import sewn_vertices
from sheet import sheet_rig

METHODS = ("contact", "paper")


@pytest.fixture(scope="module")
def people():
    template, truth = mannequin(shapes=52), mannequin(2, shapes=52)
    return template, truth, {method: transfer(template, truth.mesh, method=method) for method in METHODS}


def posed(rig: Rig, **weights: float) -> np.ndarray:
    row = np.zeros(len(rig.names))
    for name, weight in weights.items():
        row[rig.index(name)] = weight
    return rig.pose(row)


def a_turn(seed: int = 0) -> np.ndarray:
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return turn * np.linalg.det(turn)


def other_face(rig: Rig) -> Mesh:
    """A person of the sheet: wider, with another bend."""
    x, y, z = rig.mesh.vertices.T
    return rig.mesh.with_vertices(np.stack([1.1 * x, 0.95 * y + 0.002 * x * y, z + 3 * np.sin(y / 30)], axis=1))


@pytest.mark.parametrize("method", METHODS)
def test_on_its_own_neutral_every_shape_comes_back(method):
    rig = mannequin(shapes=52) if method == "contact" else sheet_rig()
    assert np.abs(transfer_rig(rig, rig.mesh, method=method).deltas - rig.deltas).max() < 1e-5


@pytest.mark.parametrize("method", METHODS)
def test_turn_scale_and_shift_of_the_face_commute_with_transfer(method):
    rig = sheet_rig()
    face, turn = other_face(rig), a_turn()
    plain = transfer_rig(rig, face, method=method)
    moved = transfer_rig(rig, face.with_vertices(2.5 * face.vertices @ turn.T + [10, -4, 7]), method=method)
    np.testing.assert_allclose(moved.deltas, 2.5 * plain.deltas @ turn.T, atol=2e-5)


@pytest.mark.parametrize("method", METHODS)
def test_turning_and_scaling_the_template_changes_nothing(method):
    rig = sheet_rig()
    turn = a_turn(1)
    lying = replace(rig, mesh=rig.mesh.with_vertices(rig.mesh.vertices @ turn.T + 5), deltas=rig.deltas @ turn.T)
    expected = transfer_rig(rig, other_face(rig), method=method)
    np.testing.assert_allclose(transfer_rig(lying, other_face(rig), method=method).deltas, expected.deltas, atol=2e-5)


@pytest.mark.parametrize("counted", ["alike", "by area"])
def test_transfer_solves_eq_25_in_its_four_vertex_form(counted):
    """Sumner and Popović's own system, dense, with a fourth vertex a triangle, on a small mesh of uneven triangles."""
    rng = np.random.default_rng(3)
    rest = np.array([[0, 0, 0], [2, 0, 0.3], [0, 2, 0], [2, 2, -0.2], [1, 9, 0.5]])
    faces = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4]])
    new = rest * [1.2, 0.9, 1.0] + 0.1 * rng.normal(size=rest.shape)
    delta = 0.3 * rng.normal(size=rest.shape)
    delta[0] = 0  # still: takes the gauge away
    rig = Rig(Mesh(rest, faces), delta[None].astype(np.float32), ("bend",))
    pair = _aligned(rig, Mesh(new, faces), faces)
    first, second = (new[faces[:, k]] - new[faces[:, 0]] for k in (1, 2))
    area = np.linalg.norm(np.cross(first, second), axis=1) / 2
    assert area.max() > 3 * area.min()
    if counted == "alike":
        ours = transfer(rig, Mesh(new, faces), method="paper")
        deltas, cost, area = ours.rig.deltas, ours.energies, np.ones(3)
    else:
        found, costs = differences(pair)
        deltas, cost = pair.deltas + found.field, costs.at(found.field)

    def frame(v, f):
        a, b = v[f[1]] - v[f[0]], v[f[2]] - v[f[0]]
        n = np.cross(a, b)
        return np.stack([a, b, n / np.sqrt(np.linalg.norm(n))], axis=1)

    rows, right = [], []
    for k, f in enumerate(faces):
        inverse = np.linalg.inv(frame(new, f))
        wanted = frame(pair.template + pair.deltas[0], f) @ np.linalg.inv(frame(pair.template, f))
        for j in range(3):
            row = np.zeros(len(rest) + len(faces))
            row[f[0]], row[f[1]], row[f[2]], row[5 + k] = -inverse[:, j].sum(), *inverse[:, j]
            rows.append(np.sqrt(area[k]) * row)
            right.append(np.sqrt(area[k]) * wanted[:, j])
    rows, right = np.array(rows), np.array(right)
    right -= np.outer(rows[:, 0], new[0])
    answer = np.linalg.lstsq(rows[:, 1:], right, rcond=None)[0]
    np.testing.assert_allclose(new[1:] + deltas[0, 1:], answer[:4], atol=1e-5)
    assert cost[0] == pytest.approx(((rows[:, 1:] @ answer - right) ** 2).sum(), rel=1e-5)
    elsewhere = deltas - pair.deltas + 0.1 * rng.normal(size=deltas.shape) * (np.arange(5) > 0)[:, None]
    left = right - rows[:, 1:5] @ (new[1:] + pair.deltas[0, 1:] + elsewhere[0, 1:])
    left -= rows[:, 5:] @ np.linalg.lstsq(rows[:, 5:], left, rcond=None)[0]
    assert differences(pair, area)[1].at(elsewhere)[0] == pytest.approx((left**2).sum(), rel=1e-6)


def test_lids_close_and_lips_meet_where_plain_transfer_leaves_gaps(people):
    template, _, made = people
    for weights, contact in (({"eyeBlinkLeft": 1}, "lids_left"), ({"eyeBlinkRight": 1}, "lids_right"),
                             ({"jawOpen": 1, "mouthClose": 1}, "lips"), ({"mouthSmileLeft": 1}, "lips"),
                             ({"mouthPressLeft": 1}, "lips")):  # fmt: skip
        pairs = template.contacts[contact]
        own = gaps(posed(template, **weights), pairs).max()
        assert gaps(posed(made["contact"].rig, **weights), pairs).max() < own + 0.05, weights
        assert gaps(posed(made["paper"].rig, **weights), pairs).max() > own + 0.1, weights


def test_lids_stay_as_clear_of_the_eyeballs_as_the_templates(people):
    """All the skin of the lids, on the way to a blink and in a squint; plain transfer cuts deeper."""
    template, _, made = people
    skin, *others = pieces(sewn_vertices(template.mesh.vertices, template.deltas)[template.mesh.faces],
                           len(template.mesh.vertices))  # fmt: skip
    lids = np.intersect1d(skin, template.regions["lids"])

    def lowest(rig, name, weight):
        rows = lids[template.deltas[template.index(name), lids].any(1)]
        globes = find_globes(rig.mesh.vertices, others, template.regions["eyes"])
        return min(globe.height(posed(rig, **{name: weight})[rows]).min() for globe in globes)

    for name, weight in (("eyeBlinkLeft", 0.5), ("eyeBlinkLeft", 0.75), ("eyeBlinkRight", 0.5), ("eyeSquintLeft", 1)):
        assert lowest(made["contact"].rig, name, weight) > lowest(template, name, weight) - 0.03, name
        assert lowest(made["paper"].rig, name, weight) < lowest(template, name, weight) - 0.05, name


def test_what_a_shape_does_not_move_stays_put(people):
    template, _, made = people
    still = ~template.deltas.any(2)
    still[:, template.regions["eyes"]] = False  # the poles of an eyeball that turns
    assert still.any() and not made["contact"].rig.deltas[still].any()


def test_eyeballs_and_teeth_move_as_solid_bodies(people):
    template, truth, made = people
    for name, region, side in (("eyeLookUpLeft", "eyes", 1), ("jawOpen", "teeth", 0)):
        rows = template.regions[region]
        rows = rows[template.deltas[template.index(name), rows].any(1)]
        posed_truth, posed_result = (posed(rig, **{name: 1}) for rig in (truth, made["contact"].rig))
        rest, moved = (v[rows] - v[rows].mean(0) for v in (truth.mesh.vertices, posed_result))
        np.testing.assert_allclose(np.linalg.norm(moved, axis=1), np.linalg.norm(rest, axis=1), atol=1e-3)
        if side:
            np.testing.assert_allclose(posed_result[rows], posed_truth[rows], atol=0.1)


def test_shapes_are_no_farther_from_the_truth_than_plain_transfers(people):
    template, truth, made = people
    inside = np.concatenate([template.regions[k] for k in ("eyes", "teeth", "tongue", "mouth", "sockets")])
    face = np.setdiff1d(template.moving_vertices(), inside)
    error = {m: np.linalg.norm(made[m].rig.deltas[:, face] - truth.deltas[:, face], axis=2).mean() for m in METHODS}
    assert error["contact"] <= error["paper"]


def test_everything_that_names_vertices_and_shapes_is_carried_along(people):
    template, truth, made = people
    rig = made["contact"].rig
    assert rig.names == template.names and rig.combinations == template.combinations
    assert set(rig.points) == set(template.points) and set(rig.regions) == set(template.regions)
    np.testing.assert_array_equal(rig.mirror, template.mirror)
    np.testing.assert_array_equal(rig.bounds, template.bounds)
    np.testing.assert_array_equal(rig.mesh.vertices, truth.mesh.vertices)
    assert rig.mesh.uv is not None


def test_pieces_that_float_are_placed_and_a_face_without_texture_gets_the_templates_uv():
    """A second sheet, joined to nothing, which every shape moves: without a gauge it would drift away."""
    rig = sheet_rig()
    count = len(rig.mesh.vertices)
    vertices = np.concatenate([rig.mesh.vertices, rig.mesh.vertices + np.array([0, 0, -40])])
    faces = np.concatenate([rig.mesh.faces, rig.mesh.faces + count])
    lift = np.tile(np.array([0.0, 1.0, 0.0], np.float32), (len(rig.names), count, 1))
    mesh = Mesh(vertices, faces, uv=vertices[:, :2])
    double = replace(rig, mesh=mesh, deltas=np.concatenate([rig.deltas, rig.deltas + lift], axis=1))
    for method in METHODS:
        made = transfer_rig(double, Mesh(vertices * 1.3, faces), method=method)
        np.testing.assert_allclose(made.deltas, 1.3 * double.deltas, atol=1e-4)
        assert made.mesh.uv is not None and made.mesh.texture is None


def test_a_lash_follows_the_lid_that_is_mended():
    """A strip above the left lid; the new eye is 2 mm higher, so that its blink is longer than plain transfer's."""
    rig = sheet_rig()
    lid = rig.contacts["lids_left"][:, 0]
    x, y, _ = rig.mesh.vertices.T
    near = np.flatnonzero((np.abs(x - 26) < 7) & (np.abs(y - 32) < 1))
    count = len(x)
    strip = np.concatenate([rig.mesh.vertices[near] + [0, 0, 0.5], rig.mesh.vertices[near] + [0, 0.5, 2.0]])
    one, two = np.arange(len(near) - 1), np.arange(1, len(near))
    faces = np.concatenate(
        [np.stack([one, two, one + len(near)], 1), np.stack([two, two + len(near), one + len(near)], 1)]
    )
    mesh = Mesh(np.concatenate([rig.mesh.vertices, strip]), np.concatenate([rig.mesh.faces, count + faces]))
    deltas = np.concatenate([rig.deltas, rig.deltas[:, near], 0.9 * rig.deltas[:, near]], axis=1)  # it bends: no solid
    lashed = replace(rig, mesh=mesh, deltas=deltas)
    higher = mesh.vertices.copy()
    higher[mesh.vertices[:, 1] > 30, 1] += 2
    made = transfer_rig(lashed, mesh.with_vertices(higher))
    blink = made.deltas[made.index("eyeBlinkLeft")]
    assert (blink[lid, 1] < -9.5).all()
    np.testing.assert_allclose(blink[count : count + len(near)], blink[near], atol=0.3)


def test_texture_seams_stay_closed():
    """A rig from a GLB has vertices twice along seams; they must not come apart."""
    rig = sheet_rig()
    x = rig.mesh.vertices[:, 0]
    seam = np.flatnonzero(np.abs(x) < 1e-9)
    copy = np.arange(len(x))
    copy[seam] = len(x) + np.arange(len(seam))
    right = x[rig.mesh.faces].mean(1) > 0
    faces = np.where(right[:, None], copy[rig.mesh.faces], rig.mesh.faces)
    split = np.concatenate([np.arange(len(x)), seam])
    doubled = replace(rig, mesh=Mesh(rig.mesh.vertices[split], faces), deltas=rig.deltas[:, split], contacts={},
                      regions={})  # fmt: skip
    face = Mesh(other_face(rig).vertices[split], faces)
    made = transfer_rig(doubled, face, method="paper")
    np.testing.assert_array_equal(made.deltas[:, seam], made.deltas[:, len(x) :])
    np.testing.assert_allclose(made.deltas[:, : len(x)], transfer_rig(rig, other_face(rig), method="paper").deltas,
                               atol=1e-4)  # fmt: skip


def test_bad_input_is_refused_in_a_sentence():
    rig = sheet_rig()
    with pytest.raises(InputError, match="register the template to the face first"):
        transfer_rig(rig, Mesh(rig.mesh.vertices[:-1], rig.mesh.faces[:50]))
    with pytest.raises(InputError, match="other triangles"):
        transfer_rig(rig, Mesh(rig.mesh.vertices, rig.mesh.faces[::-1]))
    with pytest.raises(InputError, match="choose contact or paper"):
        transfer_rig(rig, rig.mesh, method="best")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="NaN"):
        transfer_rig(rig, rig.mesh.with_vertices(rig.mesh.vertices * np.nan))
    with pytest.raises(InputError, match="one line"):
        transfer_rig(rig, rig.mesh.with_vertices(rig.mesh.vertices * 0))


@pytest.mark.slow
def test_icts_lids_and_lips_close_on_ten_people(data):
    from blendcap.io.ict import read_ict_pack
    from blendcap.modeling.contacts import find_contacts

    path = data("rigs/ict_facekit.npz")
    skin = 9409  # vertices; the other pieces are slow and touch nothing

    def face(identity=None):
        rig = read_ict_pack(path, identity)
        mesh = Mesh(rig.mesh.vertices[:skin], rig.mesh.faces[(rig.mesh.faces < skin).all(1)])
        return Rig(mesh, rig.deltas[:, :skin], rig.names)

    template = face()
    assert not template.contacts
    contacts = find_contacts(template)
    poses = {"lids_left": {"eyeBlink_L": 1}, "lids_right": {"eyeBlink_R": 1},
             "lips_jaw_open": {"jawOpen": 1, "mouthClose": 1}}  # fmt: skip
    own = {name: gaps(posed(template, **pose), contacts[name]) for name, pose in poses.items()}
    for seed in range(10):
        person = face(np.random.default_rng(seed).normal(size=100))
        for method in METHODS:
            rig = transfer_rig(template, person.mesh, method=method)
            over = [(gaps(posed(rig, **pose), contacts[name]) - own[name]).max() for name, pose in poses.items()]
            assert (max(over) <= 0.2) == (method == "contact"), (seed, method, over)


@pytest.mark.parametrize("method", METHODS)
def test_the_face_keeps_its_own_pictures(method):
    rig = sheet_rig()
    face = other_face(rig)
    skin, bumps = np.random.default_rng(0).integers(0, 255, (2, 4, 4, 3), dtype=np.uint8)
    uv, uv_faces = face.vertices[:, :2] / 200 % 1, face.faces
    dressed = Mesh(face.vertices, face.faces, face.polygons, uv, uv_faces, skin, bumps)
    given = transfer_rig(rig, dressed, method=method).mesh
    np.testing.assert_array_equal(given.texture, skin)
    np.testing.assert_array_equal(given.normal_map, bumps)
    np.testing.assert_array_equal(given.uv, uv)
