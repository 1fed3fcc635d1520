"""blendcap info FILE."""

from __future__ import annotations

from pathlib import Path

from blendcap.cli.answers import AsJson, print_json, print_lines


def info(file: Path, /, *, as_json: AsJson = False) -> None:
    """Say what a file holds.

    Parameters
    ----------
    file
        A rig, a mesh, a marker take, an animation, a video, cameras, places of markers, or a trained model.
    as_json
        Print the answer as JSON.
    """
    from blendcap.io import describe

    facts = describe(file)
    if as_json:
        print_json(facts)
        return
    if "missing" in facts:
        facts["missing"] = f"{100 * facts['missing']:.3g} % of the samples"
    print_lines(facts)
