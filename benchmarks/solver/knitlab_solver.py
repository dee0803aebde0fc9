"""knitlab's own solver, driven under the watch."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from benchmarks.solver.problem import (
    Free,
    Method,
    Problem,
    Search,
    Unknowns,
    pull_by,
)
from benchmarks.solver.watch import GivenUp, Watch
from knitlab.model.energy import COMPLETE, Evaluation, Point
from knitlab.model.fabric import Configuration
from knitlab.model.threads import Threads, allowed_threads
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.domain_decomposition import SubdomainSolver
from knitlab.solvers.equilibrium.drag import Drag
from knitlab.solvers.equilibrium.loading import all_free
from knitlab.solvers.equilibrium.search import Search as OneSearch
from knitlab.solvers.equilibrium.search import SearchRules, minimise
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import State
from knitlab.solvers.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.solvers.equilibrium.system import System, one_thread_of_blas
from knitlab.solvers.equilibrium.tensile_test import relax, stretch, tiled

Result = TypeVar("Result")
Systems = type[System]
"""What factorises: knitlab itself, or CHOLMOD."""


def knitlab(
    settings: Solver,
    systems: Systems = System,
    direct: bool = False,
    periodic: Case | None = None,
) -> Method:
    """The equilibrium solver as it is shipped, from the flat sheet or as a sweep starts it.

    Args:
        settings: of the solver; the tolerance is the problem's.
        systems: what factorises.
        direct: whether a load step is one search, as for the other methods, and not a path of
            small steps along which branches are watched.
        periodic: a cell of the fabric without end; if given it is relaxed first, and the sample
            is laid out of it.
    """

    def each(problem: Problem) -> Solver:
        return replace(settings, tolerance=problem.tolerance)

    def start(problem: Problem, watch: Watch) -> Configuration | None:
        if periodic is None:
            return None
        return _laid_out(problem, periodic, each(problem), systems, watch)

    def relaxed(problem: Problem, watch: Watch) -> Unknowns:
        search = partial(relax, settings=each(problem), start=start(problem, watch))
        return _reached(driven(problem, search, systems, watch))

    def path(problem: Problem, watch: Watch) -> list[Unknowns]:
        def progress(done: int) -> None:
            watch.states = done

        search = partial(
            stretch,
            applied_strain=problem.applied_strain,
            settings=each(problem),
            progress=progress,
            start=start(problem, watch),
        )
        test = driven(problem, search, systems, watch)
        watch.states = sum(state.converged for state in test.states)
        return [_reached(state) for state in test.states]

    pull = partial(pull_by, _search(each, systems), relaxed) if direct else path
    return Method(relaxed, pull, prepare)


def _search(each: Callable[[Problem], Solver], systems: Systems) -> Search:
    def search(problem: Problem, start: Unknowns, free: Free, watch: Watch) -> Unknowns:
        rules = SearchRules(free_stiffness(problem.shape, free), each(problem))

        def found(system: System) -> State:
            whole = OneSearch(system, Point(start), rules)
            return whole.state(minimise(whole))

        return _reached(driven(problem, found, systems, watch))

    return search


def shipped_relaxation(case: Case, watch: Watch) -> State:
    """Relax a sample as a sweep does: between clamps it starts as relaxed periodic fabric."""
    settings = case.equilibrium_solver
    problem, start = Problem.of(case, settings.tolerance), None
    if not (case.mesh_shape.periodic or settings.start == "flat"):
        start = _laid_out(problem, case.periodic_cell, settings, System, watch)
    with watch.paused():
        prepare(problem)
    search = partial(relax, settings=settings, start=start)
    return driven(problem, search, System, watch)


def _laid_out(
    problem: Problem, periodic: Case, settings: Solver, systems: Systems, watch: Watch
) -> Configuration:
    cell = Problem.of(periodic, settings.tolerance)
    with watch.paused():
        prepare(cell)
    search = partial(relax, settings=settings)
    relaxed = Configuration.of(_reached(driven(cell, search, systems, watch)), cell.shape)
    return tiled(problem.net, problem.fabric, cell.net, relaxed)


def driven(
    problem: Problem, search: Callable[[System], Result], systems: Systems, watch: Watch
) -> Result:
    """Run a search to its end, and note the residual of the whole fabric as it goes.

    While the search looks at a fabric that is not yet whole, the watch is paused to see the whole.
    """

    class Watched(systems):  # type: ignore[misc, valid-type]
        """Equations whose parts are timed."""

        seen = all_free(problem.shape)

        def evaluate(self, at: Point, drag: Drag | None = None) -> Evaluation:
            with watch.part("evaluating_seconds"):
                evaluation = super().evaluate(at, drag)
            gradient = evaluation.gradient
            if at.stage is not COMPLETE:
                with watch.paused():
                    gradient = problem.evaluate(at.unknowns).gradient
            watch.sees(float(np.abs(gradient[self.seen]).max()))
            return evaluation

        def assemble(self, at: Point, free: FreeStiffness) -> None:
            with watch.part("assembling_seconds"):
                super().assemble(at, free)
            self.seen = free.dofs

        def factorise(self, *args: Any, **settings: Any) -> bool:
            watch.factorisations += 1
            with watch.part("factorising_seconds"):
                return super().factorise(*args, **settings)

        def change_diagonal(self, *args: Any) -> bool:
            with watch.part("factorising_seconds"):
                return super().change_diagonal(*args)

        def solve(self, right: Unknowns) -> Unknowns:
            with watch.part("solving_seconds"):
                return super().solve(right)

    class WatchedSubdomains(SubdomainSolver):
        """Subdomains whose solution is timed."""

        def solve(self, *args: Any) -> tuple[Point, float]:
            with watch.part("subdomains_seconds"):
                return super().solve(*args)

    with one_thread_of_blas():
        system = Watched(problem.shape, problem.fabric, threads=Threads(allowed_threads()))
        system.subdomains = WatchedSubdomains(system)
        return search(system)


def prepare(problem: Problem) -> None:
    """Compile its programs; plans of assembly and factorisation are made while it is timed."""
    problem.evaluate(problem.flat)
    problem.chunked.element_hessians(COMPLETE, problem.flat)


def _reached(state: State) -> Unknowns:
    if not state.converged:
        raise GivenUp(f"the search {state.outcome.name.replace('_', ' ')}")
    return state.unknowns
