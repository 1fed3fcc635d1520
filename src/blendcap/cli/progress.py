"""What is going on: a bar on a terminal, one line a step otherwise."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Tell = Callable[..., None]  # called with the number of things done, or with a word on what begins


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
    def step(self, name: str, text: str, total: int | None = None) -> Iterator[Tell]:
        """Do the step `name`, shown as `text`; yields a function that is told what is done, out of `total`."""
        start = time.perf_counter()
        with (_bar if sys.stderr.isatty() else self._line)(text, total) as tell:
            yield tell
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    @contextmanager
    def _line(self, text: str, total: int | None) -> Iterator[Tell]:
        if not self.quiet:
            print(text, flush=True)
        yield lambda *_: None


@contextmanager
def _bar(text: str, total: int | None) -> Iterator[Tell]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<48}"), BarColumn(20), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(text, total=total)

        def tell(done: int | str, *_) -> None:
            change = {"description": f"{text}: {done}"} if isinstance(done, str) else {"completed": done}
            bar.update(task, **change)  # pyright: ignore[reportArgumentType]

        yield tell
        bar.update(task, description=text, total=total or 1, completed=total or 1)
