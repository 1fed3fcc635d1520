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
    if as_json:
        print_json(metrics)
    else:
        print_lines(metrics | {"leak": _explained(metrics["leak"])})


def _explained(leak: float | None) -> str | None:
    """The leak between the sides, and what its sign says."""
    if leak is None:
        return None
    below = "the sides differ more than they did" if leak < 0 else "of the difference between left and right is lost"
    return f"{leak:.4g}: {below}"
