"""Progress: lines for logs, bars for people, nothing in the way of an answer."""

import io
import sys

import pytest

from blendcap.cli.answers import print_json, print_lines
from blendcap.cli.progress import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def play(progress: Progress) -> None:
    with progress.step("read", "Read the take"):
        pass
    with progress.step("solve", "Solve 3 frames", total=3) as tell:
        tell("pass 1")
        for done in (1, 2, 3):
            tell(done, 3)


def test_elsewhere_than_on_a_terminal_a_step_is_one_line(capsys):
    progress = Progress()
    play(progress)
    assert capsys.readouterr() == ("Read the take\nSolve 3 frames\n", "")
    assert list(progress.seconds) == ["read", "solve"]


def test_a_quiet_step_says_nothing(capsys):
    play(Progress(quiet=True))
    assert capsys.readouterr() == ("", "")


def test_a_terminal_gets_a_bar_and_standard_output_stays_free(capsys, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    play(Progress(quiet=True))
    shown = sys.stderr.getvalue()
    assert "Read the take" in shown and "Solve 3 frames" in shown
    assert capsys.readouterr().out == ""


def test_a_step_that_fails_is_not_counted(capsys):
    progress = Progress()
    with pytest.raises(ValueError, match="boom"), progress.step("solve", "Solve"):
        raise ValueError("boom")
    assert progress.seconds == {}


def test_json_is_plain_and_a_missing_number_is_null(capsys):
    import json

    import numpy as np

    print_json({"a": np.float32(1.5), "b": np.array([1, 2]), "c": float("nan"), "d": {"e": (np.inf, True)}, "f": "ü"})
    assert json.loads(capsys.readouterr().out) == {"a": 1.5, "b": [1, 2], "c": None, "d": {"e": [None, True]}, "f": "ü"}


def test_lines_are_aligned_and_long_lists_shortened(capsys):
    shapes = [f"s{i}" for i in range(14)]
    print_lines(
        {"vertices": 12345, "rms_mm": 0.123456, "shapes": shapes, "missing": [], "size": [1.25, 2.0], "uv": True}
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["vertices  12,345", "rms mm    0.1235"]
    assert lines[2].startswith("shapes    14: s0, s1, ") and lines[2].endswith("s11 and 2 more")
    assert lines[3:] == ["missing   none", "size      1.25, 2", "uv        yes"]
