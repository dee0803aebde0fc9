"""Threads of this process that share a task, where its parts are done without the interpreter."""

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
"""Environment of a process that is to keep to one thread."""

Part = TypeVar("Part")
Result = TypeVar("Result")


class Threads:
    """A number of threads.

    What is done by them must not ask the same threads again, or it waits for itself.

    Args:
        count: how many; 1 is this thread alone. It can be read again.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = ThreadPoolExecutor(count) if count > 1 else None

    def each(self, work: Callable[[Part], Result], parts: Iterable[Part]) -> list[Result]:
        """What ``work`` makes of every part, in order."""
        return list(self._pool.map(work, parts) if self._pool else map(work, parts))


ALONE = Threads(1)


def allowed_threads() -> int:
    """How many threads this process may use: ``OMP_NUM_THREADS``, or all processors it has."""
    text = os.environ.get("OMP_NUM_THREADS", "")
    if text.isdecimal():
        return max(int(text), 1)
    # Not every system says which processors a process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
