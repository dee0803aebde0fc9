"""What the methods of a simulated test share, and what each declares."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from knitlab.solvers.case import Case
    from knitlab.solvers.combination import Combination
    from knitlab.solvers.equilibrium.state import TensileTest

Progress = Callable[..., None]
"""Function of a case's identifier, of the number of its finished states, with a fraction, and
perhaps of what is done with it after its states."""
REASONS = {
    "iteration_limit": "the limit of steps was reached",
    "stalled": "no smaller step helped",
    "time_limit": "it was still moving at the end of its time; raise longest_time",
    "diverged": "it became unstable; lower step_safety",
}


class Method(ABC):
    """A way to simulate tests of cases that share a mesh shape: how they relax and are pulled."""

    name: ClassVar[str]
    refused: ClassVar[tuple[str, ...]] = ()
    """Settings of ``[protocol]`` that the method cannot give."""
    uses_solver: ClassVar[bool] = False
    """Whether every state is found by the search for equilibria."""
    state: ClassVar[str]
    steps: ClassVar[str]
    """What a state and the steps to it are called in messages."""
    seconds_of_work: ClassVar[float]
    """Time of a unit of :meth:`work` on one core [s]."""
    bytes_of_unknown: ClassVar[float]
    """Memory of a batch for each of its unknowns, to 30 %."""

    @abstractmethod
    def stretch(self, cases: "Sequence[Case]", progress: Progress) -> "list[TensileTest]":
        """Tests of the cases at their applied strains, relaxation included."""

    @abstractmethod
    def work(self, case: "Case", states: float) -> float:
        """Work of the first states of a case and its perturbed copies, in the method's unit."""

    def remarks(self, combination: "Combination") -> Iterator[str]:
        """Sentences on settings that the method ignores."""
        return iter(())

    def failure(self, case: "Case", test: "TensileTest") -> str:
        """Why a test did not reach its last strain; empty if it did."""
        last = test.states[-1]
        if last.converged:
            return ""
        where = f"at applied strain {case.applied_strain[len(test.states) - 1]:g}"
        if case.cycle > 1 and test.loading is None:
            where = f"before cycle {case.cycle}"
        return (
            f"no {self.state} {where}: {last.residual:.1e} N left after"
            f" {last.iterations} {self.steps} ({REASONS[last.outcome.name]})"
        )
