"""Settling: blocks of a large sample come to rest by themselves before the whole is asked.

A large sample snaps here and there at every strain step, and where all of it moves together, one
line search shortens every step for the sake of one place. So the blocks are solved first, one
after the other, with all around them held, and the whole has little left to do (nonlinear
elimination: Lanzkron, Rose, Wilkes, SIAM J. Sci. Comput. 17, 1996; Cai, Keyes, ibid. 24, 2002).

What is left are wrinkles as long as the sample, which pulling makes move and merge at almost no
cost. Yarn would stretch if they went straight, so that each round moves them by little; but blocks
undo that stretch. So where rounds go on and on, the sample slides ahead along the way of the last
one and its blocks settle again, as long as that pays.
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
"""Iterations of the whole after which its blocks settle again, where it snaps here and there."""
FORCE_LEFT = 1e-6
"""Force that a block may keep [N]; where it keeps more, the whole is asked more often."""
MOST_ITERATIONS = 300
"""Of one block."""
SETTLED_SHIFT = 1e-7
"""μ that the whole begins with where its blocks have settled [N/mm]: one as large as that of other
searches would hold its long wrinkles."""
ROUNDS = 8
"""After which slides may begin: most samples have come to rest in not many more."""
SLOW = 0.3
"""Part of what the round before gained from which on a round is slow."""
REACH = 2.0
"""Of a slide, in ways of what went before."""
LONGEST_SLIDE = 2.5
"""Of a slide, in longest steps."""


def find_equilibrium_by_subdomains(
    start: Evaluate, rules: SearchRules, patience: int | None = PATIENCE
) -> Solver[State]:
    """As :func:`~knitlab.mechanics.equilibrium.find_equilibrium`, by blocks where there are many.

    An iteration of a block counts as that part of one which its unknowns are of the whole.

    Args:
        start: configuration to start from, and the stage; its held unknowns stay.
        rules: that the search keeps to.
        patience: iterations of the whole after which the blocks settle again; with ``None`` they
            do whenever it is about to be factored, and never slide: where a factorisation no
            longer pays, it is often for the sake of few places. That is best where the sample
            folds as a whole.
    """
    if not worth_dividing(rules.free.shape):
        return (yield from find_equilibrium(start, rules))
    began = yield start
    search = Search(start, began, rules)
    settling = SubdomainSolution(search)
    if patience is not None:
        search.shift = SETTLED_SHIFT
    while True:
        search.move(*(yield from settling.settled(search.at)))
        if patience is not None:
            yield from settling.slide()
        left = rules.settings.max_iterations - round(settling.share)
        until = left if patience is None else min(search.iterations + patience, left)
        search.rules = rules.up_to(until)
        outcome = yield from (minimise_with_one_factorisation if patience is None else minimise)(
            search
        )
        if outcome is Outcome.stalled:
            # What its blocks came to is no place to go on from: cells may have folded to nothing.
            search.rules = rules.up_to(left)
            search.begin(start, began)
            outcome = yield from minimise(search)
        elif outcome is Outcome.iteration_limit and search.iterations < left:
            continue
        if outcome is not None:
            state = search.state(outcome)
            return replace(state, iterations=round(settling.share) + state.iterations)


class SubdomainSolution:
    """Blocks that settle, round after round.

    Args:
        search: for the state of the whole.

    Attributes:
        share: iterations that they took, each as its part of one of the whole.
    """

    def __init__(self, search: Search) -> None:
        self.share = 0.0
        self._search, self._rules = search, search.rules
        self._last: Float[np.ndarray, " unknown"] | None = None
        self._energy = self._gain = 0.0
        self._rounds = 0

    def settled(self, at: Evaluate) -> Solver[tuple[Evaluate, Evaluation]]:
        """Where the blocks come to from a configuration, and what it costs there."""
        rules = self._rules
        of_blocks = subdomain_settings(rules.settings)
        there, share = yield SolveSubdomains(at, rules.free, rules.step_length, of_blocks)
        self.share += share
        return there, (yield there)

    def slide(self) -> Solver[None]:
        """Where many rounds gain slowly, take the search ahead along the way of the last one.

        Each slide goes along that of the one before, and is worth while if it gains half as much.
        The last of them is not, and is undone.
        """
        search, before, gain = self._search, self._last, self._energy - self._search.energy
        slow = self._rounds >= ROUNDS and gain > SLOW * self._gain > 0
        self._gain, self._rounds = gain, self._rounds + 1
        while before is not None and slow and self.share < self._rules.settings.max_iterations:
            here = search.at.unknowns
            ahead = replace(search.at, unknowns=here + self._ahead(here - before))
            there, now = yield from self.settled(ahead)
            gained = search.energy - float(now.energy.total)
            slow = gained > gain / 2
            if slow:
                before, gain = here, gained
                search.move(there, now)
        self._last, self._energy = search.at.unknowns, search.energy

    def _ahead(self, way: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
        rules = self._rules
        return way * min(REACH, LONGEST_SLIDE * rules.longest_part(way[rules.free.places]))


def subdomain_settings(settings: SolverSettings) -> SolverSettings:
    """Settings for a block, which need only come near to rest."""
    tolerance = max(settings.tolerance, FORCE_LEFT)
    return replace(settings, tolerance=tolerance, max_iterations=MOST_ITERATIONS)
