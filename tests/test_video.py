"""Videos: what was written comes back, real files agree with a peer, damaged files are refused in a sentence."""

import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest

import blendcap
from blendcap import InputError
from blendcap.io import read_video, write_video
from blendcap.io.video_write import FOR_PROGRAMS

CLIPS = ("pyfeat_single_face.mp4", "pyfeat_WolfgangLanger_Pexels.mp4", "facerecognition_short_hamilton_clip.mp4")


def film(count=12, size=(64, 48), grey=False):
    """A soft disc that crosses the picture."""
    y, x = np.mgrid[: size[1], : size[0]]
    for t in range(count):
        disc = 128 + 100 * np.exp(-((x - 10 - 3 * t) ** 2 + (y - 24) ** 2) / 50)
        picture = disc.astype(np.uint8)
        yield picture if grey else np.stack([picture] * 3, -1)


@pytest.fixture
def clip(tmp_path):
    path = tmp_path / "clip.mp4"
    write_video(path, film(), 24, (64, 48), loss=0)
    return path


def test_what_was_written_comes_back(clip):
    video = blendcap.read_video(clip)
    assert (video.size, video.rate, video.count) == ((64, 48), 24.0, 12)
    for written, read in zip(film(), video.frames(), strict=True):
        assert read.shape == (48, 64, 3)
        assert np.abs(read.astype(int) - written).max() <= 3  # 8 bits in video range, twice


def test_grey_is_written_and_read_as_grey(tmp_path):
    write_video(tmp_path / "grey.mp4", film(grey=True), 60, (64, 48), loss=FOR_PROGRAMS)
    video = read_video(tmp_path / "grey.mp4")
    assert video.rate == 60
    for written, read in zip(film(grey=True), video.frames(grey=True), strict=True):
        assert read.shape == (48, 64)
        assert np.abs(read.astype(float) - written).mean() < 1


def test_frames_start_anew_and_may_be_left_early(clip):
    video = read_video(clip)
    first = next(iter(video.frames()))
    again = list(video.frames())
    np.testing.assert_array_equal(first, again[0])
    assert len(again) == 12


@pytest.mark.parametrize("name", CLIPS)
def test_real_videos_agree_with_opencv(data, name):
    path = data(f"video/{name}")
    video, peer = read_video(path), cv2.VideoCapture(str(path))
    assert video.count == int(peer.get(cv2.CAP_PROP_FRAME_COUNT))
    assert video.rate == pytest.approx(peer.get(cv2.CAP_PROP_FPS), abs=0.005)
    count = 0
    for ours in video.frames():
        count, theirs = count + 1, peer.read()[1][..., ::-1]
        assert np.abs(ours.astype(int) - theirs).mean() < 1.5  # the two convert colors a little differently
    assert count == video.count and not peer.read()[0]


def test_a_long_video_needs_no_more_memory(data):
    video = read_video(data("video/pyfeat_WolfgangLanger_Pexels.mp4"))
    tracemalloc.start()
    for _ in video.frames():
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5 * 640 * 360 * 3


def test_cut_videos_are_refused(clip, tmp_path):
    content, refused = clip.read_bytes(), 0
    for end in np.linspace(0, len(content) - 1, 12).astype(int):
        (tmp_path / "cut.mp4").write_bytes(content[:end])
        with pytest.raises(InputError, match=r"cut\.mp4: .*again\.$"):
            list(read_video(tmp_path / "cut.mp4").frames())
        refused += 1
    assert refused == 12


def test_a_damaged_frame_is_named(clip):
    content = bytearray(clip.read_bytes())
    start = content.index(b"mdat") + 4
    content[start + 400 : start + 1400] = bytes(1000)
    clip.write_bytes(content)
    with pytest.raises(InputError, match=r"frame \d+ of 12 is damaged|cut short"):
        list(read_video(clip).frames())


def test_a_frame_that_never_comes_is_missed(clip):
    with pytest.raises(InputError, match="frame 12 of 13 is damaged"):
        list(replace(read_video(clip), count=13).frames())


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89PNG\r\n", bytes(5000)])
def test_what_is_no_video_is_refused(tmp_path, content):
    (tmp_path / "no.mp4").write_bytes(content)
    with pytest.raises(InputError, match=r"no\.mp4: it holds no video"):
        read_video(tmp_path / "no.mp4")


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        read_video(tmp_path / "none.mp4")
    with pytest.raises(InputError, match="it is a folder"):
        read_video(tmp_path)


def test_frames_of_another_size_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"Frame 0 is uint8 \(48, 64, 3\), but the video's are uint8 \(32, 32, 3\)"):
        write_video(tmp_path / "odd.mp4", film(), 24, (32, 32))
    assert not list(tmp_path.iterdir())
