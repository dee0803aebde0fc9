"""Tests by equilibria: states at rest, one after the other along the applied strain."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from knitlab.solvers.method import Method, Progress

if TYPE_CHECKING:
    from knitlab.solvers.case import Case
    from knitlab.solvers.equilibrium.state import TensileTest

RELAXATION_STEPS = 10  # about the number of steps of a test that its relaxation costs
CONTACT_FACTOR = 4.0  # how much longer a fabric of 1000 unknowns with contact takes
CONTACT_POWER = 0.7  # of the number of unknowns with which that grows, as layers slide
COST_POWER = 1.3  # about the power of the number of unknowns with which the cost of a step grows


class Equilibrium(Method):
    """Quasi-static tests: a fabric relaxes, and its equilibrium is followed with the strain."""

    name: ClassVar[str] = "equilibrium"
    uses_solver: ClassVar[bool] = True
    state: ClassVar[str] = "equilibrium"
    steps: ClassVar[str] = "steps"
    seconds_of_work: ClassVar[float] = 0.018
    bytes_of_unknown: ClassVar[float] = 19e3

    def stretch(
        self, cases: "Sequence[Case]", progress: Progress, imperfection: int | None = None
    ) -> "list[TensileTest]":
        """Tests of the cases; from flat sheets, or from imperfect ones, by this seed."""
        from knitlab.solvers.equilibrium.tests_of_cases import stretched  # imports JAX

        return stretched(cases, progress, imperfection)

    def work(self, case: "Case", states: float) -> float:
        """Work of the first states, in steps of 1000 unknowns."""
        tests, states = divmod(states, len(case.applied_strain))
        steps_of_test = len(case.applied_strain) + RELAXATION_STEPS - 1
        begun = min(states, 1.0)
        steps = tests * steps_of_test + begun * (RELAXATION_STEPS - 1) + states
        if case.unloading:
            steps += len(case.applied_strain) - 1 if tests else max(states - 1, 0)
        steps += 2 * (case.cycle - 1) * len(case.applied_strain) * (1 if tests else begun)
        if case.options.contact != "none":
            steps *= CONTACT_FACTOR * (case.mesh_shape.unknowns / 1000) ** CONTACT_POWER
        return steps * (case.mesh_shape.unknowns / 1000) ** COST_POWER
