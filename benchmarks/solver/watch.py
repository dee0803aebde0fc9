"""The watch: what a search has cost so far, and when it is given up."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float


class GivenUp(Exception):
    """A search that is not going to reach the tolerance."""


class OutOfTime(GivenUp):
    """A search that has not reached it in time."""


@dataclass
class Watch:
    """Time, work and residual of one search as it goes.

    The time is the processor time of this process where a search runs on one thread, as the time
    that it waits for a processor is not its own; where two share the work it is that of the clock.

    Attributes:
        limit: time after which the search is given up [s].
        threads: that the search runs on.
        evaluations: of energy and gradient.
        factorisations: of the stiffness.
        states: reached so far.
        residual: largest force on a free unknown when last seen [N].
        trace: times and residuals seen [s, N].
        parts: wall time of each kind of work, where the search is asked for it [s].
    """

    limit: float
    threads: int = 1
    evaluations: int = 0
    factorisations: int = 0
    states: int = 0
    residual: float = np.inf
    trace: list[tuple[float, float]] = field(default_factory=list)
    parts: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))

    def __post_init__(self) -> None:
        self._began = self._now()

    def _now(self) -> float:
        return time.process_time() if self.threads == 1 else time.perf_counter()

    @property
    def seconds(self) -> float:
        """Time since the start, pauses not counted [s]."""
        return self._now() - self._began

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Do what the search would not have done."""
        stopped = self._now()
        yield
        self._began += self._now() - stopped

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add the time of some work to that of its kind."""
        began = time.perf_counter()
        yield
        self.parts[name] += time.perf_counter() - began

    def sees(self, residual: float, evaluations: int = 1) -> None:
        """Note a residual, and the evaluations since the last.

        Raises:
            OutOfTime: if time is up.
        """
        self.evaluations += evaluations
        self.residual = residual
        seconds = self.seconds
        self.trace.append((seconds, residual))
        if seconds > self.limit:
            raise OutOfTime(f"the limit of {self.limit:g} s was reached")

    def first_times(self, levels: Float[np.ndarray, " level"]) -> list[float | None]:
        """When each level of the residual was first reached; ``None`` if it was not [s]."""
        times, residuals = np.array(self.trace or [(0.0, np.inf)]).T
        lowest = np.minimum.accumulate(residuals)
        places = np.searchsorted(-lowest, -levels)
        return [float(times[place]) if place < len(times) else None for place in places]
