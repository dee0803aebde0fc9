"""Settling: blocks of a large sample come to rest by themselves before the whole is asked.

A large sample snaps here and there at every strain step, and where all of it moves together, one
line search shortens every step for the sake of one place. So the blocks are solved first, one
after the other, with all around them held, and the whole has little left to do (nonlinear
elimination: Lanzkron, Rose, Wilkes, SIAM J. Sci. Comput. 17, 1996; Cai, Keyes, ibid. 24, 2002).
"""

from dataclasses import replace

from knitlab.mechanics.blocks import are_many
from knitlab.mechanics.equilibrium import by_one_factorisation, find_equilibrium, to_rest
from knitlab.mechanics.search import Search, SearchRules
from knitlab.mechanics.solver import Evaluate, Settle, Solver, SolverSettings
from knitlab.mechanics.state import Outcome, State

PATIENCE = 10
"""Iterations of the whole after which its blocks settle again, where it snaps here and there."""
FORCE_LEFT = 1e-6
"""Force that a block may keep [N]; where it keeps more, the whole is asked more often."""
MOST_ITERATIONS = 300
"""Of one block."""


def find_settled(
    start: Evaluate, rules: SearchRules, patience: int | None = PATIENCE
) -> Solver[State]:
    """As :func:`~knitlab.mechanics.equilibrium.find_equilibrium`, by blocks where there are many.

    An iteration of a block counts as that part of one which its unknowns are of the whole.

    Args:
        start: configuration to start from, and the stage; its held unknowns stay.
        rules: that the search keeps to.
        patience: iterations of the whole after which the blocks settle again; with ``None`` they
            do whenever it is about to be factored: where a factorisation no longer pays, it is
            often for the sake of few places. That is best where the sample folds as a whole.
    """
    if not are_many(rules.free.shape):
        return (yield from find_equilibrium(start, rules))
    began = yield start
    search, of_blocks = Search(start, began, rules), 0.0
    for_blocks = block_settings(rules.settings)
    while True:
        at, share = yield Settle(search.at, rules.free, rules.step_length, for_blocks)
        of_blocks += share
        search.move(at, (yield at))
        left = rules.settings.max_iterations - round(of_blocks)
        until = left if patience is None else min(search.iterations + patience, left)
        search.rules = rules.up_to(until)
        outcome = yield from (by_one_factorisation if patience is None else to_rest)(search)
        if outcome is Outcome.stalled:
            # What its blocks came to is no place to go on from: cells may have folded to nothing.
            search.rules = rules.up_to(left)
            search.begin(start, began)
            outcome = yield from to_rest(search)
        elif outcome is Outcome.iteration_limit and search.iterations < left:
            continue
        if outcome is not None:
            state = search.state(outcome)
            return replace(state, iterations=round(of_blocks) + state.iterations)


def block_settings(settings: SolverSettings) -> SolverSettings:
    """Settings for a block, which need only come near to rest."""
    tolerance = max(settings.tolerance, FORCE_LEFT)
    return replace(settings, tolerance=tolerance, max_iterations=MOST_ITERATIONS)
