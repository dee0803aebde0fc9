"""A large sample whose subdomains can be solved one by one, in several processes."""

from dataclasses import dataclass, replace
from functools import cached_property
from queue import SimpleQueue
from threading import Event

import numpy as np
from jaxtyping import Bool

from knitlab.equilibrium.equilibrium import find_equilibrium
from knitlab.equilibrium.equilibrium_search import SearchRules
from knitlab.equilibrium.second_process import SecondProcess, SubdomainData, SubdomainTask
from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.state import Outcome, State
from knitlab.equilibrium.stiffness import FreeStiffness
from knitlab.equilibrium.subdomains import (
    Subdomain,
    couplings,
    independent_groups,
    subdomains_of,
    worth_dividing,
)
from knitlab.equilibrium.system import System
from knitlab.equilibrium.walls import Walls
from knitlab.fabric.energy import Point
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.fabric.threads import ALONE, Threads

MOST_SECOND_PROCESSES = 7
"""Largest number of second processes for one sample; each takes 0.4 to 0.9 GB."""


class DividedSystem(System):
    """The equations of a large sample; all threads but one solve subdomains in other processes."""

    def solve_subdomains(
        self,
        at: Point,
        free: FreeStiffness,
        step_length: float,
        settings: SolverSettings,
        force_part: float = 0.0,
    ) -> tuple[Point, float]:
        """Solve the subdomains of the sample to low accuracy, one after another.

        Args:
            at: configuration to start from, and the stage.
            free: the free unknowns of the sample.
            step_length: longest change of the vector between neighbouring nodes in a step [mm].
            settings: settings for each subdomain.
            force_part: fraction of the largest force in the sample that is accepted in a
                subdomain, if it exceeds the tolerance.

        Returns:
            The resulting state of the sample, and the number of iterations, each weighted by the
            subdomain's share of the unknowns.
        """
        decomposition = self._decomposition(free)
        unknowns, cost = at.unknowns.copy(), 0.0
        gradient = np.asarray(self._elements.evaluate(at.stage, unknowns).gradient)
        forces = np.array([problem.subdomain.force(gradient) for problem in decomposition.problems])
        accepted = max(settings.tolerance, force_part * float(forces.max()))
        settings = replace(settings, tolerance=accepted)
        processes = self._processes

        def solved(place: int) -> State:
            problem = decomposition.problems[place]
            start = Point(unknowns[problem.subdomain.places], at.stage)
            name = decomposition.number, place
            subdomain_task = SubdomainTask(name, start, step_length, settings)
            process = processes.get()
            try:
                state = process.solve(subdomain_task, problem.sent) if process else None
                return state or solve_subdomain(
                    problem.system, problem.subdomain.free, subdomain_task
                )
            finally:
                processes.put(process)

        for group in independent_groups(forces, decomposition.coupled):
            for place, state in zip(group, self.threads.each(solved, group), strict=True):
                subdomain = decomposition.problems[place].subdomain
                # A subdomain that stalls, or ends with a larger residual than any had before, may
                # have collapsed a cell, where fold angles are undefined.
                if state.outcome is not Outcome.stalled and state.residual <= forces.max():
                    unknowns[subdomain.places] = state.unknowns
                cost += state.iterations * len(subdomain.free.places) / len(free.places)
        self.factorised()
        return Point(unknowns, at.stage), cost

    def release_factors(self) -> None:
        """Release the memory of all factors of the whole sample.

        It is most of the memory of a large sample, whose free unknowns change only once, between
        relaxation and tensile test.
        """
        self._factors = None
        for key in [key for key in self.factorisers if key[0].shape == self.shape]:
            del self.factorisers[key]

    @cached_property
    def _decompositions(self) -> "dict[FreeStiffness, _Decomposition]":
        return {}

    def _decomposition(self, free: FreeStiffness) -> "_Decomposition":
        if free not in self._decompositions:
            found = list(subdomains_of(free))
            problems = [self._local_problem(subdomain) for subdomain in found]
            coupled = couplings(found, free.shape.unknowns)
            self._decompositions[free] = _Decomposition(
                len(self._decompositions), problems, coupled
            )
        return self._decompositions[free]

    def _local_problem(self, subdomain: Subdomain) -> "_LocalProblem":
        shape, fabric = subdomain.free.shape, subdomain.fabric(self.fabric)
        sent = SubdomainData(shape, subdomain.free.places, fabric)
        return _LocalProblem(subdomain, sent, System(shape, fabric, self.factorisers))

    @cached_property
    def _processes(self) -> "SimpleQueue[SecondProcess | None]":
        """Idle processes for subdomains: this process (``None``) and its second processes."""
        processes = SimpleQueue[SecondProcess | None]()
        processes.put(None)
        for _ in range(min(self.threads.count - 1, MOST_SECOND_PROCESSES)):
            processes.put(SecondProcess())
        return processes


@dataclass(frozen=True, eq=False)
class _LocalProblem:
    """A subdomain with the means to solve it.

    Attributes:
        subdomain: the subdomain.
        sent: its data for a second process.
        system: its equations in this process.
    """

    subdomain: Subdomain
    sent: SubdomainData
    system: System


@dataclass(frozen=True, eq=False)
class _Decomposition:
    """A decomposition of a sample into subdomains.

    Attributes:
        number: index among the decompositions of the sample.
        problems: the subdomains.
        coupled: which pairs of them are coupled.
    """

    number: int
    problems: list[_LocalProblem]
    coupled: Bool[np.ndarray, "subdomain subdomain"]


def system_class(shape: MeshShape) -> type[System]:
    """The class of the equations of a fabric; those of a large sample can be divided."""
    return DividedSystem if worth_dividing(shape) else System


def system_of(
    shape: MeshShape, fabric: Fabric, threads: Threads = ALONE, stopped: Event | None = None
) -> System:
    """The equations of a fabric; arguments as for :class:`~knitlab.equilibrium.system.System`."""
    return system_class(shape)(shape, fabric, threads=threads, stopped=stopped)


def solve_subdomain(system: System, free: FreeStiffness, subdomain_task: SubdomainTask) -> State:
    """The equilibrium of a subdomain with its boundary held."""
    walls, settings = Walls.of(system.fabric), subdomain_task.settings
    rules = SearchRules(free, subdomain_task.step_length, walls, settings, convexified=False)
    return find_equilibrium(system, subdomain_task.start, rules)
