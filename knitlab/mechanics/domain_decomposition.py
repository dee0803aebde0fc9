"""Nonlinear domain decomposition: subdomains of a large sample are solved before the whole.

A large sample snaps here and there at every strain step, and where all of it moves together, one
line search shortens every step for the sake of one place. So the subdomains are solved first,
one after the other, with all around them held, and the whole has little left to do (nonlinear
elimination: Lanzkron, Rose, Wilkes, SIAM J. Sci. Comput. 17, 1996; Cai, Keyes, ibid. 24, 2002).

What is left are wrinkles as long as the sample, which pulling makes move and merge at almost no
cost. Yarn would stretch if they went straight, so that each round moves them by little; but
subdomains undo that stretch. So where rounds gain slowly, the step of the last one is extrapolated
and the subdomains are solved again, as long as that pays.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from knitlab.mechanics.equilibrium import (
    find_equilibrium,
    minimise,
    minimise_with_one_factorisation,
)
from knitlab.mechanics.equilibrium_search import Search, SearchRules
from knitlab.mechanics.evaluation import Evaluation
from knitlab.mechanics.solver import Evaluate, Solver, SolverSettings, SolveSubdomains
from knitlab.mechanics.state import Outcome, State
from knitlab.mechanics.subdomains import worth_dividing

PATIENCE = 10
"""Iterations of the whole after which subdomains are solved again, where it snaps locally."""
FORCE_LEFT = 1e-6
"""Force that may be left in a subdomain [N]; were it larger, the whole would take more."""
MOST_ITERATIONS = 300
"""Of one subdomain."""
SUBDOMAIN_SHIFT = 1e-7
"""μ that the whole begins with after its subdomains [N/mm]: one as large as that of other searches
would hold its long wrinkles."""
ROUNDS = 8
"""After which extrapolation may begin: most samples are at rest after not many more."""
SLOW = 0.3
"""Part of what the round before gained from which on a round is slow."""
EXTRAPOLATION = 2.0
"""Of a step, in lengths of the step before."""
LONGEST_EXTRAPOLATION = 2.5
"""Of an extrapolated step, in the longest steps of a search."""


def find_equilibrium_by_subdomains(
    start: Evaluate, rules: SearchRules, patience: int | None = PATIENCE
) -> Solver[State]:
    """As :func:`~knitlab.mechanics.equilibrium.find_equilibrium`; large samples by subdomains.

    An iteration of a subdomain counts as the share of the unknowns that it has.

    Args:
        start: configuration to start from, and the stage; its held unknowns stay.
        rules: that the search keeps to.
        patience: iterations of the whole after which subdomains are solved again; with ``None``
            they are whenever it is about to be factorised, and nothing is extrapolated: where a
            factorisation no longer pays, it is often for the sake of few places. That is best
            where the sample folds as a whole.
    """
    if not worth_dividing(rules.free.shape):
        return (yield from find_equilibrium(start, rules))
    began = yield start
    search = Search(start, began, rules)
    subdomains = SubdomainSolution(search)
    if patience is not None:
        search.shift = SUBDOMAIN_SHIFT
    while True:
        search.move(*(yield from subdomains.solve(search.at)))
        if patience is not None:
            yield from subdomains.extrapolate()
        left = rules.settings.max_iterations - round(subdomains.cost)
        until = left if patience is None else min(search.iterations + patience, left)
        search.rules = rules.up_to(until)
        outcome = yield from (minimise_with_one_factorisation if patience is None else minimise)(
            search
        )
        if outcome is Outcome.stalled:
            # Nothing can start from what the subdomains reached: cells may have folded to nothing.
            search.rules = rules.up_to(left)
            search.begin(start, began)
            outcome = yield from minimise(search)
        elif outcome is Outcome.iteration_limit and search.iterations < left:
            continue
        if outcome is not None:
            state = search.state(outcome)
            return replace(state, iterations=round(subdomains.cost) + state.iterations)


class SubdomainSolution:
    """Subdomain solutions, round after round.

    Args:
        search: for the state of the whole.

    Attributes:
        cost: iterations that they took, in iterations of the whole.
    """

    def __init__(self, search: Search) -> None:
        self.cost = 0.0
        self._search, self._rules = search, search.rules
        self._last: Float[np.ndarray, " unknown"] | None = None
        self._energy = self._gain = 0.0
        self._rounds = 0

    def solve(self, at: Evaluate) -> Solver[tuple[Evaluate, Evaluation]]:
        """Solve the subdomains from a state of the whole; the state after that, and its energy."""
        rules = self._rules
        local_settings = subdomain_settings(rules.settings)
        there, cost = yield SolveSubdomains(at, rules.free, rules.step_length, local_settings)
        self.cost += cost
        return there, (yield there)

    def extrapolate(self) -> Solver[None]:
        """Where many rounds gain slowly, extrapolate the step of the last one.

        Each step goes along the one before, and is worth while if it gains half as much. The last
        of them is not, and is undone.
        """
        search, before, gain = self._search, self._last, self._energy - self._search.energy
        slow = self._rounds >= ROUNDS and gain > SLOW * self._gain > 0
        self._gain, self._rounds = gain, self._rounds + 1
        while before is not None and slow and self.cost < self._rules.settings.max_iterations:
            here = search.at.unknowns
            ahead = replace(search.at, unknowns=here + self._extrapolation(here - before))
            there, now = yield from self.solve(ahead)
            gained = search.energy - float(now.energy.total)
            slow = gained > gain / 2
            if slow:
                before, gain = here, gained
                search.move(there, now)
        self._last, self._energy = search.at.unknowns, search.energy

    def _extrapolation(self, step: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
        longest = self._rules.longest_part(step[self._rules.free.places])
        return step * min(EXTRAPOLATION, LONGEST_EXTRAPOLATION * longest)


def subdomain_settings(settings: SolverSettings) -> SolverSettings:
    """Settings for a subdomain, which is solved to a low accuracy only."""
    tolerance = max(settings.tolerance, FORCE_LEFT)
    return replace(settings, tolerance=tolerance, max_iterations=MOST_ITERATIONS)
