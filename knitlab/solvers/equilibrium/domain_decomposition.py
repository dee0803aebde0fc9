"""Solution of the subdomains of a large sample, one by one, in several processes.

Threads of one process would wait for the interpreter lock between many small calls. A second
process is a separate program, not a worker of a pool: these run an unguarded script again and
outlive a parent that is killed. This program ends when its standard input is closed.
"""

import os
import pickle
import signal
import subprocess
import sys
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from queue import SimpleQueue
from typing import IO

import numpy as np
from jaxtyping import Bool, Int

from knitlab.io.job_limits import ONE_THREAD
from knitlab.model.computing import computing
from knitlab.model.energy import Point
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.solvers.equilibrium.search import Search, SearchRules, minimise
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import Outcome, State
from knitlab.solvers.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.solvers.equilibrium.subdomains import (
    Subdomain,
    couplings,
    grid_subdomains,
    independent_groups,
)
from knitlab.solvers.equilibrium.system import KeptFactors, System, one_thread_of_blas

ACCEPTED_FORCE = 0.01  # of the largest on a subdomain: most subdomains then need no work
Coupled = Bool[np.ndarray, "subdomain subdomain"]
SentSubdomain = tuple[MeshShape, Int[np.ndarray, " free"], Fabric]
"""Mesh shape of a subdomain, indices of its free unknowns, and its springs, folds and walls."""


@dataclass(frozen=True, eq=False)
class _LocalProblem:
    """A subdomain with its fabric, its equations in this process, and a number of its own."""

    number: int
    subdomain: Subdomain
    fabric: Fabric
    system: System


class SubdomainSolver:
    """Solves the subdomains of one sample; all its threads but one do so in other processes."""

    def __init__(self, system: System) -> None:
        self._fabric = system.fabric
        self._threads = system.threads
        self._kept: KeptFactors = {}
        self._numbers = count()
        self._decompositions: dict[FreeStiffness, tuple[list[_LocalProblem], Coupled]] = {}

    def solve(
        self, system: System, at: Point, free: FreeStiffness, settings: Solver
    ) -> tuple[Point, float]:
        """Solve the subdomains to low accuracy, those with the largest forces first.

        Returns the state of the sample, and the iterations weighted by each subdomain's unknowns.
        """
        problems, coupled = self._decomposition(free)
        unknowns = at.unknowns.copy()
        cost = 0.0
        gradient = np.asarray(system.evaluate(at).gradient)
        forces = np.array([problem.subdomain.force(gradient) for problem in problems])
        # Forces above 1e-6 N would cost more iterations of the whole.
        accepted = max(settings.tolerance, 1e-6, ACCEPTED_FORCE * float(forces.max()))
        settings = replace(settings, tolerance=accepted, max_iterations=300)

        def solved(number: int) -> State:
            problem = problems[number]
            start = Point(unknowns[problem.subdomain.dofs], at.stage)
            free = problem.subdomain.free
            state = None
            process = self._processes.get()
            try:
                if process is not None:
                    sent = free.shape, free.dofs, problem.fabric
                    state = process.solve(problem.number, sent, start, settings)
                return state or solve_subdomain(problem.system, free, start, settings)
            finally:
                self._processes.put(process)

        for group in independent_groups(forces, coupled):
            for number, state in zip(group, self._threads.each(solved, group), strict=True):
                subdomain = problems[number].subdomain
                # A subdomain that stalls, or ends with a larger residual than any had before, may
                # have collapsed a cell, where fold angles are undefined.
                if state.outcome is not Outcome.stalled and state.residual <= forces.max():
                    unknowns[subdomain.dofs] = state.unknowns
                cost += state.iterations * len(subdomain.free.dofs) / len(free.dofs)
        system.factorised()
        return Point(unknowns, at.stage), cost

    def _decomposition(self, free: FreeStiffness) -> tuple[Sequence[_LocalProblem], Coupled]:
        if free not in self._decompositions:
            subdomains = list(grid_subdomains(free))
            problems = []
            for number, subdomain in zip(self._numbers, subdomains, strict=False):
                fabric = subdomain.fabric(self._fabric)
                system = System(subdomain.free.shape, fabric, kept=self._kept)
                problems.append(_LocalProblem(number, subdomain, fabric, system))
            self._decompositions[free] = problems, couplings(subdomains, free.shape.unknowns)
        return self._decompositions[free]

    @cached_property
    def _processes(self) -> "SimpleQueue[SecondProcess | None]":
        """Idle processes for subdomains: this process (``None``) and its second processes."""
        processes = SimpleQueue[SecondProcess | None]()
        processes.put(None)
        for _ in range(min(self._threads.count - 1, 7)):  # each takes 0.4 to 0.9 GB
            processes.put(SecondProcess())
        return processes


def solve_subdomain(system: System, free: FreeStiffness, start: Point, settings: Solver) -> State:
    """The equilibrium of a subdomain with its boundary held."""
    search = Search(system, start, SearchRules(free, settings, convexified=False))
    return search.state(minimise(search))


class SecondProcess:
    """Another process that solves subdomains one after another; ``pid`` is its identifier."""

    def __init__(self) -> None:
        process = subprocess.Popen(
            [sys.executable, "-m", "knitlab.solvers.equilibrium.domain_decomposition"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        self.pid = process.pid
        self._requests = process.stdin
        self._replies = process.stdout
        self._known: set[int] = set()
        weakref.finalize(self, _end, process, self._requests, self._replies)

    def solve(
        self, number: int, subdomain: SentSubdomain, start: Point, settings: Solver
    ) -> State | None:
        """Equilibrium of a subdomain, known to the process by its number; ``None`` if it died."""
        try:
            sent = None if number in self._known else subdomain
            pickle.dump((number, sent, start, settings), self._requests)
            self._requests.flush()
            self._known.add(number)
            return pickle.load(self._replies)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None


def _end(process: subprocess.Popen[bytes], requests: IO[bytes], replies: IO[bytes]) -> None:
    # A dead process cannot receive buffered data.
    with suppress(OSError):
        requests.close()
    replies.close()
    process.wait()


def _serve(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Solve the requested subdomains until the other end closes the requests."""
    kept: KeptFactors = {}
    known: dict[int, tuple[System, FreeStiffness]] = {}
    while True:
        try:
            number, subdomain, start, settings = pickle.load(requests)
        except EOFError:
            return
        if subdomain is not None:
            shape, dofs, fabric = subdomain
            known[number] = System(shape, fabric, kept=kept), free_stiffness(shape, dofs)
        pickle.dump(solve_subdomain(*known[number], start, settings), replies)
        replies.flush()


if __name__ == "__main__":
    # The parent handles interrupts, and this process ends with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Printed text must not mix with the replies.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as answers:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        with computing(), one_thread_of_blas():
            _serve(sys.stdin.buffer, answers)
