"""Small pictures side by side, each on one core: they are done before OpenCV's own threads have shared one out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Lock
from typing import TypeVar

from blendcap.rendering.parallel import cores

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def in_threads(work: Callable[[Item], Answer], items: Iterable[Item], most: int | None = None) -> list[Answer]:
    """`work(item)` for each item, in order, in `most` threads (the cores if not given); OpenCV has one core in each."""
    with one_core_each(), ThreadPoolExecutor(most or cores(), thread_name_prefix="pictures") as pool:
        return list(pool.map(work, items))


@contextmanager
def one_core_each() -> Iterator[None]:
    """Within, OpenCV starts no threads of its own, whoever calls it; the last to leave gives it back what it had."""
    import cv2

    with _Within.lock:
        if not _Within.count:
            _Within.before = cv2.getNumThreads()
            cv2.setNumThreads(1)
        _Within.count += 1
    try:
        yield
    finally:
        with _Within.lock:
            _Within.count -= 1
            if not _Within.count:
                cv2.setNumThreads(_Within.before)


class _Within:
    """Who is within: the number of OpenCV's threads is one for the whole process."""

    lock, count, before = Lock(), 0, 1
