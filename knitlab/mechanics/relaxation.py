"""Relaxation: the flat sheet off the needles folds into its corrugated shape."""

from dataclasses import replace

import numpy as np

from knitlab.mechanics.loading import all_free
from knitlab.mechanics.newton import Request, Solver, SolverSettings, State, find_equilibrium
from knitlab.mechanics.stiffness import free_stiffness
from knitlab.model.fabric import Fabric, flat_sheet
from knitlab.model.network import Network

# On the way to the full rest angles a state need only be near the path.
WAYPOINT_TOLERANCE = 1e-3


def relax(net: Network, fabric: Fabric, settings: SolverSettings) -> Solver[State]:
    """Solver for the relaxed shape (paper, Sec. "Relaxation of a pattern").

    From the flat sheet the rest fold angles are raised to their full value in
    ``settings.ramp_steps`` equal steps, each to a loose equilibrium, the last to tolerance.
    A sample for clamping relaxes with all its edges free. No coordinate is pinned: steps are the
    shortest that do, so the sample does not shift, and turns only as its shape makes it.
    """
    shape = net.shape
    free = free_stiffness(shape, all_free(shape))
    longest = settings.step_limit * float(fabric.cell.min())
    configuration = np.asarray(flat_sheet(net, fabric))
    waypoint = replace(settings, tolerance=max(settings.tolerance, WAYPOINT_TOLERANCE))
    passed: list[State] = []
    for step in range(1, settings.ramp_steps):
        request = Request(configuration, step / settings.ramp_steps)
        state = yield from find_equilibrium(request, free, longest, waypoint)
        configuration = state.configuration
        passed.append(state)
    state = yield from find_equilibrium(Request(configuration), free, longest, settings)
    return state.after(*passed)
