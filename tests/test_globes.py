"""Eyeballs found, and lids kept above them."""

import numpy as np

from blendcap import mannequin
from blendcap.modeling.globes import Globe, clearing_push, find_globes, shared_push
from blendcap.modeling.parts import pieces


def test_the_mannequins_eyeballs_are_found_and_nothing_else():
    rig = mannequin(shapes=52)
    parts = pieces(rig.mesh.faces, len(rig.mesh.vertices))
    globes = find_globes(rig.mesh.vertices, parts[1:], rig.regions["eyes"])
    assert len(globes) == 2
    for globe in globes:
        np.testing.assert_allclose(np.abs(globe.center), [31.5, 0, 69.5], atol=0.5)
        assert abs(globe.radius - 11.8) < 0.5
    assert find_globes(rig.mesh.vertices, parts[1:], np.zeros(0, np.int64)) == []


def test_a_lid_that_cuts_into_the_eyeball_is_pushed_out_to_the_templates_height():
    old, new = (Globe(np.zeros(0, np.int64), np.zeros(3), r) for r in (10.0, 10.5))
    template, template_delta = np.array([[0, 10.6, 0], [0, 11.0, 0]]), np.array([[0, 0, 10.6], [0, 0, 0.1]])
    template_delta[0, 1] = -1.0
    rest, delta = template * 1.05, template_delta * 1.05
    delta[0, 1] -= 1.0  # half way it is too low
    push = clearing_push(template, template_delta, rest, delta, (old, new))
    assert not push[1].any()
    for weight in (0.5, 0.75, 1.0):
        height = new.height(rest[0] + weight * (delta[0] + push[0]))
        floor = min(old.height(template[0] + weight * template_delta[0]), new.height(rest[0]))
        assert height > floor - 0.15
    assert new.height(rest[0] + 0.5 * delta[0]) < old.height(template[0] + 0.5 * template_delta[0]) - 0.3


def test_what_meets_is_pushed_alike():
    push = np.array([[0, 0, 1.0], [0, 0, 0.2], [0.5, 0, 0]])
    np.testing.assert_array_equal(shared_push(push, np.array([[0, 1]])), push[[0, 0, 2]])
