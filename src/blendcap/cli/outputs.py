"""Outputs are tried before the work, so that nobody waits for a result that cannot be written."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import blendcap

ANIMATIONS = (".csv", ".glb", ".npz")
VIDEOS, PAGES, PICTURES, PLACES = (".mp4", ".gif"), (".html",), (".png",), (".json",)


def check_outputs(paths: Iterable[Path | None], endings: tuple[str, ...], inputs: Iterable[Path | None] = ()) -> None:
    """Refuse paths with another ending, those whose folder is not there or cannot be written to, and the inputs.

    Raises
    ------
    InputError
        For the first path that cannot become a file.
    """
    read = {path.resolve() for path in inputs if path is not None}
    for path in paths:
        if path is None:
            continue
        if path.is_dir():
            raise blendcap.InputError(f"Cannot write {path}: it is a folder; name a file inside it.")
        if path.suffix.lower() not in endings:
            raise blendcap.InputError(f"Cannot write {path}: its ending must be one of {', '.join(endings)}.")
        if path.resolve() in read:
            raise blendcap.InputError(
                f"Cannot write {path}: it is an input too, and would be lost; choose another name."
            )
        if path.parent.exists() and not path.parent.is_dir():
            raise blendcap.InputError(f"Cannot write {path}: {path.parent} is a file; name a folder.")
        if not path.parent.is_dir():
            raise blendcap.InputError(f"Cannot write {path}: the folder {path.parent} does not exist; create it first.")
        if not os.access(path.parent, os.W_OK):
            raise blendcap.InputError(f"Cannot write {path}: the folder {path.parent} is locked; choose another.")
