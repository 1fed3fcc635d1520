"""Outputs are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from blendcap.data import InputError


@contextmanager
def write_whole(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; at the end it takes the place of `path` in one step.

    If anything fails, the temporary file is removed and what stood at `path` before stays as it was.

    Raises
    ------
    InputError
        If the folder does not exist, `path` is a folder, or the system refuses to write.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"Cannot write {path}: it is a folder; name a file inside it.")
    if not path.parent.is_dir():
        raise InputError(f"Cannot write {path}: the folder {path.parent} does not exist; create it first.")
    temporary = path.with_name(f".{secrets.token_hex(6)}.{path.name}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"Cannot write {path}: {error.strerror or error}; check the folder and its rights.") from error
    finally:
        temporary.unlink(missing_ok=True)
