"""How a plan is run. Imports neither JAX nor xarray."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from knitlab.io import job_limits
from knitlab.io.errors import Mistake, raise_if_any
from knitlab.io.limits import MAX_CASE_TIMEOUT
from knitlab.runs.batches import Shard

if TYPE_CHECKING:
    from knitlab.runs.workers import Simulate


@dataclass(frozen=True)
class RunOptions:
    """How a plan is run, see :func:`knitlab.run`; none of these options changes a result.

    Without a number of ``workers`` a single batch is simulated in this process, which is ready
    sooner, and several by one process for each processor of the job.
    """

    workers: int | None = 0
    scheduler: str | None = None
    retries: int = 0
    fail_fast: bool = False
    case_timeout: float | None = None
    refresh: bool = False
    shard: Shard | None = None
    dashboard: bool = False
    show_progress: bool = False  # of its cases and its cube
    simulate: "Simulate | None" = None  # a stand-in for the simulation

    def __post_init__(self) -> None:
        mistakes = [
            Mistake(f"{name} {number}", "is not a whole number; give 0 or more")
            for name, number in (("workers", self.workers or 0), ("retries", self.retries))
            if not isinstance(number, int) or number < 0
        ]
        if self.case_timeout is not None and not 0 < self.case_timeout <= MAX_CASE_TIMEOUT:
            message = f"is not above 0 and at most {MAX_CASE_TIMEOUT:,.0f} s; change or remove it"
            mistakes.append(Mistake(f"case_timeout {self.case_timeout}", message))
        raise_if_any(mistakes)

    def processors(self, batches: int) -> int:
        """Processes on this machine for a number of batches, or 0 for this process."""
        if self.workers is not None:
            return self.workers
        # A separate process can be stopped, and its crash does not end the run.
        return 0 if batches == 1 and self.case_timeout is None else job_limits.processors()
