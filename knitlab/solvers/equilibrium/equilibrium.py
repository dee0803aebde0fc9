"""The equilibrium near a configuration; in a large sample its subdomains are solved first.

A large sample snaps locally at every strain step, which would shorten every step of a search for
the whole: the subdomains are solved first, with their surroundings held (nonlinear elimination:
Lanzkron, Rose, Wilkes, SIAM J. Sci. Comput. 17, 1996; Cai, Keyes, ibid. 24, 2002). What remains are
wrinkles as long as the sample, which move and merge at almost no cost in energy, but only slightly
in each round; if rounds gain slowly, the last step is extrapolated.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from threading import Event
from typing import TYPE_CHECKING, TypeVar

from knitlab.io import job_limits
from knitlab.model.energy import Evaluation, Point
from knitlab.model.fabric import Fabric, Unknowns
from knitlab.model.network import MeshShape
from knitlab.model.threads import Threads
from knitlab.solvers.equilibrium.domain_decomposition import SubdomainSolver
from knitlab.solvers.equilibrium.search import Search, SearchRules, minimise
from knitlab.solvers.equilibrium.state import Outcome, State
from knitlab.solvers.equilibrium.subdomains import worth_dividing
from knitlab.solvers.equilibrium.system import System, one_thread_of_blas

if TYPE_CHECKING:
    from knitlab.solvers.case import Case
    from knitlab.solvers.equilibrium.contact_barrier import Barrier

MAX_CONCURRENT_NODES = 4096  # number of nodes up to which fabrics run concurrently
ROUNDS = 8  # rounds before extrapolation may begin; most samples converge within a few more
MAX_EXTRAPOLATION = 2.5  # largest extrapolated step, over the step limit of a search

Result = TypeVar("Result")


def run_each(
    shape: MeshShape,
    fabrics: Sequence[Fabric],
    searches: Sequence[Callable[[System], Result]],
    contacts: "Sequence[Barrier | None]" = (),
) -> list[Result]:
    """Results of one function for each fabric, which is called with the equations of the fabric.

    Small fabrics run one to a thread; large ones one after another, as their elements and fronts
    keep all threads busy. Results do not depend on the number of threads.
    """
    threads = Threads(job_limits.threads())
    stopped = Event()
    problems = list(zip(fabrics, searches, contacts or [None] * len(fabrics), strict=True))
    with one_thread_of_blas():
        if len(problems) == 1 or shape.nodes > MAX_CONCURRENT_NODES:
            return [
                search(System(shape, fabric, threads, contact=contact))
                for fabric, search, contact in problems
            ]

        def alone(problem: "tuple[Fabric, Callable[[System], Result], Barrier | None]") -> Result:
            fabric, search, contact = problem
            return search(System(shape, fabric, stopped=stopped, contact=contact))

        try:
            return threads.each(alone, problems)
        except BaseException:
            # Python would wait for the other threads before it exits.
            stopped.set()
            raise


def run_cases(
    cases: "Sequence[Case]", searches: Sequence[Callable[[System], Result]]
) -> list[Result]:
    """Results of one function for each case of one mesh shape, as of :func:`run_each`."""
    fabrics = [case.assemble()[1] for case in cases]
    return run_each(cases[0].mesh_shape, fabrics, searches, [case.contact for case in cases])


def find_equilibrium(
    system: System, start: Point, rules: SearchRules, patience: int | None = 20
) -> State:
    """The equilibrium that a search from a configuration leads to; its held unknowns stay fixed.

    Small samples, and those with contact, drag or friction, are solved as a whole. In others the
    subdomains are solved again after ``patience`` iterations for the whole sample, or, with
    ``None``, before every factorisation and without extrapolation: best if the sample folds as a
    whole.
    """
    search = Search(system, start, rules)
    coupling = system.contact, rules.drag, system.fabric.friction
    if any(each is not None for each in coupling) or not worth_dividing(system.shape):
        return search.state(minimise(search))
    evaluation = search.evaluation
    rounds = SubdomainRounds(search)
    if patience is not None:
        # A μ as large as in other searches would slow the long wrinkles [N/mm].
        search.shift = 1e-7
    while True:
        search.move(*rounds.solve(search.at))
        if patience is not None:
            rounds.extrapolate()
        remaining = rules.settings.max_iterations - round(rounds.cost)
        search.limit = remaining
        if patience is not None:
            search.limit = min(search.iterations + patience, remaining)
        outcome = minimise(search, one_factorisation=patience is None)
        if outcome is Outcome.stalled:
            # Restart: the subdomains may have collapsed cells, from where no search can continue.
            search.limit = remaining
            search.begin(start, evaluation)
            outcome = minimise(search)
        elif outcome is Outcome.iteration_limit and search.iterations < remaining:
            continue
        state = search.state(outcome)
        return replace(state, iterations=round(rounds.cost) + state.iterations)


class SubdomainRounds:
    """Rounds of subdomain solutions; ``cost`` is in equivalent iterations of the whole sample."""

    def __init__(self, search: Search) -> None:
        self.cost = 0.0
        self._search = search
        self._last: Unknowns | None = None
        self._energy = self._gain = 0.0
        self._rounds = 0

    def solve(self, at: Point) -> tuple[Point, Evaluation]:
        """Solve the subdomains from a state of the whole; returns the new state and its energy."""
        system = self._search.system
        rules = self._search.rules
        if system.subdomains is None:
            system.subdomains = SubdomainSolver(system)
        after, cost = system.subdomains.solve(system, at, rules.free, rules.settings)
        self.cost += cost
        return after, system.evaluate(after)

    def extrapolate(self) -> None:
        """If many rounds gain slowly, extrapolate the last step while that gains half as much."""
        search = self._search
        before = self._last
        gain = self._energy - self._search.energy
        # Slow is a round that gains more than 0.3 of what the previous one gained.
        slow = self._rounds >= ROUNDS and gain > 0.3 * self._gain > 0
        self._gain = gain
        self._rounds = self._rounds + 1
        while before is not None and slow and self.cost < search.rules.settings.max_iterations:
            current = search.at.unknowns
            step = current - before
            longest = MAX_EXTRAPOLATION * search.longest_fraction(step[search.dofs])
            ahead = replace(search.at, unknowns=current + step * min(2.0, longest))
            after, evaluation = self.solve(ahead)
            gained = search.energy - float(evaluation.energy.total)
            slow = gained > gain / 2
            if slow:
                before = current
                gain = gained
                search.move(after, evaluation)
        self._last = search.at.unknowns
        self._energy = search.energy
