"""Lips that an answer parts while nothing around them does."""

from dataclasses import replace

import numpy as np
import pytest

from blendcap.data import Animation, Binding, Certificate, Mesh, Rig, Solution, SurfacePoints
from blendcap.view.concerns import concerns
from blendcap.view.parted_lips import parted_lips

FRAMES, RATE = 240, 60.0
ROWS = np.array([14.0, 0.1, -0.1, -14.0])  # skin above, upper lip, lower lip, skin below, mm
ABOVE, UPPER, LOWER, BELOW = (np.arange(5) + 5 * k for k in range(4))


@pytest.fixture(scope="module")
def rig():
    x = np.linspace(-20, 20, 5)
    vertices = np.array([[u, v, 0] for v in ROWS for u in x])
    strips = [(a[k], a[k + 1], b[k]) for a, b in ((ABOVE, UPPER), (LOWER, BELOW)) for k in range(4)]
    strips += [(a[k + 1], b[k + 1], b[k]) for a, b in ((ABOVE, UPPER), (LOWER, BELOW)) for k in range(4)]
    strips += [(ABOVE[0], UPPER[0], LOWER[0])]  # a corner of the mouth, so that it is one skin
    deltas = np.zeros((2, 20, 3), dtype=np.float32)
    deltas[0, 10:, 1] = -10  # the jaw takes lip and skin along
    deltas[1, LOWER, 1] = -4  # no marker sees this
    return Rig(Mesh(vertices, np.array(strips)), deltas, ("jawOpen", "mouthLowerDown"))


@pytest.fixture(scope="module")
def binding(rig):
    points = SurfacePoints.at_vertices(("up", "down", "aside"), [ABOVE[2], BELOW[2], ABOVE[0]], rig.mesh)
    return Binding(points, np.eye(3), np.zeros(3), 1.0, np.full((3, 3), 0.3), np.array([]))


def answer(rig, binding, weights):
    fitted = np.stack([binding.points.positions(rig.mesh.with_vertices(rig.pose(row))) for row in weights])
    certificate = Certificate(0.0, 1.0, True, np.zeros(FRAMES))
    none = np.zeros(fitted.shape[:2])
    return Solution(
        Animation(weights, rig.names, RATE), none, none[:, 0], {}, certificate, binding.points.names,
        targets=fitted + binding.offsets, fitted=fitted + binding.offsets,
    )  # fmt: skip


def moved(shape, first=80, last=179):
    weights = np.zeros((FRAMES, 2))
    weights[first : last + 1, shape] = 1.0
    return weights


def test_lips_that_no_marker_saw_parting_are_named(rig, binding):
    solution = answer(rig, binding, moved(1))
    way, first, last = parted_lips(rig, solution, binding)
    assert way == pytest.approx(4.0) and abs(first - 80) <= 15 and abs(last - 179) <= 15
    (said,) = [s for s in concerns(rig, solution, binding) if "lips" in s]
    assert said.startswith("The lips are up to 4.0 mm apart from frame 8") and "by hand if they were shut" in said


def test_given_contacts_in_any_order_say_the_same(rig, binding):
    pairs = np.stack([np.r_[UPPER[:2], LOWER[2:]], np.r_[LOWER[:2], UPPER[2:]]], 1)
    solution = answer(rig, binding, moved(1))
    assert parted_lips(replace(rig, contacts={"lips": pairs}), solution, binding) == parted_lips(rig, solution, binding)


def test_mouths_that_open_or_shut_for_good_are_not(rig, binding):
    for weights in (moved(0), moved(0) + moved(1), np.zeros((FRAMES, 2)), moved(1, 100, 118)):
        assert parted_lips(rig, answer(rig, binding, weights), binding) is None


def test_what_cannot_be_told_is_not_said(rig, binding):
    solution = answer(rig, binding, moved(1))
    lost = solution.targets.copy()
    lost[:, 1] = np.nan
    lone = replace(binding, points=binding.points.select(("up", "aside")), offsets=binding.offsets[:2])
    stiff = replace(rig, names=("somethingElse", "mouthLowerDown"))
    assert parted_lips(rig, replace(solution, targets=lost), binding) is None
    assert parted_lips(rig, replace(solution, targets=None), binding) is None
    assert parted_lips(rig, solution, lone) is None
    assert parted_lips(stiff, answer(stiff, binding, moved(1)), binding) is None
