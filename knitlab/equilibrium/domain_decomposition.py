"""Nonlinear domain decomposition: subdomains of a large sample are solved before the whole sample.

A large sample snaps locally at every strain step, and a line search for the whole sample would
shorten every step because of a single place. So the subdomains are solved first, one after another,
with their surroundings held, and little work remains for the whole (nonlinear elimination:
Lanzkron, Rose, Wilkes, SIAM J. Sci. Comput. 17, 1996; Cai, Keyes, ibid. 24, 2002).

What remains are wrinkles as long as the sample, which move and merge at almost no cost in energy.
The yarn would stretch if they moved along a straight line in configuration space, so that each
round displaces them only slightly; but solving the subdomains relaxes that stretch. So if rounds
gain slowly, the step of the last round is extrapolated and the subdomains are solved again, as long
as that reduces the energy enough.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from knitlab.equilibrium.divided_system import DividedSystem
from knitlab.equilibrium.equilibrium import (
    find_equilibrium,
    minimise,
    minimise_with_one_factorisation,
)
from knitlab.equilibrium.equilibrium_search import Search, SearchRules
from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.state import Outcome, State
from knitlab.equilibrium.system import System
from knitlab.fabric.energy import Evaluation, Point

PATIENCE = 20
"""Iterations for the whole sample after which subdomains are solved again."""
FORCE_LEFT = 1e-6
"""Residual force accepted in a subdomain [N]; a larger one costs more iterations of the whole."""
FORCE_PART = 0.01
"""The same, as a fraction of the largest force in the sample: most subdomains need no work while
a few are far from equilibrium."""
MOST_ITERATIONS = 300
"""Largest number of iterations for one subdomain."""
SUBDOMAIN_SHIFT = 1e-7
"""Initial μ for the whole sample after its subdomains [N/mm]; a μ as large as in other searches
would slow its long wrinkles."""
ROUNDS = 8
"""Rounds before extrapolation may begin; most samples converge within a few more."""
SLOW = 0.3
"""Energy gain of a round over that of the previous one above which progress is slow."""
EXTRAPOLATION = 2.0
"""Length of an extrapolated step over that of the previous step."""
LONGEST_EXTRAPOLATION = 2.5
"""Largest length of an extrapolated step, over the step limit of a search."""


def find_equilibrium_by_subdomains(
    system: System, start: Point, rules: SearchRules, patience: int | None = PATIENCE
) -> State:
    """Like :func:`~knitlab.equilibrium.equilibrium.find_equilibrium`; large samples by subdomains.

    An iteration of a subdomain counts by its share of the unknowns. Contact may couple subdomains,
    so that a sample with contact is solved as a whole.

    Args:
        system: the equations of the fabric.
        start: configuration to start from, and the stage; its held unknowns stay fixed.
        rules: rules of the search.
        patience: iterations for the whole sample after which subdomains are solved again. With
            ``None`` they are solved before every factorisation, and nothing is extrapolated: a
            factorisation often ceases to be useful because of a few places. This is best if the
            sample folds as a whole.
    """
    if rules.contact is not None or not isinstance(system, DividedSystem):
        return find_equilibrium(system, start, rules)
    search = Search(system, start, rules)
    evaluation, subdomains = search.evaluation, SubdomainSolution(system, search)
    if patience is not None:
        search.shift = SUBDOMAIN_SHIFT
    while True:
        search.move(*subdomains.solve(search.at))
        if patience is not None:
            subdomains.extrapolate()
        remaining = rules.settings.max_iterations - round(subdomains.cost)
        until = remaining if patience is None else min(search.iterations + patience, remaining)
        search.rules = rules.up_to(until)
        outcome = (minimise_with_one_factorisation if patience is None else minimise)(search)
        if outcome is Outcome.stalled:
            # Restart: the subdomains may have collapsed cells, from where no search can continue.
            search.rules = rules.up_to(remaining)
            search.begin(start, evaluation)
            outcome = minimise(search)
        elif outcome is Outcome.iteration_limit and search.iterations < remaining:
            continue
        if outcome is not None:
            state = search.state(outcome)
            return replace(state, iterations=round(subdomains.cost) + state.iterations)


class SubdomainSolution:
    """Repeated subdomain solutions.

    Args:
        system: the equations of the sample.
        search: search for the state of the whole sample.

    Attributes:
        cost: their iterations, in equivalent iterations of the whole sample.
    """

    def __init__(self, system: DividedSystem, search: Search) -> None:
        self.cost, self._system = 0.0, system
        self._search, self._rules = search, search.rules
        self._last: Float[np.ndarray, " unknown"] | None = None
        self._energy = self._gain = 0.0
        self._rounds = 0

    def solve(self, at: Point) -> tuple[Point, Evaluation]:
        """Solve the subdomains from a state of the whole; returns the new state and its energy."""
        rules = self._rules
        local_settings = subdomain_settings(rules.settings)
        after, cost = self._system.solve_subdomains(
            at, rules.free, rules.step_length, local_settings, FORCE_PART
        )
        self.cost += cost
        return after, self._system.evaluate(after)

    def extrapolate(self) -> None:
        """If many rounds gain slowly, extrapolate the step of the last one.

        Extrapolation is repeated while each step gains at least half as much energy as the one
        before; the last step, which does not, is discarded.
        """
        search, before, gain = self._search, self._last, self._energy - self._search.energy
        slow = self._rounds >= ROUNDS and gain > SLOW * self._gain > 0
        self._gain, self._rounds = gain, self._rounds + 1
        while before is not None and slow and self.cost < self._rules.settings.max_iterations:
            current = search.at.unknowns
            ahead = replace(search.at, unknowns=current + self._extrapolation(current - before))
            after, evaluation = self.solve(ahead)
            gained = search.energy - float(evaluation.energy.total)
            slow = gained > gain / 2
            if slow:
                before, gain = current, gained
                search.move(after, evaluation)
        self._last, self._energy = search.at.unknowns, search.energy

    def _extrapolation(self, step: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
        longest = self._rules.longest_part(step[self._rules.free.places])
        return step * min(EXTRAPOLATION, LONGEST_EXTRAPOLATION * longest)


def subdomain_settings(settings: SolverSettings) -> SolverSettings:
    """Settings for a subdomain, which is solved to low accuracy."""
    tolerance = max(settings.tolerance, FORCE_LEFT)
    return replace(settings, tolerance=tolerance, max_iterations=MOST_ITERATIONS)
