"""The executor: it answers the requests of one fabric's solver on a CPU."""

from dataclasses import dataclass, replace
from functools import cached_property
from queue import SimpleQueue
from threading import Event
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool

from knitlab.elasticity.element_chunks import ChunkedFabric
from knitlab.elasticity.evaluation import ElementHessians, Evaluation
from knitlab.elasticity.factorisation import (
    Factorisers,
    Factors,
    factorise_with_contact,
    factoriser,
    one_thread_of_blas,
)
from knitlab.elasticity.stiffness import FreeStiffness
from knitlab.linalg.threads import ALONE, Threads, allowed_threads
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.solvers.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium_search import SearchRules
from knitlab.solvers.second_process import SecondProcess, SubdomainData, SubdomainTask
from knitlab.solvers.solver import (
    Assemble,
    ChangeDiagonal,
    Evaluate,
    Factorise,
    Request,
    Solve,
    Solver,
    SolveSubdomains,
)
from knitlab.solvers.state import Outcome, State
from knitlab.solvers.subdomains import (
    Subdomain,
    couplings,
    independent_groups,
    subdomains_of,
    worth_dividing,
)
from knitlab.solvers.walls import Walls

MOST_SECOND_PROCESSES = 7
"""Largest number of second processes for one sample; each takes 0.4 to 0.9 GB."""

Result = TypeVar("Result")


class Executor:
    """Answers the requests of one fabric's solver on this processor.

    Args:
        shape: mesh shape of the fabric.
        fabric: the fabric.
        factorisers: cache of factorisers, to which new ones are added.
        threads: threads that share the work; for subdomains, every thread but one uses a second
            process.
    """

    def __init__(
        self,
        shape: MeshShape,
        fabric: Fabric,
        factorisers: Factorisers | None = None,
        threads: Threads = ALONE,
    ) -> None:
        self.fabric, self._shape, self._threads = fabric, shape, threads
        self._elements = ChunkedFabric.of(shape, fabric, threads)
        self._factorisers = {} if factorisers is None else factorisers
        self._decompositions: dict[FreeStiffness, _Decomposition] = {}
        self._free: FreeStiffness | None = None
        self._entries = np.zeros(0)
        self._factors: Factors | None = None

    def answer(self, request: Request) -> Any:
        """The answer to a request."""
        match request:
            case Evaluate(unknowns, stage):
                return self._elements.evaluate(stage, unknowns)
            case Assemble(unknowns, free, stage):
                return self.assemble(free, self._elements.element_hessians(stage, unknowns))
            case Factorise():
                return self._factorise(request)
            case ChangeDiagonal(places, changes):
                if self._factors is None:
                    raise RuntimeError("nothing is factorised")
                return self._factors.change_diagonal(places, changes)
            case Solve(right):
                if self._factors is None:
                    raise RuntimeError("nothing is factorised")
                return self._factors.solve(right)
            case SolveSubdomains():
                return self._solve_subdomains(request)

    def assemble(self, free: FreeStiffness, hessians: ElementHessians) -> None:
        """Assemble the stiffness of the free unknowns from element Hessians."""
        self._free, self._entries = free, free.entries(hessians, self._threads)

    def _factorise(self, request: Factorise) -> bool:
        free = self._free
        if free is None:
            raise RuntimeError("nothing is assembled")
        entries = free.shifted(self._entries, request.shift)
        if request.contact is not None:
            self._factors = factorise_with_contact(free, entries, request.contact, self._threads)
            return self._factors is not None
        wanted = free, request.exact
        if wanted not in self._factorisers:
            self._release_large_factors()
            precision = np.float64 if request.exact else np.float32
            self._factorisers[wanted] = factoriser(free, self._threads, precision)
        self._factors = self._factorisers[wanted](entries, request.convexified)
        return self._factors is not None

    def _release_large_factors(self) -> None:
        """Release the memory of other factors, if this is a large sample.

        It is most of the memory of a large sample, whose free unknowns change only once, between
        relaxation and tensile test.
        """
        if worth_dividing(self._shape):
            self._factors = None
            for key in [key for key in self._factorisers if key[0].shape == self._shape]:
                del self._factorisers[key]

    def _solve_subdomains(self, request: SolveSubdomains) -> tuple[Evaluate, float]:
        decomposition = self._decomposition(request.free)
        unknowns, cost = request.at.unknowns.copy(), 0.0
        gradient = np.asarray(self._elements.evaluate(request.at.stage, unknowns).gradient)
        forces = np.array([problem.subdomain.force(gradient) for problem in decomposition.problems])
        accepted = max(request.settings.tolerance, request.force_part * float(forces.max()))
        settings = replace(request.settings, tolerance=accepted)
        processes = self._processes

        def solved(place: int) -> State:
            problem = decomposition.problems[place]
            start = Evaluate(unknowns[problem.subdomain.places], request.at.stage)
            name = decomposition.number, place
            subdomain_task = SubdomainTask(name, start, request.step_length, settings)
            process = processes.get()
            try:
                state = process.solve(subdomain_task, problem.sent) if process else None
                return state or solve_subdomain(
                    problem.executor, problem.subdomain.free, subdomain_task
                )
            finally:
                processes.put(process)

        for group in independent_groups(forces, decomposition.coupled):
            for place, state in zip(group, self._threads.each(solved, group), strict=True):
                subdomain = decomposition.problems[place].subdomain
                # A subdomain that stalls, or ends with a larger residual than any had before, may
                # have collapsed a cell, where fold angles are undefined.
                if state.outcome is not Outcome.stalled and state.residual <= forces.max():
                    unknowns[subdomain.places] = state.unknowns
                cost += state.iterations * len(subdomain.free.places) / len(request.free.places)
        return Evaluate(unknowns, request.at.stage), cost

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
        return _LocalProblem(subdomain, sent, Executor(shape, fabric, self._factorisers))

    @cached_property
    def _processes(self) -> "SimpleQueue[SecondProcess | None]":
        """Idle processes for subdomains: this process (``None``) and its second processes."""
        processes = SimpleQueue[SecondProcess | None]()
        processes.put(None)
        for _ in range(min(self._threads.count - 1, MOST_SECOND_PROCESSES)):
            processes.put(SecondProcess())
        return processes


