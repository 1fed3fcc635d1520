"""Threads over independent pieces of work, so that the answer does not depend on their number."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

AHEAD = 2  # pictures in the making while one is written

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def each_band(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(start, stop)` for consecutive bands of `size` that cover `range(count)`, on all cores.

    `work` must release the GIL to gain anything (Numba's `nogil=True`).
    """
    bands = [(start, min(start + size, count)) for start in range(0, count, size)]
    for _ in _pool().map(lambda band: work(*band), bands):
        pass


def each_ahead(work: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
    """Yield `work(item)` for each item in order, while threads already work on the next ones."""
    with ThreadPoolExecutor(AHEAD, thread_name_prefix="ahead") as pool:  # another pool: its work waits for bands
        waiting = deque()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cores(), thread_name_prefix="render")
