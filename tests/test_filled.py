"""Gaps that other software filled: found where they are, and nothing that was measured is thrown away."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation

import blendcap
from blendcap.data import MarkerTake
from blendcap.markers.filled import FilledStretch, drop_stretches, filled_stretches
from stage import scene, talk

FRAMES, MARKERS, RATE = 600, 16, 60.0
NOISE = 0.1  # mm
PATHS = {
    "line": lambda seen, values: lambda frames: np.stack([np.interp(frames, seen, v) for v in values.T], 1),
    "spline": CubicSpline,
    "pchip": PchipInterpolator,
}


def face(seed=0, noise=NOISE, frames=FRAMES, head=5.0):
    """Markers that go their own ways by some mm, on a head that turns, in a camera's noise."""
    rng = np.random.default_rng(seed)
    own = gaussian_filter1d(rng.normal(size=(frames, MARKERS, 3)), 12, axis=0) * 12
    angles, shift = (gaussian_filter1d(rng.normal(size=(frames, 3)), 25, axis=0) * head for _ in range(2))
    turned = np.einsum(
        "tij,tmj->tmi", Rotation.from_rotvec(angles * 0.1).as_matrix(), rng.normal(0, 50, (MARKERS, 3)) + own
    )
    positions = turned + 5 * shift[:, None] + noise * rng.normal(size=turned.shape)
    return MarkerTake(positions.astype(np.float32), [f"m{i}" for i in range(MARKERS)], RATE)


def simulated(seed, frames=900, markers=30, shapes=8):
    """Markers of a face that a few shapes move, on a helmet that slips, without noise."""
    rng = np.random.default_rng(seed)
    places, centers = rng.uniform(-60, 60, (markers, 3)), rng.uniform(-60, 60, (shapes, 3))
    reach = np.exp(-((np.linalg.norm(places[:, None] - centers, axis=2) / 25) ** 2))
    weights = np.clip(gaussian_filter1d(rng.normal(size=(frames, shapes)), 6, axis=0) * 4 - 0.3, 0, 1)
    own = places + np.einsum("ts,msd->tmd", weights, reach[..., None] * rng.normal(0, 8, (shapes, 3)))
    slip = gaussian_filter1d(rng.normal(size=(frames, 6)), 40, axis=0) * 5
    turned = np.einsum("tij,tmj->tmi", Rotation.from_rotvec(slip[:, :3] * 0.05).as_matrix(), own)
    return MarkerTake((turned + slip[:, None, 3:]).astype(np.float32), [f"m{i}" for i in range(markers)], RATE)


def with_path(take, marker, first, last, kind="spline"):
    positions = take.positions.copy()
    seen = np.r_[first - 3 : first, last + 1 : last + 4]
    frames = np.arange(first, last + 1)
    positions[frames, marker] = PATHS[kind](seen, positions[seen, marker])(frames)
    return replace(take, positions=positions.astype(np.float32))


def with_copy(take, marker, sources, first, last):
    """The rigid-body fill: along the axes of three markers, by a line from the place before to that after."""
    positions = take.positions.copy()
    part = positions[first - 1 : last + 2]
    origin, axis, plane = (part[:, k] for k in sources)
    x = (axis - origin) / np.linalg.norm(axis - origin, axis=1, keepdims=True)
    normal = np.cross(x, plane - origin)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(normal, x), normal], 1)
    place = np.einsum("tij,tj->ti", axes, part[:, marker] - origin)
    way = np.linspace(place[0], place[-1], len(place))
    positions[first : last + 1, marker] = (origin + np.einsum("tij,ti->tj", axes, way))[1:-1]
    return replace(take, positions=positions.astype(np.float32))


def smoothed(take, hertz=10.0):
    return replace(take, positions=filtfilt(*butter(4, hertz / (take.rate / 2)), take.positions, axis=0))


def near(stretch, first, last, by=4):
    return abs(stretch.first - first) <= by and abs(stretch.last - last) <= by


@pytest.mark.parametrize("kind", PATHS)
@pytest.mark.parametrize("length", [16, 40, 200])
def test_a_path_that_was_drawn_through_a_gap_is_found(kind, length):
    (found,) = filled_stretches(with_path(face(), 5, 100, 99 + length, kind))
    assert found.marker == "m5" and found.sources == () and near(found, 100, 99 + length)