@dataclass(frozen=True, eq=False)
class _LocalProblem:
    """A subdomain with the means to solve it.

    Attributes:
        subdomain: the subdomain.
        sent: its data for a second process.
        executor: its executor in this process.
    """

    subdomain: Subdomain
    sent: SubdomainData
    executor: Executor


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


def solve_subdomain(
    executor: Executor, free: FreeStiffness, subdomain_task: SubdomainTask
) -> State:
    """The equilibrium of a subdomain with its boundary held."""
    walls, settings = Walls.of(executor.fabric), subdomain_task.settings
    rules = SearchRules(free, subdomain_task.step_length, walls, settings, convexified=False)
    return run_to_end(executor, find_equilibrium(subdomain_task.start, rules))


def run(shape: MeshShape, fabric: Fabric, solver: Solver[Result]) -> Result:
    """Run the solver of one fabric to its end and return its result.

    All threads that this process may use share the work; results do not depend on their number.
    """
    with one_thread_of_blas():
        return run_to_end(Executor(shape, fabric, threads=Threads(allowed_threads())), solver)


def run_to_end(executor: Executor, solver: Solver[Result], stopped: Event | None = None) -> Result:
    """Run a solver to its end with an executor and return its result.

    Args:
        executor: answers its requests.
        solver: the solver.
        stopped: if this is set meanwhile, the solver is abandoned.

    Raises:
        InterruptedError: if the solver was abandoned.
    """
    answer: Evaluation | Any = None
    while stopped is None or not stopped.is_set():
        try:
            answer = executor.answer(solver.send(answer))
        except StopIteration as end:
            return end.value
    solver.close()
    raise InterruptedError("the solver was abandoned")
