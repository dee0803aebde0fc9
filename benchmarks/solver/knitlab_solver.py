"""knitlab's own solver, driven under the watch."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from benchmarks.solver.cholmod import CholmodExecutor
from benchmarks.solver.problem import (
    Free,
    Method,
    Problem,
    Search,
    Unknowns,
    pull_by,
)
from benchmarks.solver.watch import GivenUp, Watch
from knitlab.elasticity.evaluation import COMPLETE
from knitlab.elasticity.factorisation import one_thread_of_blas
from knitlab.linalg.threads import Threads, allowed_threads
from knitlab.mechanics.loading import all_free
from knitlab.mechanics.relaxation import relax
from knitlab.mechanics.starting_shape import tiled
from knitlab.mechanics.tensile_test import stretch
from knitlab.model.configuration import Configuration
from knitlab.simulation.case import Case
from knitlab.solvers.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium_search import SearchRules
from knitlab.solvers.executor import Executor
from knitlab.solvers.solver import (
    Assemble,
    ChangeDiagonal,
    Evaluate,
    Factorise,
    Request,
    Solve,
    Solver,
    SolverSettings,
    SolveSubdomains,
)
from knitlab.solvers.state import State

Result = TypeVar("Result")
PARTS: dict[type[Request], str] = {
    Evaluate: "evaluating_seconds",
    Assemble: "assembling_seconds",
    Factorise: "factorising_seconds",
    ChangeDiagonal: "factorising_seconds",
    Solve: "solving_seconds",
    SolveSubdomains: "subdomains_seconds",
}
"""Name of the time that each kind of request takes in all."""
Executors = type[Executor] | type[CholmodExecutor]


def knitlab(
    settings: SolverSettings,
    executors: Executors = Executor,
    direct: bool = False,
    periodic: Case | None = None,
) -> Method:
    """The equilibrium solver as it is shipped, from the flat sheet or as a sweep starts it.

    Args:
        settings: of the solver; the tolerance is the problem's.
        executors: what answers the solver's requests.
        direct: whether a load step is one search, as for the other methods, and not a path of
            small steps along which branches are watched.
        periodic: a cell of the fabric without end; if given it is relaxed first, and the sample
            is laid out of it.
    """

    def each(problem: Problem) -> SolverSettings:
        return replace(settings, tolerance=problem.tolerance)

    def start(problem: Problem, watch: Watch) -> Configuration | None:
        if periodic is None:
            return None
        return _laid_out(problem, periodic, each(problem), executors, watch)

    def relaxed(problem: Problem, watch: Watch) -> Unknowns:
        solver = relax(problem.net, problem.fabric, each(problem), start(problem, watch))
        return _reached(driven(problem, solver, executors, watch))

    def path(problem: Problem, watch: Watch) -> list[Unknowns]:
        def progress(done: int) -> None:
            watch.states = done

        solver = stretch(
            problem.net,
            problem.fabric,
            problem.applied_strain,
            each(problem),
            progress,
            start(problem, watch),
        )
        test = driven(problem, solver, executors, watch)
        watch.states = sum(state.converged for state in test.states)
        return [_reached(state) for state in test.states]

    pull = partial(pull_by, _search(each, executors), relaxed) if direct else path
    return Method(relaxed, pull, prepare)


def _search(each: Callable[[Problem], SolverSettings], executors: Executors) -> Search:
    def search(problem: Problem, start: Unknowns, free: Free, watch: Watch) -> Unknowns:
        rules = SearchRules.of(problem.shape, free, problem.fabric, each(problem))
        solver = find_equilibrium(Evaluate(start), rules)
        return _reached(driven(problem, solver, executors, watch))

    return search


def shipped_relaxation(case: Case, watch: Watch) -> State:
    """Relax a sample as a sweep does: between clamps it starts as relaxed periodic fabric."""
    settings = case.equilibrium_solver
    problem, start = Problem.of(case, settings.tolerance), None
    if not (case.mesh_shape.periodic or settings.start == "flat"):
        start = _laid_out(problem, case.periodic_cell, settings, Executor, watch)
    solver = relax(problem.net, problem.fabric, settings, start)
    with watch.paused():
        prepare(problem)
    return driven(problem, solver, Executor, watch)


def _laid_out(
    problem: Problem, periodic: Case, settings: SolverSettings, executors: Executors, watch: Watch
) -> Configuration:
    cell = Problem.of(periodic, settings.tolerance)
    with watch.paused():
        prepare(cell)
    solver = relax(cell.net, cell.fabric, settings)
    relaxed = Configuration.of(_reached(driven(cell, solver, executors, watch)), cell.shape)
    return tiled(problem.net, problem.fabric, cell.net, relaxed)


def driven(problem: Problem, solver: Solver[Result], executors: Executors, watch: Watch) -> Result:
    """Run a solver to its end, and note the residual of the whole fabric as it goes.

    While the solver looks at a fabric that is not yet whole, the watch is paused to see the whole.
    """
    with one_thread_of_blas():
        return _driven(problem, solver, executors, watch)


def _driven(problem: Problem, solver: Solver[Result], executors: Executors, watch: Watch) -> Result:
    threads = Threads(allowed_threads())
    executor = executors(problem.shape, problem.fabric, threads=threads)
    free, answer = all_free(problem.shape), None
    while True:
        try:
            request = solver.send(answer)
        except StopIteration as end:
            return end.value
        with watch.part(PARTS[type(request)]):
            answer = executor.answer(request)
        match request:
            case Assemble():
                free = request.free.places
            case Factorise():
                watch.factorisations += 1
            case Evaluate(unknowns, stage):
                gradient = answer.gradient
                if stage is not COMPLETE:
                    with watch.paused():
                        gradient = problem.evaluate(unknowns).gradient
                watch.sees(float(np.abs(gradient[free]).max()))


def prepare(problem: Problem) -> None:
    """Compile its programs; plans of assembly and factorisation are made while it is timed."""
    problem.evaluate(problem.flat)
    problem.chunked.element_hessians(COMPLETE, problem.flat)


def _reached(state: State) -> Unknowns:
    if not state.converged:
        raise GivenUp(f"the search {state.outcome.name.replace('_', ' ')}")
    return state.unknowns
