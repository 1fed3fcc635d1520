"""Animations: our CSV, Live Link Face, NPZ."""

import logging

import numpy as np
import pytest

from blendcap.data import Animation, InputError
from blendcap.data.names import ARKIT52, HEAD_AND_EYES
from blendcap.io import describe, read_animation, write_animation

HEADER = "Timecode,BlendShapeCount,EyeBlinkLeft,JawOpen,HeadYaw\n"


def animation(names=("jawOpen", "eyeBlinkLeft"), frames=20, rate=29.97) -> Animation:
    weights = np.random.default_rng(0).random((frames, len(names)))
    weights[3, 0] = np.nan
    return Animation(weights, names, rate, meta={"source": "take 3"})


@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_an_animation_survives_a_round_trip(tmp_path, ending):
    first = animation()
    confidence = np.random.default_rng(1).random(first.weights.shape)
    first = Animation(first.weights, first.names, first.rate, None, confidence, first.times + 0.5, first.meta)
    write_animation(tmp_path / f"a{ending}", first)
    back = read_animation(tmp_path / f"a{ending}")
    assert back.names == first.names
    assert back.rate == pytest.approx(first.rate, rel=1e-9)
    assert back.meta["source"] == "take 3"
    for field in ("weights", "times", "confidence"):
        np.testing.assert_allclose(getattr(back, field), getattr(first, field), rtol=1e-8)


def test_npz_keeps_every_bit_and_the_head(tmp_path):
    head = np.tile(np.eye(4), (20, 1, 1)) + np.random.default_rng(0).random((20, 4, 4)) / 7
    first = animation()
    first = Animation(first.weights / 3, first.names, first.rate, head)
    write_animation(tmp_path / "a.npz", first)
    back = read_animation(tmp_path / "a.npz")
    np.testing.assert_array_equal(back.weights, first.weights)
    np.testing.assert_array_equal(back.head, head)


def test_csv_says_that_it_leaves_the_head_out(tmp_path, caplog):
    first = animation()
    write_animation(tmp_path / "a.csv", Animation(first.weights, first.names, 30.0, np.tile(np.eye(4), (20, 1, 1))))
    assert "not the head motion" in caplog.text
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == "# rate: 30"
    assert lines[2].split(",") == ["frame", "time", "jawOpen", "eyeBlinkLeft"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frame,time,jawOpen,jawOpen\n0,0,1,1\n", "'jawOpen' more than once"),
        ("# rate: 0\nframe,jawOpen\n0,1\n", "positive"),
        ("# rate: -5\nframe,jawOpen\n0,1\n", "positive"),
        ("# rate: fast\nframe,jawOpen\n0,1\n", "must be a number"),
        ("frame,jawOpen\n0,1\n1,1\n", "add a line '# rate: 60'"),
        ("frame,time,jawOpen\n0,0,1\n", "one frame and states no rate"),
        ("frame,time,jawOpen\n0,0,1\n1,,1\n", "has no time"),
        ("frame,time,jawOpen\n0,0.2,1\n1,0.1,1\n", "do not rise"),
        ("frame,time,jawOpen\n0,0,much\n1,1,1\n", "'much' in row 1"),
        ("frame,time,jawOpen\n0,0,inf\n1,1,1\n", "infinite"),
        ("frame,time,jawOpen\n0,0,1,2,3\n1,1,1\n", "5 cells for 3 columns"),
        ("frame,time\n0,0\n1,1\n", "no columns of shapes"),
        ("# rate: 30\n", "no header"),
        ("frame,time,jawOpen\n", "no rows"),
    ],
)
def test_bad_tables_say_what_and_where(tmp_path, text, message):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_animation(tmp_path / "bad.csv")
    assert "bad.csv" in str(caught.value)


def test_empty_cells_and_short_rows_are_missing(tmp_path):
    (tmp_path / "a.csv").write_text("\ufeff# rate: 30\r\nframe,a,b,\r\n0,,0.5,\r\n\r\n1,nan\r\n")
    np.testing.assert_array_equal(read_animation(tmp_path / "a.csv").weights, [[np.nan, 0.5], [np.nan, np.nan]])


def test_a_shape_without_influence_is_trusted(tmp_path):
    (tmp_path / "a.csv").write_text("# rate: 30\nframe,a,a:influence,b\n0,1,0.25,1\n")
    np.testing.assert_array_equal(read_animation(tmp_path / "a.csv").confidence, [[0.25, 1]])


def test_live_link_round_trip_with_dropped_frames(tmp_path):
    names = (*ARKIT52, *HEAD_AND_EYES)
    times = np.delete(np.arange(120) / 30, [7, 50, 51]) + 3.0
    first = Animation(np.random.default_rng(0).random((117, 61)), names, 30.0, times=times)
    write_animation(tmp_path / "a.livelink.csv", first)
    back = read_animation(tmp_path / "a.livelink.csv")
    assert back.names == names
    assert back.rate == 30
    np.testing.assert_allclose(back.weights, first.weights, rtol=1e-8)
    np.testing.assert_allclose(back.times, times - 3.0, atol=2e-5)
    header = (tmp_path / "a.livelink.csv").read_text().splitlines()[0].split(",")
    assert header[:3] == ["Timecode", "BlendShapeCount", "EyeBlinkLeft"]
    assert header[-1] == "RightEyeRoll"
    assert len(header) == 63