@pytest.mark.parametrize("seed", range(3))
def test_a_marker_that_was_moved_along_with_three_others_is_found_and_they_are_not(seed):
    (found,) = filled_stretches(with_copy(face(seed), 3, (7, 1, 9), 200, 419))
    assert found.marker == "m3" and found.sources == ("m7", "m1") and near(found, 200, 419)
    assert str(found) == f"m3 in frames {found.first} to {found.last} (moved along with m7 and m1)"


def test_a_copy_of_a_copy_and_its_source_are_found():
    take = with_copy(with_copy(face(), 3, (7, 1, 9), 150, 449), 12, (3, 5, 8), 200, 399)
    found = {stretch.marker: stretch for stretch in filled_stretches(take)}
    assert found.keys() == {"m3", "m12"}
    assert near(found["m3"], 150, 449) and near(found["m12"], 200, 399) and found["m12"].sources == ("m3", "m5")


def test_a_take_that_was_smoothed_after_it_was_filled_still_tells():
    take = with_copy(with_path(face(), 5, 100, 219), 3, (7, 1, 9), 300, 539)
    found = {stretch.marker: stretch for stretch in filled_stretches(smoothed(take))}
    assert found.keys() == {"m3", "m5"} and near(found["m3"], 300, 539, by=15) and near(found["m5"], 100, 219, by=15)


@pytest.mark.parametrize("seed", range(4))
def test_what_was_measured_is_left_alone(seed):
    take = face(seed)
    for measured in (take, smoothed(take), smoothed(take, 4.0), replace(take, rate=200.0), face(seed, head=0.0)):
        assert filled_stretches(measured) == ()
        assert drop_stretches(measured, ()) is measured


def test_without_noise_nothing_is_found():
    """Simulated faces rest, go by cubics and keep their distances: none of this was filled."""
    still = face(noise=0.0, head=0.0).positions.copy()
    still[100:300, :8] = still[100, :8]
    skull = face(noise=0.0).positions.copy()
    skull[:, :6] = skull[:, [0]] + (skull[0, :6] - skull[0, 0])
    spline = CubicSpline(np.arange(0, 601, 50), np.random.default_rng(0).normal(0, 5, (13, 16, 3)))(np.arange(600))
    for positions in (still, skull, spline, np.zeros_like(still)):
        assert filled_stretches(MarkerTake(positions, face().names, RATE)) == ()


@pytest.mark.parametrize("seed", range(3))
def test_a_simulated_face_has_parts_that_go_together_and_none_is_a_copy(seed):
    assert filled_stretches(simulated(seed)) == filled_stretches(smoothed(simulated(seed))) == ()


@pytest.mark.parametrize("part", [0.6, 0.9])
def test_a_marker_that_flickers_keeps_the_frames_in_which_it_does_not(part):
    """Most of its frames are in a noise 20 times that of the others, the rest in theirs."""
    take, rng = face(), np.random.default_rng(1)
    positions = take.positions.copy()
    start = int((1 - part) * FRAMES)
    positions[start:, 5] += 2 * rng.normal(size=(FRAMES - start, 3))
    assert filled_stretches(replace(take, positions=positions)) == ()


@pytest.mark.parametrize("hertz", [3.0, 6.0])
def test_a_stretch_that_was_smoothed_was_measured(hertz):
    take = face()
    positions = take.positions.copy()
    positions[200:300, 4] = smoothed(take, hertz).positions[200:300, 4]
    assert filled_stretches(replace(take, positions=positions)) == ()


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02, 0.05])
@pytest.mark.parametrize("seed", range(3))
def test_positions_that_were_rounded_more_coarsely_than_they_tremble_tell_nothing(seed, noise):
    take = simulated(seed)
    positions = take.positions + noise * np.random.default_rng(seed).normal(size=take.positions.shape)
    assert filled_stretches(replace(take, positions=np.round(positions, 1))) == ()


def test_frames_in_which_nobody_trembles_are_left_alone():
    """A recorder that lost frames repeats or bridges them for all markers; then nothing is special about one."""
    take = face()
    for marker in range(MARKERS):
        take = with_path(take, marker, 200, 259)
    assert filled_stretches(take) == ()


