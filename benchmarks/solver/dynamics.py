"""The paper's method: damped dynamics until nothing moves (:mod:`knitlab.solvers.dynamics`).

A load step starts as for the other methods, from rest; no time is spent on pulling slowly, which
spares the dynamics the better part of what knitlab's own tensile test by dynamics takes.
"""

from dataclasses import replace

import numpy as np

from benchmarks.solver.problem import Free, GivenUp, Problem, Search, Unknowns
from knitlab.model.fabric import Configuration
from knitlab.model.inertia import Inertia
from knitlab.solvers.dynamics.damped_test import MovingFabrics, configuration_of, on_grid
from knitlab.solvers.dynamics.motion import Moving, advance
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.loading import all_free

PIECE = 1.0  # length of a piece of motion [ms]


def dynamics(settings: Dynamics, damping_ratio: float) -> Search:
    """Damped dynamics from rest.

    Args:
        settings: of the dynamics; the force left at rest is the problem's tolerance.
        damping_ratio: in place of the settings' [1].
    """

    def search(problem: Problem, start: Unknowns, free: Free) -> Unknowns:
        own = replace(settings, rest_force=problem.tolerance)
        held = len(free) < len(all_free(problem.shape))
        moving = _at_rest(problem, start, own, held, damping_ratio / settings.damping_ratio)
        while not moving.resting[0]:
            moving = advance(moving, moving.time + PIECE, own, to_rest=True)
            if moving.diverged[0]:
                raise GivenUp("the dynamics diverged")
        return np.asarray(configuration_of(moving.motion.shape, 0).flattened())

    return search


def _at_rest(
    problem: Problem, start: Unknowns, settings: Dynamics, held: bool, damping_factor: float
) -> Moving:
    if problem.inertia is None:
        raise ValueError("the dynamics need a mass; pose the problem with method=dynamics")
    damping = problem.inertia.damping * damping_factor
    inertia = Inertia(problem.inertia.node_mass, damping)
    fabrics = MovingFabrics(problem.shape, [problem.fabric], [inertia], settings, [WARP])
    at = on_grid(Configuration.of(start, problem.shape))
    return Moving.from_rest(fabrics.bodies(clamped=held), [at])
