"""blendcap evaluate A B --rig RIG."""

from __future__ import annotations

from pathlib import Path

from blendcap.cli.answers import AsJson, print_json, print_lines


def evaluate(answer: Path, truth: Path, /, *, rig: Path, as_json: AsJson = False) -> None:
    """Compare an animation with the true one on a rig.

    Parameters
    ----------
    answer
        The animation to judge.
    truth
        The animation to judge it by: same rate, same length.
    rig
        The rig that both drive.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import read_animation, read_rig
    from blendcap.metrics import evaluate as measure

    metrics = measure(read_animation(answer), read_animation(truth), read_rig(rig)).as_dict()
    (print_json if as_json else print_lines)(metrics)
