"""Threads that share a task whose parts release the global interpreter lock."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

ONE_THREAD = dict.fromkeys(
    ("PJRT_NPROC", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)
"""Environment of a process limited to one thread."""

Part = TypeVar("Part")
Result = TypeVar("Result")


class Threads:
    """A pool of ``count`` threads, if above 1, whose work must not use the same pool."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = ThreadPoolExecutor(count) if count > 1 else None

    def each(self, work: Callable[[Part], Result], parts: Iterable[Part]) -> list[Result]:
        """Results of ``work`` for every item, in order."""
        return list(self._pool.map(work, parts) if self._pool else map(work, parts))


ALONE = Threads(1)


def allowed_threads(variable: str = "OMP_NUM_THREADS") -> int:
    """Threads that this process may use: by an environment variable, or all processors."""
    text = os.environ.get(variable, "")
    if text.isdecimal() and int(text) > 0:
        return int(text)
    # Not every system reports which processors a process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
