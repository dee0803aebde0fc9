"""Estimates of time and memory, based on measurements that the page on performance states."""

from collections.abc import Iterable

import numpy as np

from knitlab.dynamics.settings import DynamicsSettings
from knitlab.simulation.case import Case, Method

# Relaxation costs about this number of steps of a tensile test, and the cost of a step grows with
# about this power of the number of unknowns.
RELAXATION_STEPS = 10
COST_POWER = 1.3
SECONDS_OF_WORK: dict[Method, float] = {"equilibrium": 0.018, "dynamics": 1.2e-7}
"""Seconds for a unit of work on one core, by method."""
TIME_TO_REST = 60.0
"""Usual duration of a motion until a fabric is at rest [ms]."""
STIFFNESS_OF_NODE = 4.7
"""Largest eigenvalue of the stiffness of a sheet, over the largest k_s."""
CONTACT = 4.0
"""How much longer a fabric with contact takes; more where its plies are pressed together."""
PROCESS_BYTES = 500e6
"""Memory of a worker with its compiled programs."""
BYTES_OF_UNKNOWN: dict[Method, float] = {"equilibrium": 19e3, "dynamics": 1.2e3}
"""Memory for each unknown of a batch, of equilibria mostly for element Hessians, indices and
factors."""


def work(case: Case, states: float) -> float:
    """Work in the first ``states`` states of a case.

    It is counted in steps of a test of 1000 unknowns, or by dynamics in time steps of one node. The
    states of its siblings are counted after its own; a fraction is part of the next state.
    """
    if case.method == "dynamics":
        return (
            _time(case, case.motion, states)
            / _time_step(case, case.motion)
            * (case.mesh_shape.nodes)
        )
    tests, states = divmod(states, len(case.applied_strain))
    whole = len(case.applied_strain) + RELAXATION_STEPS - 1
    begun = min(states, 1.0) * (RELAXATION_STEPS - 1)
    steps = tests * whole + begun + states
    if case.unloading:
        steps += len(case.applied_strain) - 1 if tests else max(states - 1, 0)
    steps *= CONTACT if case.options.contact == "barrier" else 1.0
    return steps * (case.mesh_shape.unknowns / 1000) ** COST_POWER


def _time(case: Case, motion: DynamicsSettings, states: float) -> float:
    """Time that passes in the first states of a test by dynamics [ms]."""
    at_rest, rate = motion.ending == "rest", motion.strain_rate
    relaxation = TIME_TO_REST if at_rest else motion.relax_time
    if motion.ending == "steps":
        stable = _time_step(case, motion) / motion.step_safety
        relaxation, rate = motion.relax_steps * stable, motion.step_strain / stable
    strain = float(np.interp(states - 1, range(len(case.applied_strain)), case.applied_strain))
    waiting = TIME_TO_REST * max(states - 1, 0.0) if at_rest else 0.0
    return relaxation * min(states, 1.0) + strain / rate + waiting


def _time_step(case: Case, motion: DynamicsSettings) -> float:
    """About the time step of the leapfrog [ms]."""
    stiffest = max(case.weft.k_s, case.warp.k_s)
    mass = motion.surface_density * case.weft.period * case.warp.period
    mass *= (case.options.length_scale / case.options.cells_per_period) ** 2
    return float(2 * motion.step_safety * np.sqrt(mass / (STIFFNESS_OF_NODE * stiffest)))


def seconds(cases: Iterable[Case]) -> float:
    """Time of cases on one core, accurate to a factor of about two [s]."""
    return sum(SECONDS_OF_WORK[case.method] * work(case, case.states) for case in cases)


def bytes_needed(unknowns: int, method: Method = "equilibrium") -> float:
    """Memory of a worker for a batch with a number of unknowns, to some 30 % [bytes]."""
    return PROCESS_BYTES + BYTES_OF_UNKNOWN[method] * unknowns
