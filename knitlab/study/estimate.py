"""Estimates of time and memory, based on measurements that the page on performance states."""

from collections.abc import Iterable

from knitlab.simulation.case import Case, Method

# Relaxation costs about this number of steps of a tensile test, and the cost of a step grows with
# about this power of the number of unknowns.
RELAXATION_STEPS = 10
COST_POWER = 1.3
SECONDS_OF_WORK: dict[Method, float] = {"equilibrium": 0.018, "dynamics": 4.0}
"""Seconds for a unit of work on one core, by method."""
CONTACT = 4.0
"""How much longer a fabric with contact takes; more where its plies are pressed together."""
PROCESS_BYTES = 500e6
"""Memory of a worker with its compiled programs."""
BYTES_OF_UNKNOWN = 19e3
"""Memory for each unknown of a batch, mostly for element Hessians, indices and factors."""


def work(case: Case, states: float) -> float:
    """Work in the first ``states`` states of a case, in steps of a test of 1000 unknowns.

    The states of its siblings are counted after its own; a fraction is part of the next state.
    """
    tests, states = divmod(states, len(case.applied_strain))
    whole = len(case.applied_strain) + RELAXATION_STEPS - 1
    begun = min(states, 1.0) * (RELAXATION_STEPS - 1)
    steps = tests * whole + begun + states
    if case.unloading:
        steps += len(case.applied_strain) - 1 if tests else max(states - 1, 0)
    steps *= CONTACT if case.options.contact == "barrier" else 1.0
    return steps * (case.mesh_shape.unknowns / 1000) ** COST_POWER


def seconds(cases: Iterable[Case]) -> float:
    """Time of cases on one core, accurate to a factor of about two [s]."""
    return sum(SECONDS_OF_WORK[case.method] * work(case, case.states) for case in cases)


def bytes_needed(unknowns: int) -> float:
    """Memory of a worker for a batch with a number of unknowns, to some 30 % [bytes]."""
    return PROCESS_BYTES + BYTES_OF_UNKNOWN * unknowns
