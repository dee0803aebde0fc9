"""Threads that share a task whose parts release the global interpreter lock."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

ONE_THREAD = {
    "PJRT_NPROC": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
"""Environment of a process limited to one thread."""

Part = TypeVar("Part")
Result = TypeVar("Result")


class Threads:
    """A pool of threads.

    Work that runs in the pool must not use the same pool, or it deadlocks.

    Args:
        count: number of threads; 1 runs in the calling thread.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = ThreadPoolExecutor(count) if count > 1 else None

    def each(self, work: Callable[[Part], Result], parts: Iterable[Part]) -> list[Result]:
        """Results of ``work`` for every part, in order."""
        return list(self._pool.map(work, parts) if self._pool else map(work, parts))


ALONE = Threads(1)


def allowed_threads() -> int:
    """Number of threads that this process may use: ``OMP_NUM_THREADS``, or all its processors."""
    text = os.environ.get("OMP_NUM_THREADS", "")
    if text.isdecimal():
        return max(int(text), 1)
    # Not every system reports which processors a process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
