"""Relaxation: the flat sheet off the needles folds into its corrugated shape."""

from dataclasses import replace

import numpy as np

from knitlab.mechanics.loading import all_free, squared_up
from knitlab.mechanics.newton import Request, Solver, SolverSettings, find_equilibrium
from knitlab.mechanics.state import State
from knitlab.mechanics.stiffness import free_stiffness
from knitlab.model.fabric import Fabric, flat_sheet
from knitlab.model.network import Network


def relax(net: Network, fabric: Fabric, settings: SolverSettings) -> Solver[State]:
    """Solver for the relaxed shape (paper, Sec. "Relaxation of a pattern").

    From the flat sheet the rest fold angles are raised to their full value in
    ``settings.ramp_steps`` equal steps, each but the last only near equilibrium: to
    ``settings.waypoint_force`` of the largest force that a fold exerts on the flat sheet.
    A sample for clamping relaxes with all its edges free; no coordinate is pinned. It is then
    squared up, and solved again as the walls may resist that.
    """
    shape = net.shape
    free = free_stiffness(shape, all_free(shape))
    longest = settings.step_limit * float(fabric.cell.min())
    flat = configuration = np.asarray(flat_sheet(net, fabric))
    moments = np.asarray(fabric.fold_stiffness * abs(fabric.rest_fold))
    near = settings.waypoint_force * float(moments.max() / fabric.cell.min())
    waypoint = replace(settings, tolerance=max(settings.tolerance, near))
    passed: list[State] = []
    for step in range(1, settings.ramp_steps):
        request = Request(configuration, step / settings.ramp_steps)
        state = yield from find_equilibrium(request, free, longest, waypoint)
        configuration = state.configuration
        passed.append(state)
    state = yield from find_equilibrium(Request(configuration), free, longest, settings)
    if state.converged and not shape.periodic:
        passed.append(state)
        square = Request(squared_up(shape, flat, state.configuration))
        state = yield from find_equilibrium(square, free, longest, settings)
    return state.after(*passed)
