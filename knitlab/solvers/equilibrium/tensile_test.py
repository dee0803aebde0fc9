"""Relaxation off the needles and the simulated tensile test: equilibria along applied strains."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from knitlab.model.energy import COMPLETE, Point, Stage
from knitlab.model.fabric import Configuration, Fabric, flat_sheet
from knitlab.model.network import UPRIGHT, Network, network
from knitlab.model.settings import NO_FRICTION, Friction
from knitlab.solvers.equilibrium.alignment import between_walls, rigidly_aligned
from knitlab.solvers.equilibrium.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium.search import SearchRules
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import State, TensileTest
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.strain_path import StrainPath, intermediate_settings
from knitlab.solvers.equilibrium.subdomains import worth_dividing
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.load import Load
from knitlab.solvers.loads.loading import all_free, loading_of


def stretch(
    system: System,
    applied_strain: Sequence[float],
    settings: Solver,
    progress: Callable[[int], None] = lambda done: None,
    start: Configuration | None = None,
    folded: Configuration | None = None,
    unload: bool = False,
    factorised: Callable[[], None] = lambda: None,
    load: Load = WARP,
    friction: Friction = NO_FRICTION,
    cycle: int = 1,
) -> TensileTest:
    """Relax a fabric and strain it, by default in the paper's tensile test.

    Along a branch of equilibria the energy grows by the work of the reaction force. A step that
    leaves it by ``settings.branch_limit``, or fails, is repeated over half the strain, down to
    ``settings.smallest_step``. If it leaves the branch even then, the fabric has snapped, and the
    state it snapped to is accepted and marked. The test ends at the first strain that cannot be
    reached.

    The relaxation begins with the flat sheet, with ``start`` or, without a detour, with ``folded``,
    nearly in equilibrium. ``friction`` acts from then on. With ``unload`` all strains are passed
    back too. The test is the ``cycle``-th between zero and the largest strain. ``progress`` is
    called with the number of finished states, ``factorised`` after every factorisation.
    """
    system.factorised = factorised
    if folded is None:
        relaxed = relax(system, settings, start, load=load)
    else:
        relaxed = relax_near(system, settings, folded)
    progress(1)
    if not relaxed.converged:
        return TensileTest(None, [relaxed])
    if load.shears and system.shape.periodic:
        relaxed = _with_shear(system, settings, relaxed)
        if not relaxed.converged:
            return TensileTest(None, [relaxed])
    loading = loading_of(system.shape, relaxed.configuration, load)
    if loading.shape != system.shape:
        system, unknowns = system.on(loading.shape), loading.reference
        evaluation = system.evaluate(Point(unknowns))
        gradient = np.asarray(evaluation.gradient)
        relaxed = replace(relaxed, shape=loading.shape, unknowns=unknowns, gradient=gradient)
    path = StrainPath(system, loading, [(applied_strain[0], relaxed)], settings)
    path.begin(friction)
    states = [relaxed]
    for number in range(1, cycle):
        for strain in (*applied_strain[1:], *applied_strain[-2::-1]):
            states = [path.to(strain)]
            if strain == applied_strain[-1] and states[0].converged:
                states = [path.drift(friction.fold_drift / number)]
            if not states[0].converged:
                return TensileTest(None, states)
    for target in applied_strain[1:]:
        state = path.to(target)
        states.append(state)
        progress(len(states))
        if not state.converged:
            break
    unloaded: list[State] = []
    held = states[-1]
    if unload and held.converged:
        held = path.drift(friction.fold_drift / cycle)
    while unload and held.converged and len(unloaded) < len(states) - 1:
        state = path.to(applied_strain[-2 - len(unloaded)])
        if not state.converged:
            break
        unloaded.append(state)
    before = relaxed if cycle > 1 else None
    return TensileTest(loading, states, unloaded=tuple(unloaded), relaxed=before, held=held)


def relax(
    system: System, settings: Solver, start: Configuration | None = None, load: Load = WARP
) -> State:
    """The relaxed shape of a fabric (paper, Sec. "Relaxation of a pattern").

    The rest fold angles are raised in equal steps between walls that are soft at first: hard walls
    would stop every step at the first node that touches them. A sample for clamping relaxes with
    free edges, is rigidly aligned and solved again. Periodic fabric is solved with a convexified
    stiffness, which is faster, and again by raising μ if that collapses a cell.
    """
    shape, fabric = system.shape, system.fabric
    free = free_stiffness(shape, all_free(shape))
    # From a flat sheet, round-off of single precision may decide which shape is reached.
    whole = SearchRules(free, settings, exact=not worth_dividing(shape))
    flat = flat_sheet(network(shape), fabric)
    begin = np.asarray((flat if start is None else start).flattened())
    ramp, soft = settings.ramp_steps, settings.soft_wall
    stages = [Stage(step / ramp, soft) for step in range(1, ramp)]
    stages += [Stage(1.0, soft * 10.0**k) for k in range(math.ceil(-math.log10(soft)))]
    waypoint = intermediate_settings(settings, fabric)
    passed: list[State] = []
    # A convexified stiffness would rotate a sample with free edges slightly at every step.
    for convexified in (True, False) if shape.periodic else (False,):
        unknowns = begin
        for stage in (*stages, COMPLETE):
            rules = replace(
                whole, settings=settings if stage is COMPLETE else waypoint, convexified=convexified
            )
            state = find_equilibrium(system, Point(unknowns, stage), rules, patience=None)
            passed.append(state)
            unknowns = state.unknowns
        if passed[-1].converged:
            break
    if passed[-1].converged and not shape.periodic:
        aligned = rigidly_aligned(shape, flat, passed[-1].configuration, load)
        at = Point(np.asarray(between_walls(shape, aligned, float(fabric.z_max)).flattened()))
        rules = replace(whole, convexified=False)
        passed.append(find_equilibrium(system, at, rules, patience=None))
    return passed[-1].after(*passed[:-1])


def relax_near(system: System, settings: Solver, start: Configuration) -> State:
    """The relaxed shape next to a configuration that is nearly in equilibrium."""
    free = free_stiffness(system.shape, all_free(system.shape))
    rules = SearchRules(free, settings, convexified=False)
    # The lattice of a relaxed shape is not sheared.
    begin = Configuration(start.positions, start.lengths[: system.shape.lengths])
    return find_equilibrium(system, Point(np.asarray(begin.flattened())), rules)


def _with_shear(system: System, settings: Solver, relaxed: State) -> State:
    """Relaxed periodic fabric of which the lattice may shear too, as that of some patterns does."""
    shape = replace(system.shape, frame=UPRIGHT)
    free = free_stiffness(shape, all_free(shape))
    lengths = np.append(np.asarray(relaxed.configuration.lengths), 0.0)
    start = Configuration(relaxed.configuration.positions, lengths)
    rules = SearchRules(free, settings, convexified=False)
    at = Point(np.asarray(start.flattened()))
    return find_equilibrium(system.on(shape), at, rules).after(relaxed)


def imperfect_sheet(net: Network, fabric: Fabric, seed: int) -> Configuration:
    """A flat sheet with every node displaced at random, by 2 % of a side of a grid cell."""
    flat, sides = flat_sheet(net, fabric), np.asarray(fabric.cell_sides)
    noise = np.random.default_rng(seed).normal(size=flat.positions.shape)
    moved = np.asarray(flat.positions) + 0.02 * float(sides.min()) * noise
    return Configuration(moved, np.asarray(flat.lengths))


def tiled(net: Network, fabric: Fabric, cell: Network, relaxed: Configuration) -> Configuration:
    """A sample tiled with relaxed periodic fabric, in equilibrium except at its edges."""
    rows, columns = np.mgrid[: net.shape.nodes_y, : net.shape.nodes_x]
    turns_y, rows = np.divmod(rows, cell.shape.nodes_y)
    turns_x, columns = np.divmod(columns, cell.shape.nodes_x)
    nodes = np.asarray(relaxed.positions)[rows, columns].copy()
    nodes[..., 0] += turns_x * relaxed.lengths[0]
    nodes[..., 1] += turns_y * relaxed.lengths[1]
    return Configuration(nodes, np.asarray(flat_sheet(net, fabric).lengths))
