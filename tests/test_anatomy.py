"""What is skin, told by the names that different hands give to regions."""

from dataclasses import replace

import numpy as np
import pytest

from blendcap import evaluate, mannequin
from blendcap.data import Animation
from blendcap.data.anatomy import clear_vertices, inside_vertices, is_skin


@pytest.mark.parametrize("name", ["face", "brows", "lids", "eye_region", "eyebrows", "mouth_corners", "narrow_face"])
def test_skin_keeps_its_name(name):
    assert is_skin(name)


@pytest.mark.parametrize(
    "name",
    ["eyes", "Eye", "eyeball_left", "mouth", "mouth_socket", "eye_socket_left", "gums_and_tongue", "Teeth Upper",
     "lacrimal_fluid_left", "eye_blend_left", "eye_occlusion_right", "eyelashes_left"],
)  # fmt: skip
def test_what_is_not_skin_is_known_in_every_spelling(name):
    assert not is_skin(name)


def test_the_same_face_under_other_names_is_judged_alike():
    rig = mannequin(shapes=52)
    other = {"eyes": "eyeball_left", "sockets": "eye_socket_left", "mouth": "mouth_socket", "tongue": "gums_and_tongue"}
    named = replace(rig, regions={other.get(name, name): vertices for name, vertices in rig.regions.items()})
    np.testing.assert_array_equal(inside_vertices(rig), inside_vertices(named))
    assert not inside_vertices(rig)[rig.regions["cheeks"]].any()
    truth = Animation(np.zeros((3, len(rig.names))), rig.names, 30)
    answer = Animation(np.full((3, len(rig.names)), 0.1), rig.names, 30)
    assert evaluate(answer, truth, named).vertex_rmse_mm == evaluate(answer, truth, rig).vertex_rmse_mm
    bare = replace(rig, regions={})
    assert evaluate(answer, truth, bare).vertex_rmse_mm != evaluate(answer, truth, rig).vertex_rmse_mm


def test_ict_is_judged_by_its_skin(data):
    from blendcap import read_rig

    rig = read_rig(data("rigs/ict_facekit.npz"))
    skin = np.concatenate([rig.regions["face"], rig.regions["head_and_neck"]])
    assert set(np.flatnonzero(~inside_vertices(rig))) == set(skin)
    assert set(np.flatnonzero(clear_vertices(rig))) == set(range(24591, 26719))
