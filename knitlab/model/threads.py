"""Threads that share a task whose parts release the global interpreter lock."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from knitlab.model.computing import computing

Part = TypeVar("Part")
Result = TypeVar("Result")


class Threads:
    """A pool of ``count`` threads, if above 1, whose work must not use the same pool."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = ThreadPoolExecutor(count) if count > 1 else None

    def each(self, work: Callable[[Part], Result], parts: Iterable[Part]) -> list[Result]:
        """Results of ``work`` for every item, in order."""
        if self._pool is None:
            return list(map(work, parts))
        return list(self._pool.map(computing()(work), parts))


ALONE = Threads(1)
