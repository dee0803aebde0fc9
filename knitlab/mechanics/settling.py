"""Settling: blocks of a large sample come to rest by themselves before the whole is asked.

A large sample snaps here and there at every strain step, and where all of it moves together, one
line search shortens every step for the sake of one place. So the blocks are solved first, one
after the other, with all around them held, and the whole has little left to do (nonlinear
elimination: Lanzkron, Rose, Wilkes, SIAM J. Sci. Comput. 17, 1996; Cai, Keyes, ibid. 24, 2002).
"""

from dataclasses import replace

import numpy as np

from knitlab.mechanics.blocks import are_many
from knitlab.mechanics.equilibrium import find_equilibrium
from knitlab.mechanics.solver import Evaluate, Settle, Solver, SolverSettings
from knitlab.mechanics.state import Outcome, State
from knitlab.mechanics.stiffness import FreeStiffness

PATIENCE = 10
"""Iterations of the whole after which its blocks settle again."""
FORCE_LEFT = 1e-4
"""Force that a block may keep [N]."""
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

    An iteration of a block counts as that part of one which its unknowns are of the whole.
    """
    if not are_many(free.shape):
        return (yield from find_equilibrium(start, free, step_length, settings, floor, convexified))
    at, spent = start, 0.0
    while True:
        before = at
        at, share = yield Settle(at, free, step_length, block_settings(settings))
        spent += share
        left = settings.max_iterations - round(spent)
        state = yield from find_equilibrium(
            at,
            free,
            step_length,
            replace(settings, max_iterations=max(min(PATIENCE, left), 1)),
            floor,
            convexified,
        )
        spent += state.iterations
        if state.outcome is Outcome.stalled:
            # What its blocks came to is no place to start from.
            rest = replace(settings, max_iterations=max(left, 1))
            whole = yield from find_equilibrium(before, free, step_length, rest, floor, convexified)
            return replace(whole, iterations=round(spent) + whole.iterations)
        if state.outcome is not Outcome.iteration_limit or spent >= settings.max_iterations:
            return replace(state, iterations=round(spent))
        at = replace(at, configuration=state.configuration)


def block_settings(settings: SolverSettings) -> SolverSettings:
    """Settings for a block, which need only come near to rest."""
    tolerance = max(settings.tolerance, FORCE_LEFT)
    return replace(settings, tolerance=tolerance, max_iterations=MOST_ITERATIONS)
