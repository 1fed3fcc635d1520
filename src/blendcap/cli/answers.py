"""How commands answer: for people as lines, for programs as JSON."""

from __future__ import annotations

import json
import math
import shutil
import textwrap
from collections.abc import Mapping
from typing import Annotated, Any

from cyclopts import Parameter

AsJson = Annotated[bool, Parameter(name="--json", negative=(), show_default=False)]


def print_json(answer: Mapping[str, Any]) -> None:
    """Print plain JSON: arrays as lists, NaN and infinity as null."""
    print(json.dumps(_plain(answer), indent=2, allow_nan=False))


def print_lines(answer: Mapping[str, Any], most: int = 12) -> None:
    """Print the facts one below the other, wrapped to the terminal; of a list, no more than `most`."""
    width = max(len(key) for key in answer) + 2
    room = max(shutil.get_terminal_size((100, 24)).columns - width, 40)
    for key, value in answer.items():
        lines = textwrap.wrap(_text(value, most), room, break_long_words=False, break_on_hyphens=False)
        print(f"{key.replace('_', ' '):<{width}}" + f"\n{'':<{width}}".join(lines))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # NumPy's arrays and numbers
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _text(value: Any, most: int = 12) -> str:
    if value in (None, [], {}):
        return "none"
    if isinstance(value, Mapping):
        return _short([f"{k} {_text(v)}" for k, v in value.items()], most)
    if isinstance(value, list):
        count = f"{len(value)}: " if isinstance(value[0], str) else ""
        return count + _short([_text(v) for v in value], most)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def _short(words: list[str], most: int) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more
