"""Threads over bands of work: each band is independent, so the answer does not depend on their number."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache


def each_band(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(start, stop)` for consecutive bands of `size` that cover `range(count)`, on all cores.

    `work` must release the GIL to gain anything (Numba's `nogil=True`).
    """
    bands = [(start, min(start + size, count)) for start in range(0, count, size)]
    for _ in _pool().map(lambda band: work(*band), bands):
        pass


@cache
def _pool() -> ThreadPoolExecutor:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return ThreadPoolExecutor(cores, thread_name_prefix="render")
