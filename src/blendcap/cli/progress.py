"""What is going on: a bar on a terminal, one line a step otherwise."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Progress:
    """Shows the steps of a command and remembers how long each took.

    On a terminal a bar goes to standard error. Elsewhere each step is one line on standard output, and none if `quiet`
    (standard output then belongs to the answer).

    Attributes
    ----------
    seconds : {step: float}
    """

    def __init__(self, quiet: bool = False):
        self.quiet = quiet
        self.seconds: dict[str, float] = {}

    @contextmanager
    def step(self, text: str, total: int | None = None) -> Iterator[Callable[..., None]]:
        """Do one step; yields a function to call with the number of things done so far, out of `total`."""
        start = time.perf_counter()
        if sys.stderr.isatty():
            with _bar() as bar:
                task = bar.add_task(text, total=total)
                yield lambda done, *_: bar.update(task, completed=done)
                bar.update(task, total=total or 1, completed=total or 1)
        else:
            if not self.quiet:
                print(text, flush=True)
            yield lambda *_: None
        self.seconds[text] = time.perf_counter() - start


def _bar():
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as RichProgress

    columns = (TextColumn("{task.description:<36}"), BarColumn(), TimeElapsedColumn())
    return RichProgress(*columns, console=Console(stderr=True))
