"""Opening files for reading, with plain words when that fails."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from blendcap.data import InputError


def existing_file(path: str | os.PathLike) -> Path:
    """`path` as a Path, if it is a file."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"Cannot read {path}: it is a folder; name a file.")
    if not path.exists():
        raise InputError(f"Cannot read {path}: there is no such file; check the path.")
    return path


def read_bytes(path: str | os.PathLike) -> bytes:
    """The bytes of a file that is not empty."""
    path = existing_file(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"Cannot read {path}: {error.strerror or error}.") from error
    if not content:
        raise InputError(f"Cannot read {path}: the file is empty.")
    return content


def read_text(path: str | os.PathLike) -> str:
    """The text of a file in UTF-8 (a byte order mark is skipped), else Latin-1; control bytes are an error."""
    content = read_bytes(path)
    if any(byte < 9 or 13 < byte < 32 for byte in content[:4096]) or b"\0" in content:
        raise InputError(f"Cannot read {path}: it is not a text file.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:  # names in old OBJ and TRC files hold a few Latin-1 letters
        return content.decode("latin-1")


def read_json(path: str | os.PathLike) -> Any:
    """What a JSON file says."""
    return parse_json(read_text(path), str(path))


def parse_json(text: str | bytes, where: str) -> Any:
    """What JSON text says; `where` names it in the error."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"Cannot read {where}: it is not valid JSON ({error}).") from None


@contextmanager
def reading(path: str | os.PathLike, kind: str) -> Iterator[None]:
    """Turn what damaged content does to a reader into one plain sentence that names the file.

    Checks inside readers say precisely what is wrong; this is the net below them, for content nobody thought of.
    """
    try:
        with np.errstate(all="ignore"):  # numbers that overflow become infinite, and the records refuse those
            yield
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"Cannot read {path}: {error}") from error
    except MemoryError as error:
        raise InputError(f"Cannot read {path}: it declares more data than this machine can hold.") from error
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError, struct.error) as error:
        lacks = f"it lacks {error}" if isinstance(error, KeyError) else "something in it has not the expected form"
        raise InputError(f"Cannot read {path}: the {kind} is damaged, {lacks}; export it again.") from error
