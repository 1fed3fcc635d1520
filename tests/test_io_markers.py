"""Marker takes: C3D, TRC and our CSV."""

import logging
import struct

import numpy as np
import pytest

from blendcap.data import InputError, MarkerTake
from blendcap.io import describe, read_markers, write_markers

C3D = ["c3d.org__sample01__Eb015pi.c3d", "c3d.org__sample01__Eb015pr.c3d", "c3d.org__sample10__TYPE-4.C3D",
       "ezc3d_Optotrak.c3d", "ezc3d_Vicon.c3d", "others__MyCube.c3d"]  # fmt: skip
REFUSED = {"c3d.org__sample02__sgi_real.c3d": "MIPS", "c3d.org__sample18__bad_parameter_section.c3d": "LABELS"}


def take(frames=9, markers=4, rate=59.94, seed=0) -> MarkerTake:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(frames, markers, 3)) * 80
    positions[2, 1] = np.nan
    positions[5:, 3] = np.nan
    return MarkerTake(positions, tuple(f"m{i}" for i in range(markers)), rate)


@pytest.mark.parametrize("ending", [".c3d", ".trc", ".csv"])
def test_a_take_survives_a_round_trip(tmp_path, ending):
    first = take()
    write_markers(tmp_path / f"take{ending}", first)
    back = read_markers(tmp_path / f"take{ending}")
    assert back.names == first.names
    assert back.rate == pytest.approx(first.rate, rel=1e-7)
    np.testing.assert_array_equal(back.missing, first.missing)
    np.testing.assert_allclose(back.positions, first.positions, atol=2e-5)


def test_c3d_keeps_residuals_and_writes_missing_as_minus_one(tmp_path):
    import ezc3d

    first = take()
    residuals = np.random.default_rng(1).random(first.missing.shape)
    write_markers(tmp_path / "take.c3d", MarkerTake(first.positions, first.names, 60.0, residuals))
    back = read_markers(tmp_path / "take.c3d")
    seen = ~first.missing
    np.testing.assert_allclose(back.residuals[seen], residuals[seen], atol=residuals.max() / 254 * 1.01)
    assert np.isnan(back.residuals[~seen]).all()
    raw = ezc3d.c3d(str(tmp_path / "take.c3d"))["data"]["meta_points"]["residuals"][0].T
    assert (raw[~seen] == -1).all()
    assert (raw[seen] >= 0).all()


def test_more_than_255_markers_and_more_than_65535_frames(tmp_path, caplog):
    wide = take(frames=6, markers=300)
    write_markers(tmp_path / "wide.c3d", wide)
    assert read_markers(tmp_path / "wide.c3d").names == wide.names
    long = take(frames=70_000, markers=4)
    with caplog.at_level(logging.WARNING):
        write_markers(tmp_path / "long.c3d", long)
        back = read_markers(tmp_path / "long.c3d")
    assert "65,535" in caplog.text
    assert len(back.positions) == 70_000
    np.testing.assert_allclose(back.positions[-3:], long.positions[-3:], atol=1e-4)


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "in"])
def test_lengths_become_millimetres(tmp_path, unit):
    scale = {"mm": 1, "cm": 10, "m": 1000, "in": 25.4}[unit]
    (tmp_path / "a.csv").write_text(f"# unit: {unit}\n# rate: 60\nframe,time,n_x,n_y,n_z\n0,0,1,2,3\n")
    np.testing.assert_allclose(read_markers(tmp_path / "a.csv").positions[0, 0], np.array([1, 2, 3]) * scale)
    np.testing.assert_allclose(read_markers(tmp_path / "a.csv", unit="cm").positions[0, 0], [10, 20, 30])


def rewrite_c3d(path, old: bytes, new: bytes) -> None:
    content = path.read_bytes()
    assert content.count(old) == 1
    path.write_bytes(content.replace(old, new))


def test_c3d_units_labels_and_model_outputs(tmp_path, caplog):
    import ezc3d

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["UNITS"]["value"], point["RATE"]["value"] = ["m"], [100.0]
    point["LABELS"]["value"] = ["nose", "KneeAngle", "nose", "  ", "Force"]
    file.add_parameter("POINT", "ANGLES", ["KneeAngle"])
    file.add_parameter("POINT", "FORCES", ["Force"])
    file["data"]["points"] = np.ones((4, 5, 3))
    file["data"]["analogs"] = np.zeros((1, 0, 3))
    file.write(str(tmp_path / "a.c3d"))
    back = read_markers(tmp_path / "a.c3d")
    assert back.names == ("nose", "nose#2", "unnamed3")
    assert "more than once" in caplog.text
    np.testing.assert_allclose(back.positions, 1000)
    rewrite_c3d(tmp_path / "a.c3d", b"\x05\x01UNITS", b"\x05\x01UNITZ")
    with pytest.raises(InputError, match="unit"):
        read_markers(tmp_path / "a.c3d")
    assert read_markers(tmp_path / "a.c3d", unit="mm").positions[0, 0, 0] == 1


