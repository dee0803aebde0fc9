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

PATIENCE = 10
"""Iterations of the whole after which its blocks settle again, where it snaps here and there."""
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
    patience: int | None = PATIENCE,
) -> Solver[State]:
    """As :func:`~knitlab.mechanics.equilibrium.find_equilibrium`, by blocks where there are many.

    An iteration of a block counts as that part of one which its unknowns are of the whole.

    Args:
        start: where to start from, and so what follows, as there.
        free: the free unknowns and the sparsity of their stiffness.
        step_length: longest change of the vector between neighbouring nodes in a step [mm].
        settings: tolerance and limits.
        floor: energy below which the search is broken off [N mm].
        convexified: whether to convexify the stiffness rather than to raise μ.
        patience: iterations of the whole after which the blocks settle again; with ``None`` they
            do whenever it is about to be factored: where a factorisation no longer pays, it is
            often for the sake of few places. That is best where the sample folds as a whole.
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
        until = left if patience is None else min(search.iterations + patience, left)
        search.settings = replace(settings, max_iterations=until)
        outcome = yield from (by_one_factorisation if patience is None else to_rest)(search)
        if outcome is Outcome.stalled:
            # What its blocks came to is no place to go on from: cells may have folded to nothing.
            search.settings = replace(settings, max_iterations=left)
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