def test_a_marker_that_rests_is_no_path():
    positions = face(head=0.0).positions.copy()
    positions[100:200, 4] = positions[100, 4]
    assert filled_stretches(replace(face(), positions=positions)) == ()


def test_the_answer_knows_no_axes_and_no_unit():
    take = with_copy(with_path(face(), 5, 100, 219), 3, (7, 1, 9), 300, 539)
    turned = take.positions @ Rotation.from_rotvec([0.3, -0.8, 0.2]).as_matrix().T * 25.4 + [100.0, 20.0, -7.0]
    assert filled_stretches(replace(take, positions=turned)) == filled_stretches(take) != ()


def test_short_takes_few_markers_and_gaps_are_no_trouble():
    for frames, markers in ((1, 3), (23, 16), (24, 16), (600, 1), (600, 2), (600, 3)):
        take = face(frames=frames)
        assert filled_stretches(take.select(take.names[:markers])) == ()
    positions = with_path(face(), 5, 100, 219).positions.copy()
    positions[150:400, 1] = np.nan
    positions[:, 2] = np.nan
    (found,) = filled_stretches(replace(face(), positions=positions))
    assert found.marker == "m5" and near(found, 100, 219)


def test_what_a_longer_gap_may_bridge_is_kept():
    take = with_path(face(), 5, 100, 130)
    assert len(filled_stretches(take, 0.4)) == 1 and filled_stretches(take, 1.0) == () == filled_stretches(take, 1e9)


def test_dropping_marks_the_stretch_missing_and_nothing_else():
    take = face()
    dropped = drop_stretches(take, [FilledStretch("m5", 10, 20), FilledStretch("elsewhere", 0, 5)])
    assert np.argwhere(dropped.missing).tolist() == [[f, 5] for f in range(10, 21)]
    np.testing.assert_array_equal(dropped.positions[~dropped.missing], take.positions[~dropped.missing])


def test_a_solve_says_so_and_does_without(caplog):
    """The answer is that of the take with the stretch missing; a longer `longest_gap` gives that of the file."""
    filmed = scene(talk(), noise=0.2, seed=2)
    filled = with_path(filmed.take, 4, 60, 119, "line")
    with caplog.at_level(logging.WARNING):
        solution = filmed.solve(filled, head="keep", passes=1)
    (stretch,) = filled_stretches(filled)
    assert stretch.marker == filled.names[4] and near(stretch, 60, 119)
    assert "Other software filled gaps" in caplog.text and str(stretch) in caplog.text
    assert solution.settings["filled by other software"] == str(stretch)
    assert np.isnan(solution.residuals[stretch.first : stretch.last + 1, 4]).all()
    missing = filmed.solve(drop_stretches(filled, [stretch]), head="keep", passes=1)
    np.testing.assert_array_equal(solution.animation.weights, missing.animation.weights)
    caplog.clear()
    kept = filmed.solve(filled, head="keep", longest_gap=10.0, passes=1)
    assert "Other software" not in caplog.text and np.isfinite(kept.residuals[:, 4]).all()
    assert "filled by other software" not in kept.settings


@pytest.mark.parametrize(
    ("name", "filled"),
    [
        (
            "Eyebrows",
            {"ForeHead_L", "Leyebrow_Inside", "Eyebrow_Center", "Reyebrow_M", "Leye_Up", "Reye_Up", "Reye_Down",
             "Reye_Outside", "Mouth_Lend"},
        ),
        ("Jaw", {"Leyebrow_Inside", "Eyebrow_Center", "Chin_R1"}),
    ],
)  # fmt: skip
def test_real_faces(data, name, filled):
    """Each was judged by its curves: straight lines or cubics, in space or along the axes of its sources."""
    found = filled_stretches(blendcap.read_markers(data(f"markers/animface_{name}.c3d")))
    assert {stretch.marker for stretch in found} == filled


@pytest.mark.parametrize("name", ["c3d.org__sample01__Eb015pi", "c3d.org__sample13__Dance", "ezc3d_Vicon"])
def test_real_bodies_have_none(data, name):
    assert filled_stretches(blendcap.read_markers(data(f"c3d/{name}.c3d"))) == ()