def test_c3d_with_analog_channels(tmp_path):
    import ezc3d

    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["a", "b"]
    file["parameters"]["ANALOG"]["RATE"]["value"] = [500.0]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = ["emg"]
    points = np.random.default_rng(0).normal(size=(4, 2, 7))
    file["data"]["points"], file["data"]["analogs"] = points, np.random.default_rng(1).normal(size=(1, 1, 35))
    file.write(str(tmp_path / "a.c3d"))
    np.testing.assert_allclose(read_markers(tmp_path / "a.c3d").positions, points[:3].transpose(2, 1, 0), atol=1e-6)


def test_rate_zero_and_no_frames_are_refused(tmp_path):
    write_markers(tmp_path / "a.c3d", take(rate=60.0))
    content = bytearray((tmp_path / "a.c3d").read_bytes())
    place = content.index(struct.pack("<f", 60.0), content.index(b"RATE"))
    content[place : place + 4] = bytes(4)
    (tmp_path / "a.c3d").write_bytes(content)
    with pytest.raises(InputError, match="positive number of frames a second"):
        read_markers(tmp_path / "a.c3d")
    (tmp_path / "a.csv").write_text("# unit: mm\n# rate: 0\nframe,time,n_x,n_y,n_z\n0,0,1,2,3\n")
    with pytest.raises(InputError, match="positive number of frames a second"):
        read_markers(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("# unit: mm\n# rate: 60\nframe,time,n_x,n_y,n_z\n")
    with pytest.raises(InputError, match="no rows"):
        read_markers(tmp_path / "a.csv")


def test_csv_without_unit_or_rate_says_what_to_add(tmp_path):
    (tmp_path / "a.csv").write_text("# rate: 60\nn_x,n_y,n_z\n1,2,3\n")
    with pytest.raises(InputError, match="# unit: mm"):
        read_markers(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("# unit: mm\nn_x,n_y,n_z\n1,2,3\n")
    with pytest.raises(InputError, match="# rate: 60"):
        read_markers(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("# unit: mm\ntime,n_x,n_y,n_z\n0,1,2,3\n0.01,,,\n")
    assert read_markers(tmp_path / "a.csv").rate == 100
    assert read_markers(tmp_path / "a.csv").missing[1, 0]


@pytest.mark.parametrize("name", [*C3D, "../markers/animface_Jaw.c3d", "../markers/animface_Eyebrows.c3d"])
def test_real_c3d_agree_with_ezc3d(data, name):
    import ezc3d

    path = data(f"c3d/{name}")
    ours, theirs = read_markers(path), ezc3d.c3d(str(path))
    scale = {"mm": 1, "cm": 10}[theirs["parameters"]["POINT"]["UNITS"]["value"][0]]
    residuals = theirs["data"]["meta_points"]["residuals"][0].T
    positions = scale * theirs["data"]["points"][:3].transpose(2, 1, 0)
    positions[residuals < 0] = np.nan
    np.testing.assert_array_equal(ours.positions, positions)
    np.testing.assert_array_equal(ours.residuals, np.where(residuals < 0, np.nan, scale * residuals))
    assert list(ours.names) == theirs["parameters"]["POINT"]["LABELS"]["value"][: len(ours.names)]
    assert ours.rate == theirs["parameters"]["POINT"]["RATE"]["value"][0]


@pytest.mark.parametrize("name", REFUSED)
def test_real_c3d_that_cannot_be_read_say_why(data, name):
    with pytest.raises(InputError, match=REFUSED[name]):
        read_markers(data(f"c3d/{name}"))


@pytest.mark.parametrize(("name", "shape"), [("pyomeca_markers.trc", (93, 51, 3)), ("trc_Anto.trc", (128, 34, 3))])
def test_real_trc(data, name, shape):
    back = read_markers(data(f"c3d/{name}"))
    assert back.positions.shape == shape
    assert back.rate == 100
    facts = describe(data(f"c3d/{name}"))
    assert (facts["kind"], facts["frames"], len(facts["markers"])) == ("markers", shape[0], shape[1])


def test_trc_first_values(data):
    np.testing.assert_allclose(
        read_markers(data("c3d/trc_Anto.trc")).positions[0, 1], [-129.3447, -187.9931, 524.50153]
    )


def test_a_marker_csv_cut_inside_its_last_row_is_said(tmp_path, caplog):
    text = "# unit: mm\n# rate: 60\nframe,time,A_x,A_y,A_z\n0,0,1,2,3\n1,0.0167,1,2,3\n"
    (tmp_path / "whole.csv").write_text(text)
    (tmp_path / "cut.csv").write_text(text[:-4])
    read_markers(tmp_path / "whole.csv")
    assert not caplog.records
    assert np.isnan(read_markers(tmp_path / "cut.csv").positions[1]).any()
    assert "cut short" in caplog.text
