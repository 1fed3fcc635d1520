"""Outputs are tried before the work, so that nobody waits for a result that cannot be written."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import blendcap


def check_outputs(paths: Iterable[Path | None]) -> None:
    """Refuse paths whose folder is not there or cannot be written to.

    Raises
    ------
    InputError
        For the first path that cannot become a file.
    """
    for path in paths:
        if path is None:
            continue
        if path.is_dir():
            raise blendcap.InputError(f"{path}: is a folder; name the file to write.")
        if not path.parent.is_dir():
            raise blendcap.InputError(f"{path}: the folder {path.parent} does not exist; make it first.")
        if not os.access(path.parent, os.W_OK):
            raise blendcap.InputError(f"{path}: the folder {path.parent} cannot be written to; choose another.")
