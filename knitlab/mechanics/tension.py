"""The virtual tensile test: equilibrium at every applied strain of a protocol."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from knitlab.mechanics.loading import Loading, tensile
from knitlab.mechanics.newton import Request, Solver, SolverSettings, find_equilibrium
from knitlab.mechanics.relaxation import relax
from knitlab.mechanics.state import State, TensileTest
from knitlab.mechanics.stiffness import free_stiffness
from knitlab.model.fabric import Fabric
from knitlab.model.network import Network

ROUND_OFF = 1e-9


def stretch(
    net: Network,
    fabric: Fabric,
    applied_strain: Sequence[float],
    settings: SolverSettings,
    progress: Callable[[int], None] = lambda done: None,
) -> Solver[TensileTest]:
    """Solver that relaxes a fabric and takes it through a tensile test.

    The path to a strain is followed in equal steps of at most ``settings.path_step``, each
    starting from the line through the two states before it, the first from an affine stretch.
    A step that fails is tried again over half the strain, down to ``settings.smallest_step`` of
    a full one. What all that costs is counted in the state it leads to. The test ends at the
    first strain that cannot be reached.

    Args:
        net: network of the fabric's mesh shape.
        fabric: its numbers.
        applied_strain: ascending, from 0, the relaxed shape.
        settings: of the equilibrium solver.
        progress: told how many of the states are done.
    """
    relaxed = yield from relax(net, fabric, settings)
    progress(1)
    if not relaxed.converged:
        return TensileTest(None, [relaxed])
    loading = tensile(net.shape, relaxed.configuration)
    free = free_stiffness(net.shape, loading.unknowns)
    longest = settings.step_limit * float(fabric.cell.min())

    states = [relaxed]
    path = [(applied_strain[0], relaxed.configuration)]
    for target in applied_strain[1:]:
        distance = target - path[-1][0]
        full = distance / math.ceil(distance / settings.path_step - ROUND_OFF)
        step, spent = full, list[State]()
        while True:
            left = target - path[-1][0]
            strain = target if left <= step * (1 + ROUND_OFF) else path[-1][0] + step
            start = loading.holding(_ahead(path, strain, loading), strain)
            state = yield from find_equilibrium(Request(start), free, longest, settings)
            if state.converged:
                path = [path[-1], (strain, state.configuration)]
                if strain == target:
                    break
            elif step / 2 < settings.smallest_step * full:
                break
            else:
                step /= 2
            spent.append(state)
        states.append(state.after(*spent))
        progress(len(states))
        if not state.converged:
            break
    return TensileTest(loading, states)


def _ahead(
    path: list[tuple[float, Float[np.ndarray, " unknown"]]], strain: float, loading: Loading
) -> Float[np.ndarray, " unknown"]:
    (last_strain, last) = path[-1]
    if len(path) == 1:
        return last + (strain - last_strain) * loading.drive
    before_strain, before = path[-2]
    return last + (last - before) * (strain - last_strain) / (last_strain - before_strain)
