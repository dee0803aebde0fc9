"""Settling: blocks of a large sample come to rest by themselves before the whole is asked.

A large sample snaps here and there at every strain step, and where all of it moves together, one
line search shortens every step for the sake of one place. So the blocks are solved first, one
after the other, with all around them held, and the whole has little left to do (nonlinear
elimination: Lanzkron, Rose, Wilkes, SIAM J. Sci. Comput. 17, 1996; Cai, Keyes, ibid. 24, 2002).
"""

from dataclasses import replace

import numpy as np

from knitlab.mechanics.blocks import are_many
from knitlab.mechanics.equilibrium import Search, by_one_factorisation, find_equilibrium, to_rest
from knitlab.mechanics.solver import Evaluate, Settle, Solver, SolverSettings
from knitlab.mechanics.state import Outcome, State
from knitlab.mechanics.stiffness import FreeStiffness

FORCE_LEFT = 1e-6
"""Force that a block may keep [N]; where it keeps more, the whole is asked more often."""
MOST_ITERATIONS = 300
"""Of one block."""


def find_settled(
    start: Evaluate,
    free: FreeStiffness,
    step_length: float,
    settings: SolverSettings,
    floor: float = -np.inf,
    convexified: bool = True,
) -> Solver[State]:
    """As :func:`~knitlab.mechanics.equilibrium.find_equilibrium`, by blocks where there are many.

    They settle whenever the whole is about to be factored: where a factorisation no longer pays,
    it is often for the sake of few places. An iteration of a block counts as that part of one
    which its unknowns are of the whole.
    """
    if not are_many(free.shape):
        return (yield from find_equilibrium(start, free, step_length, settings, floor, convexified))
    began = yield start
    search = Search(start, began, free, step_length, settings, floor, convexified)
    of_blocks = 0.0
    while True:
        at, share = yield Settle(search.at, free, step_length, block_settings(settings))
        of_blocks += share
        search.move(at, (yield at))
        left = settings.max_iterations - round(of_blocks)
        search.settings = replace(settings, max_iterations=left)
        outcome = yield from by_one_factorisation(search)
        if outcome is Outcome.stalled:
            # What its blocks came to is no place to go on from: cells may have folded to nothing.
            search.begin(start, began)
            outcome = yield from to_rest(search)
        if outcome is not None:
            state = search.state(outcome)
            return replace(state, iterations=round(of_blocks) + state.iterations)


def block_settings(settings: SolverSettings) -> SolverSettings:
    """Settings for a block, which need only come near to rest."""
    tolerance = max(settings.tolerance, FORCE_LEFT)
    return replace(settings, tolerance=tolerance, max_iterations=MOST_ITERATIONS)