@pytest.mark.parametrize("rate", [24.0, 25.0, 30.0, 60.0, 120.0])
@pytest.mark.parametrize("seconds", [0.4, 2.3])
def test_live_link_counts_sixty_at_any_rate(tmp_path, rate, seconds):
    frames = int(seconds * rate)
    first = Animation(np.zeros((frames, 1)), ("jawOpen",), rate, meta={"timecode": "23:59:59:30.000"})
    write_animation(tmp_path / "a.livelink.csv", first)
    back = read_animation(tmp_path / "a.livelink.csv")
    assert back.rate == pytest.approx(rate, rel=1e-3)
    np.testing.assert_allclose(back.times, first.times, atol=2e-5)


def test_live_link_by_name_in_any_order_and_either_spelling(tmp_path):
    rows = "00:00:00:00.000,3,0.1,0.2,0.3\n00:00:00:02.000,0,,,\n00:00:00:04.000,3,0.4,0.5,0.6\n"
    (tmp_path / "a.csv").write_text(HEADER + rows)
    one = read_animation(tmp_path / "a.csv")
    assert one.names == ("eyeBlinkLeft", "jawOpen", "headYaw")
    assert one.rate == 30
    assert np.isnan(one.weights[1]).all()  # the app lost the face
    swapped = HEADER.replace("BlendShapeCount", "BlendshapeCount").replace(
        "EyeBlinkLeft,JawOpen", "JawOpen,EyeBlinkLeft"
    )
    (tmp_path / "b.csv").write_text(swapped + rows)
    other = read_animation(tmp_path / "b.csv")
    np.testing.assert_array_equal(other.select(["jawOpen"]).weights[:, 0], one.weights[:, 0])


def test_live_link_that_counts_to_thirty(tmp_path):
    stamps = [f"00:00:{i // 30:02d}:{i % 30:02d}.000" for i in range(45)]
    (tmp_path / "a.csv").write_text(HEADER + "".join(f"{s},3,0,0,0\n" for s in stamps))
    back = read_animation(tmp_path / "a.csv")
    assert back.rate == 30
    np.testing.assert_allclose(np.diff(back.times), 1 / 30, atol=1e-9)


def test_live_link_repeated_and_broken_timecodes(tmp_path, caplog):
    (tmp_path / "a.csv").write_text(HEADER + "".join(f"00:00:00:{f:02d}.000,3,{f},0,0\n" for f in (0, 2, 2, 4)))
    assert read_animation(tmp_path / "a.csv").weights.shape == (3, 3)
    assert "repeats the timecode" in caplog.text
    for stamp, message in (("00:00:00:00.000", "not rise"), ("noon", "HH:MM:SS"), ("00:00:00:999.0", "frame field")):
        (tmp_path / "b.csv").write_text(f"{HEADER}00:00:05:02.0,3,0,0,0\n00:00:04:04.0,3,0,0,0\n{stamp},3,0,0,0\n")
        with pytest.raises(InputError, match=message):
            read_animation(tmp_path / "b.csv")


def test_live_link_leaves_out_what_it_has_no_column_for(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        write_animation(tmp_path / "a.livelink.csv", animation(("jawOpen", "eyeBlink_R", "wrinkle")))
    assert "wrinkle" in caplog.text
    assert "can hold ARKit's 52 shapes and no others" in caplog.text and "--shapes arkit" in caplog.text
    caplog.clear()
    write_animation(tmp_path / "b.livelink.csv", animation(("jawOpen", "eyeBlink_R", "headYaw")))
    assert not caplog.records
    back = read_animation(tmp_path / "a.livelink.csv")
    np.testing.assert_allclose(
        back.select(["eyeBlinkRight"]).weights[:, 0], animation(("a", "b", "c")).weights[:, 1], rtol=1e-8
    )
    with pytest.raises(InputError, match="none of the animation's shapes"):
        write_animation(tmp_path / "b.livelink.csv", animation(("wrinkle",)))


def test_the_real_recording_both_ways(data, tmp_path):
    plain = read_animation(data("performances/alexdjulin_alex_rom_3.csv"))
    live = read_animation(data("performances/alexdjulin_alex_rom_3.livelink.csv"))
    assert live.names == plain.names == (*ARKIT52, *HEAD_AND_EYES)
    assert live.rate == plain.rate == 30
    assert len(live.weights) == 4030
    np.testing.assert_allclose(live.weights, plain.weights, atol=1e-6)
    np.testing.assert_allclose(live.times, plain.times, atol=2e-5)
    assert np.diff(live.times).max() == pytest.approx(2 / 30, abs=1e-3)  # the one dropped frame keeps its time
    assert live.weights.max() > 1  # as recorded, not clipped
    write_animation(tmp_path / "back.livelink.csv", live)
    again = read_animation(tmp_path / "back.livelink.csv")
    np.testing.assert_allclose(again.weights, live.weights, atol=1e-8)
    np.testing.assert_allclose(again.times, live.times, atol=2e-5)
    assert again.meta["timecode"] == live.meta["timecode"]


def test_another_real_recording(data):
    facts = describe(data("performances/neurosync_Happy_Happy.csv"))
    assert (facts["kind"], facts["frames"], len(facts["shapes"])) == ("animation", 3046, 61)
    assert facts["rate"] == pytest.approx(60, rel=2e-3)
