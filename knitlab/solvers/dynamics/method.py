"""Tests by damped dynamics: fabrics move in time, at a finite rate of the applied strain."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from knitlab.solvers.method import Method, Progress

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration
    from knitlab.solvers.case import Case
    from knitlab.solvers.combination import Combination
    from knitlab.solvers.dynamics.damped_test import MovingFabrics, Relaxed
    from knitlab.solvers.equilibrium.state import TensileTest

CONTACT_FACTOR = 6.0  # how much longer fabrics with contact take
TIME_TO_REST = 60.0  # usual duration of a motion until a fabric is at rest [ms]
STIFFNESS_OF_NODE = 4.7  # largest eigenvalue of the stiffness of a sheet, over the largest k_s


class DampedDynamics(Method):
    """Tests in time, as in the paper: flat sheets are released, fold, and are pulled."""

    name: ClassVar[str] = "dynamics"
    refused: ClassVar[tuple[str, ...]] = ("sensitivities", "unloading")
    state: ClassVar[str] = "state"
    steps: ClassVar[str] = "time steps"
    seconds_of_work: ClassVar[float] = 1.2e-7
    bytes_of_unknown: ClassVar[float] = 1.2e3

    def stretch(self, cases: "Sequence[Case]", progress: Progress) -> "list[TensileTest]":
        """Tests of the cases, all moved together."""
        from knitlab.solvers.dynamics.damped_test import stretch_by_dynamics

        def report(number: int, states: float) -> None:
            progress(cases[number].case_id, states)

        strains = [case.applied_strain for case in cases]
        return stretch_by_dynamics(moving_fabrics(cases), strains, report)

    def work(self, case: "Case", states: float) -> float:
        """Work of the first states, in time steps of a node."""
        longer = CONTACT_FACTOR if case.options.contact != "none" else 1.0
        return longer * _time_steps(case, states) * case.mesh_shape.nodes

    def remarks(self, combination: "Combination") -> Iterator[str]:
        """Drag and perturbed copies are of equilibria."""
        if combination.solver.drag:
            ignored = f"drag = {combination.solver.drag:g} is ignored by dynamics"
            yield f"{ignored}, which have a damping_ratio"
        if combination.robustness:
            ignored = f"robustness = {combination.robustness} is ignored by {self.name}"
            yield f"{ignored}: perturbed copies are tested in equilibrium only"


def moving_fabrics(cases: "Sequence[Case]") -> "MovingFabrics":
    """Cases of one mesh shape and the same settings of the dynamics, as a batch."""
    from knitlab.solvers.dynamics.contact_pairs import PairFinder
    from knitlab.solvers.dynamics.damped_test import MovingFabrics  # a plan needs no JAX

    shape = cases[0].mesh_shape
    touching = [case for case in cases if case.options.contact != "none"]
    return MovingFabrics(
        shape,
        [case.assemble()[1] for case in cases],
        [case.inertia() for case in cases],
        cases[0].motion,
        [case.load for case in cases],
        [PairFinder(shape, case.contact_layers) for case in touching],
    )


def moved_sheets(
    cases: "Sequence[Case]", progress: Progress, sheets: "Sequence[Configuration | None]"
) -> "list[Relaxed]":
    """Sheets of cases, relaxed in time."""
    from knitlab.solvers.dynamics.damped_test import relax_by_dynamics

    def report(number: int, states: float) -> None:
        progress(cases[number].case_id, states)

    return relax_by_dynamics(moving_fabrics(cases), report, sheets)


def _time_steps(case: "Case", states: float) -> float:
    """About the number of time steps of the leapfrog in the first states of a test."""
    motion = case.motion
    stiffest = max(case.weft.k_s, case.warp.k_s)
    mass = motion.surface_density * case.weft.period * case.warp.period
    mass *= (case.options.length_scale / case.options.cells_per_period) ** 2
    stable = 2 * math.sqrt(mass / (STIFFNESS_OF_NODE * stiffest))  # the longest time step [ms]
    at_rest = motion.ending == "rest"
    relaxation = TIME_TO_REST if at_rest else motion.relax_time
    rate = motion.strain_rate
    if motion.ending == "steps":
        relaxation = motion.relax_steps * stable
        rate = motion.step_strain / stable
    strain = float(np.interp(states - 1, range(len(case.applied_strain)), case.applied_strain))
    waiting = TIME_TO_REST * max(states - 1, 0.0) if at_rest else 0.0
    duration = relaxation * min(states, 1.0) + strain / rate + waiting
    return duration / (motion.step_safety * stable)
